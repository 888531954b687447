"""Damaged messages: bodies of all types, and the frames and words around them."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable
from functools import cache
from types import NoneType
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import msgpack
import numpy as np

from palpate.launch.damage.packed import damaged_body
from palpate.launch.damage.spans import damaged
from palpate.messages.bus import join
from palpate.messages.codec import encode, schema_hash
from palpate.messages.header import Header, pack_frame
from palpate.messages.quantity import Array
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
        name: tuple(Packet(name, encode(_example(cls, rng))) for _ in range(EXAMPLES))
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


def _example(cls: type, rng: np.random.Generator) -> Any:
    """Some message of a type."""
    hints = get_type_hints(cls, include_extras=True)
    names = [field.name for field in dataclasses.fields(cls)]
    return cls(**{name: _value(hints[name], rng) for name in names})


def _value(hint: Any, rng: np.random.Generator) -> Any:
    for mark in getattr(hint, "__metadata__", ()):
        if isinstance(mark, Array):
            shape = [int(rng.integers(1, 5)) if n is None else n for n in mark.shape]
            return (3.0 * rng.normal(size=shape)).astype(mark.dtype)
    plain = get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
    origin, args = get_origin(plain), get_args(plain)
    if NoneType in args:
        return _value(args[0], rng) if rng.integers(4) else None
    if origin is Literal:
        return args[int(rng.integers(len(args)))]
    if origin is tuple:
        return tuple(_value(args[0], rng) for _ in range(int(rng.integers(0, 4))))
    if origin is dict:
        return {f"figure {i}": float(rng.normal()) for i in range(3)}
    return _PLAIN[plain](rng)


_PLAIN: dict[type, Callable[[np.random.Generator], Any]] = {
    bool: lambda rng: bool(rng.integers(2)),
    int: lambda rng: int(rng.integers(-(1 << 62), 1 << 62)),
    float: lambda rng: float(rng.normal()),
    str: lambda rng: "a reason, µm"[: int(rng.integers(1, 13))],
}
"""Values of fields without structure."""
