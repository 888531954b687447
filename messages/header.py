"""The frame on the wire: topic, fixed header, body, in one piece.

One part, because each further part of a multipart message costs as much as the message.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

_LAYOUT = struct.Struct("<QIQqdI")
SIZE = _LAYOUT.size


class Header(NamedTuple):
    """What every frame says before its body."""

    run: int
    """Number of the run, 64 bits."""
    epoch: int
    """Counts the publisher's starts."""
    seq: int
    """Counts up by one per publisher and topic, across restarts."""
    sent_ns: int
    """The publisher's monotonic clock when it was sent, ns."""
    robot_time: float
    """Robot time in the body, s; 0 if it has none."""
    schema: int
    """Hash of the body's schema."""


def pack_frame(topic: str, header: Header, body: bytes) -> bytes:
    """One frame: topic, a zero byte, the header, the body."""
    return topic.encode() + b"\0" + _LAYOUT.pack(*header) + body


def split_frame(frame: bytes) -> tuple[str, Header, bytes]:
    """Topic, header and body of a frame.

    Raises
    ------
    ValueError
        If the frame is too short to hold a topic and a header, or the topic is no text.
    """
    end = frame.find(b"\0")
    if end < 0 or len(frame) < end + 1 + SIZE:
        raise ValueError(f"not a frame: {len(frame)} bytes without a topic and a header")
    header = Header._make(_LAYOUT.unpack_from(frame, end + 1))
    try:
        topic = frame[:end].decode()
    except UnicodeDecodeError:
        raise ValueError("not a frame: its topic is not Unicode") from None
    return topic, header, frame[end + 1 + SIZE :]
