"""The frames by which a subscriber joins a publisher, and misses nothing.

Subscriptions are the only thing that a subscriber can send on the socket that it receives with,
so the requests are made of them. S calls P by subscribing ``@S epoch P ``; P greets S with its
own epoch; S then subscribes, for each topic, a cursor: the call, the greeted epoch, the topic
and the next sequence that it wants. P resends what S lacks and says that S is in step. Replies
go out under the call, which nobody else subscribes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

GREETING, RESENT, IN_STEP = b"H", b"F", b"S"
MAX_REQUEST_BYTES = 4096  # Longest request
_EPOCH = struct.Struct("<I")


class JoinRequest(NamedTuple):
    """What one subscriber asks of one publisher."""

    subscriber: str  # Name of the node that asks
    call: bytes  # Prefix under which the answer goes out
    publisher: str  # Name of the node that is asked
    epoch: int | None  # Epoch of the publisher that was greeted; None asks for the greeting
    topic: str  # Topic of the cursor, empty in a call
    wanted: int  # First sequence that the subscriber has not had


class JoinReply(NamedTuple):
    """What a publisher says to one subscriber alone."""

    publisher: str  # Name of the node that answers
    kind: bytes  # One of `GREETING`, `RESENT` and `IN_STEP`
    rest: bytes  # The epoch, the frame that is sent again, or the topic that is in step


def check_node_name(name: str) -> str:
    """Return the name of a node, if it can stand in a request.

    Raises ValueError if the name is empty, not printable, or holds a space or an ``@``.
    """
    if not name or not name.isprintable() or " " in name or "@" in name:
        raise ValueError(f"a node's name must be printable, without space or '@', got {name!r}")
    return name


def join_call(subscriber: str, epoch: int, publisher: str) -> bytes:
    """Subscription by which a subscriber asks a publisher for its greeting."""
    return f"@{subscriber} {epoch} {publisher} ".encode()


def join_cursor(called: bytes, epoch: int, topic: str, wanted: int) -> bytes:
    """Subscription by which a subscriber asks for a topic from a sequence on."""
    return called + f"{epoch} {topic} {wanted}".encode()


def read_request(notice: bytes) -> JoinRequest | None:
    """Request in a notice of the publisher's socket; None if it is not one."""
    if not notice.startswith(b"\x01@"):
        return None
    words = notice[2 : 2 + MAX_REQUEST_BYTES].decode(errors="replace").split(" ")
    if len(notice) > MAX_REQUEST_BYTES or len(words) not in (4, 6) or not _is_count(words[1]):
        return None
    subscriber, epoch, publisher = words[0], int(words[1]), words[2]
    called = join_call(subscriber, epoch, publisher)
    if len(words) == 4:
        return JoinRequest(subscriber, called, publisher, None, "", 0)
    if not _is_count(words[3]) or not _is_count(words[5]):
        return None
    return JoinRequest(subscriber, called, publisher, int(words[3]), words[4], int(words[5]))


def _is_count(word: str) -> bool:
    """Whether a word is a number of at most 64 bits."""
    return word.isascii() and word.isdecimal() and len(word) < 20


def greeting(called: bytes, epoch: int) -> bytes:
    """Greeting of a publisher."""
    return called + b"\0" + GREETING + _EPOCH.pack(epoch)


def resent_frame(called: bytes, frame: bytes) -> bytes:
    """One frame of the past."""
    return called + b"\0" + RESENT + frame


def in_step_notice(called: bytes, topic: str) -> bytes:
    """Notice that all of the topic's past has been sent."""
    return called + b"\0" + IN_STEP + topic.encode()


def read_reply(frame: bytes) -> JoinReply:
    """Answer in a frame that begins with ``@``. Raises ValueError if the frame is no answer."""
    end = frame.find(b"\0")
    words = frame[: max(end, 0)].split(b" ", 4)
    kind = frame[end + 1 : end + 2]
    if end < 0 or len(words) != 4 or kind not in (GREETING, RESENT, IN_STEP):
        raise ValueError(f"not an answer: {len(frame)} bytes that begin with {frame[:40]!r}")
    try:
        publisher = words[2].decode()
    except UnicodeDecodeError:
        raise ValueError("not an answer: the name of its publisher is not Unicode") from None
    return JoinReply(publisher, kind, frame[end + 2 :])


def read_epoch(rest: bytes) -> int:
    """Epoch in a greeting. Raises ValueError if the greeting has the wrong length."""
    if len(rest) != _EPOCH.size:
        raise ValueError(f"a greeting must hold {_EPOCH.size} bytes, got {len(rest)}")
    epoch: int = _EPOCH.unpack(rest)[0]
    return epoch
