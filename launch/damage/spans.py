"""Damage to plain bytes: flipped, cut, inserted, deleted, doubled, spliced, overwritten."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable

NUMBERS = (0, 1, -1, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1)
"""At which integers of some width end."""
FLOATS = (0.0, -0.0, 1e-320, 1e30, -1e308, float("inf"), float("-inf"), float("nan"))
LONGEST = 64
"""Of a span that is inserted, deleted or doubled, but now and then."""


def damaged(rng: random.Random, data: bytes, other: bytes = b"") -> bytes:
    """Bytes with one to four kinds of damage.

    Parameters
    ----------
    rng : Random
        Chooses.
    data : bytes
        What is damaged.
    other : bytes
        Some other input, of which parts may be put in.
    """
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(KINDS)(rng, data, other)
    return data


def _flipped(rng: random.Random, data: bytes, other: bytes) -> bytes:
    hurt = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8)) if data else 0):
        hurt[rng.randrange(len(hurt))] ^= 1 << rng.randrange(8)
    return bytes(hurt)


def _replaced(rng: random.Random, data: bytes, other: bytes) -> bytes:
    hurt = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8)) if data else 0):
        hurt[rng.randrange(len(hurt))] = rng.randrange(256)
    return bytes(hurt)


def _cut(rng: random.Random, data: bytes, _: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _begun_late(rng: random.Random, data: bytes, _: bytes) -> bytes:
    return data[rng.randrange(len(data) + 1) :]


def _inserted(rng: random.Random, data: bytes, _: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(_length(rng)) + data[at:]


def _deleted(rng: random.Random, data: bytes, _: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at + _length(rng) :]


def _doubled(rng: random.Random, data: bytes, _: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    end = at + _length(rng)
    return data[:end] + data[at:]


def _spliced(rng: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def _overwritten(rng: random.Random, data: bytes, _: bytes) -> bytes:
    number = _number(rng)
    at = rng.randrange(max(len(data) - len(number), 0) + 1)
    return data[:at] + number + data[at + len(number) :]


def _number(rng: random.Random) -> bytes:
    """A number from a boundary, in some width and order."""
    order = rng.choice("<>")
    if rng.random() < 0.3:
        return struct.pack(order + "d", rng.choice(FLOATS))
    width = rng.choice((1, 2, 4, 8))
    number = rng.choice(NUMBERS) % (1 << 8 * width)
    return number.to_bytes(width, "little" if order == "<" else "big")


def _length(rng: random.Random) -> int:
    return rng.randint(1, LONGEST) if rng.random() < 0.95 else rng.randint(1, 100 * LONGEST)


KINDS: tuple[Callable[[random.Random, bytes, bytes], bytes], ...] = (
    _flipped,
    _replaced,
    _cut,
    _begun_late,
    _inserted,
    _deleted,
    _doubled,
    _spliced,
    _overwritten,
)
"""Ways to damage bytes."""
