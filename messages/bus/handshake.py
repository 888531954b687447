"""The frames by which a subscriber joins a publisher, and misses nothing.

A subscriber can send only subscriptions on its receiving socket, so requests are subscriptions. S
calls P by subscribing to ``@S epoch P ``; P greets S with its own epoch; S then subscribes for each
topic to a cursor: the call, the greeted epoch, the topic and the next sequence that it needs. P
resends the messages that S lacks, and says that S is in step. Replies are published under the call,
to which only S subscribes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

GREETING, RESENT, IN_STEP = b"H", b"F", b"S"
MAX_REQUEST_BYTES = 4096
_EPOCH = struct.Struct("<I")


class JoinRequest(NamedTuple):
    """Request of one subscriber to one publisher."""

    subscriber: str  # name of the requesting node
    call: bytes  # prefix of the replies
    publisher: str  # name of the requested node
    epoch: int | None  # of the publisher's greeting; None requests the greeting
    topic: str  # of the cursor; empty in a call
    wanted: int  # first sequence that the subscriber lacks


class JoinReply(NamedTuple):
    """Reply of a publisher to one subscriber."""

    publisher: str  # name of the replying node
    kind: bytes  # one of `GREETING`, `RESENT` and `IN_STEP`
    rest: bytes  # the epoch, the resent frame, or the topic that is in step


def check_node_name(name: str) -> str:
    """The name of a node, if it is allowed in a request.

    Raises ValueError if the name is empty, not printable, or holds a space or an ``@``.
    """
    if not name or not name.isprintable() or " " in name or "@" in name:
        raise ValueError(f"a node's name must be printable, without space or '@', got {name!r}")
    return name


def join_call(subscriber: str, epoch: int, publisher: str) -> bytes:
    """Subscription that requests a publisher's greeting."""
    return f"@{subscriber} {epoch} {publisher} ".encode()


def join_cursor(called: bytes, epoch: int, topic: str, wanted: int) -> bytes:
    """Subscription that requests a topic from a sequence on."""
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
    """Reply with the publisher's epoch."""
    return called + b"\0" + GREETING + _EPOCH.pack(epoch)


def resent_frame(called: bytes, frame: bytes) -> bytes:
    """Reply with a frame that was published before."""
    return called + b"\0" + RESENT + frame


def in_step_notice(called: bytes, topic: str) -> bytes:
    """Reply that all earlier messages of a topic have been sent."""
    return called + b"\0" + IN_STEP + topic.encode()


def read_reply(frame: bytes) -> JoinReply:
    """The reply in a frame that begins with ``@``; ValueError if it is no reply."""
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
    """The epoch in a greeting; ValueError if it has the wrong length."""
    if len(rest) != _EPOCH.size:
        raise ValueError(f"a greeting must hold {_EPOCH.size} bytes, got {len(rest)}")
    epoch: int = _EPOCH.unpack(rest)[0]
    return epoch
