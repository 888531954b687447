"""Damaged messages: bodies of all types, and the frames and words around them."""

from __future__ import annotations

import random
from functools import cache
from typing import Any, NamedTuple

import msgpack
import numpy as np

from palpate.launch.damage.any_message import any_message
from palpate.launch.damage.packed import damaged_body
from palpate.launch.damage.spans import damaged
from palpate.messages.bus import join
from palpate.messages.codec import encode, schema_hash
from palpate.messages.header import Header, pack_frame
from palpate.messages.types import TYPES

SHARE_OF_BODIES = 0.7
"""The others are frames and words."""
EXAMPLES = 3
"""Of each type."""


class Packet(NamedTuple):
    """Bytes as one of the readers gets them."""

    reader: str
    """Name of a message type, or ``frame``, ``answer``, ``request``, ``node``, ``launcher``."""
    data: bytes


def sound_packets() -> list[Packet]:
    """One of each kind, undamaged."""
    return [packet for packets in _examples().values() for packet in packets]


def damaged_packet(rng: random.Random) -> Packet:
    """One with damage, in its bytes or in its structure."""
    kinds = _examples()
    bodies = rng.random() < SHARE_OF_BODIES
    reader = rng.choice([name for name in kinds if (name in TYPES) == bodies])
    packet = rng.choice(kinds[reader])
    if (bodies or reader in ("node", "launcher")) and rng.random() < 0.6:
        return Packet(reader, damaged_body(rng, msgpack.unpackb(packet.data)))
    other = rng.choice(kinds[rng.choice(list(kinds))])
    return Packet(reader, damaged(rng, packet.data, other.data))


@cache
def _examples() -> dict[str, tuple[Packet, ...]]:
    rng = np.random.default_rng(1)
    found = {
        name: tuple(Packet(name, encode(any_message(cls, rng))) for _ in range(EXAMPLES))
        for name, cls in TYPES.items()
    }
    frame = pack_frame(
        "/touch/raw",
        Header(7, 1, 17, 10**15, 1.5, schema_hash(TYPES["TactileFrame"])),
        found["TactileFrame"][0].data,
    )
    call = join.call("finger_1/filter", 2, "simulator")
    words: dict[str, list[bytes]] = {
        "frame": [frame],
        "answer": [join.hello(call, 4), join.again(call, frame), join.in_step(call, "/touch/raw")],
        "request": [b"\x01" + call, b"\x01" + join.cursor(call, 3, "/touch/raw", 17)],
        "node": [msgpack.packb(word) for word in _NODE_WORDS],
        "launcher": [msgpack.packb(word) for word in _LAUNCHER_WORDS],
    }
    return found | {name: tuple(Packet(name, one) for one in all_) for name, all_ in words.items()}


_NODE_WORDS: tuple[dict[str, Any], ...] = (
    {"kind": "ready"},
    {"kind": "finished", "reason": "all felt"},
    {"kind": "failed", "text": "on /touch/raw 3: ValueError", "trace": "Traceback\n" * 20},
    {"kind": "bye", "status": bytes(40)},
    {
        "kind": "count",
        "round": 3,
        "sent": {"/touch/raw": 17, "/finger/goal": 18},
        "consumed": [["simulator", "/touch/raw", 17], ["tracer", "/finger/goal", 18]],
        "waits": ["/world"],
        "speaks": False,
    },
)
_LAUNCHER_WORDS: tuple[dict[str, Any], ...] = (
    {"kind": "go"},
    {"kind": "count", "round": 3},
    {"kind": "stop"},
)
