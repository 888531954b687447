"""How messages are kept.

One MCAP file a run, written in whole records and readable up to its first fault. To be tuned:
chunk size and flush time in `writer`; the bounds in `mcap_reading` are what keeps damaged or
hostile files from taking memory. Own reader instead of the stock one: that leaves files
unreadable which were cut off. Rests on mcap and lz4.
"""

from palpate.messages.recording.mcap_reading import DamagedRecording as DamagedRecording
from palpate.messages.recording.reader import (
    LocatedRecord as LocatedRecord,
    ReadablePrefix as ReadablePrefix,
    RecordedMessage as RecordedMessage,
    Recording as Recording,
    RecordingCopy as RecordingCopy,
    RecordingEnd as RecordingEnd,
    counts_of as counts_of,
    open_recording as open_recording,
    part_path as part_path,
    parts_of as parts_of,
)
from palpate.messages.recording.writer import (
    ABOUT as ABOUT,
    MISSING as MISSING,
    RecordingWriter as RecordingWriter,
    free_bytes as free_bytes,
)
