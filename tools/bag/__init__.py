"""Recordings as files: what they hold, recovery, differences, export and playback.

Formats of export may be added in `FORMATS`. Rests on messages.recording and, to play, on launch.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.bag.contents import bag_info as bag_info
    from palpate.tools.bag.contents import compare_recordings as compare_recordings
    from palpate.tools.bag.contents import diff_text as diff_text
    from palpate.tools.bag.contents import info_text as info_text
    from palpate.tools.bag.contents import recover_recording as recover_recording
    from palpate.tools.bag.contents import recovered_text as recovered_text
    from palpate.tools.bag.export import export_bag as export_bag
    from palpate.tools.bag.playback import play_recording as play_recording
    from palpate.tools.bag.playback import player_entry as player_entry
    from palpate.tools.bag.playback import read_remap as read_remap
else:
    __getattr__, __dir__ = lazy(__name__)
