"""How messages are kept.

One MCAP file a run, written in whole records and readable up to its first fault. To be tuned:
chunk size and flush time in `writer`; the bounds in `mcap_reading` are what keeps damaged or
hostile files from taking memory. Own reader instead of the stock one: that leaves files
unreadable which were cut off. Rests on mcap and lz4.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.messages.recording.mcap_reading import DamagedRecording as DamagedRecording
    from palpate.messages.recording.reader import LocatedRecord as LocatedRecord
    from palpate.messages.recording.reader import ReadablePrefix as ReadablePrefix
    from palpate.messages.recording.reader import RecordedMessage as RecordedMessage
    from palpate.messages.recording.reader import Recording as Recording
    from palpate.messages.recording.reader import RecordingCopy as RecordingCopy
    from palpate.messages.recording.reader import RecordingEnd as RecordingEnd
    from palpate.messages.recording.reader import counts_of as counts_of
    from palpate.messages.recording.reader import open_recording as open_recording
    from palpate.messages.recording.reader import part_path as part_path, parts_of as parts_of
    from palpate.messages.recording.writer import ABOUT as ABOUT, MISSING as MISSING
    from palpate.messages.recording.writer import RecordingWriter as RecordingWriter
    from palpate.messages.recording.writer import free_bytes as free_bytes
else:
    __getattr__, __dir__ = lazy(__name__)
