"""Recordings as files: what they hold, recovery, differences, export and playback.

Formats of export may be added in `FORMATS`. Rests on messages.recording and, to play, on launch.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.bag.contents import bag_info, compare_recordings, diff_text, info_text
    from palpate.tools.bag.contents import recover_recording, recovered_text
    from palpate.tools.bag.decoding import open_decoded
    from palpate.tools.bag.export import export_bag
    from palpate.tools.bag.live_recording import GraphMessages, default_path, record_graph
    from palpate.tools.bag.live_recording import recorded_text
    from palpate.tools.bag.playback import play_recording, player_entry, read_remap
    from palpate.tools.bag.tables import open_recording
else:
    __getattr__, __dir__ = lazy(__name__)
