"""Recordings of messages.

A run has one MCAP file, written in whole records and readable up to its first fault. Chunk size and
flush time are parameters in `writer`; the limits in `mcap_reading` keep damaged or hostile files
from taking memory. palpate has its own reader, since that of mcap cannot read files that are cut
off. This package uses mcap and lz4.
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
