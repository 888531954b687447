"""Damage to what msgpack packs: a value of another type, length, depth or shape in one place."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import msgpack

from palpate.launch.damage.spans import FLOATS, NUMBERS
from palpate.launch.damage.trees import Tree, places, value_at, with_value

PREFIXES = tuple(
    bytes.fromhex(one)
    for one in (
        "dd ffffffff",
        "df ffffffff",
        "c6 ffffffff",
        "db ffffffff",
        "c9 ffffffff 01",
        "dc ffff",
        "de ffff",
        "da ffff",
        "dd 00100000",
        "c7 ff 05",
        "d4 01 00",
        "d6 ff 00000000",
        "d7 ff ffffffffffffffff",
        "c1",
        "c4 00",
        "cf ffffffffffffffff",
        "d3 8000000000000000",
        "cb 7ff0000000000000",
        "ca 7fc00000",
    )
)
"""Heads of values: lengths that nobody sent, extensions, what msgpack has no meaning for."""
DEEPEST = 2000
_MARK = "\0the place of the damage\0"


def damaged_body(rng: random.Random, body: Tree) -> bytes:
    """A value, packed, with one place of it damaged."""
    path = rng.choice(places(body))
    if rng.random() < 0.35:
        packed: bytes = msgpack.packb(with_value(body, path, _MARK))
        return packed.replace(msgpack.packb(_MARK), _raw(rng), 1)
    changed = rng.choice(CHANGES)(rng, value_at(body, path))
    data: bytes = msgpack.packb(with_value(body, path, changed))
    return data


def _raw(rng: random.Random) -> bytes:
    """Bytes that no packer makes."""
    if rng.random() < 0.7:
        return rng.choice(PREFIXES) + rng.randbytes(rng.choice((0, 0, 4, 16)))
    depth = rng.choice((2, 8, 9, 500, 1023, 1024, DEEPEST))
    if rng.random() < 0.5:
        return b"\x91" * depth + b"\xc0"
    return b"\x81\xa1a" * depth + b"\xc0"


def _other(rng: random.Random, _: Tree) -> Tree:
    """A value of some other type."""
    kinds: tuple[Tree, ...] = (
        None,
        True,
        rng.choice(NUMBERS),
        -(2**63),
        2**64 - 1,
        rng.choice(FLOATS),
        "",
        "x" * rng.choice((1, 40, 4096, 4097)),
        b"",
        rng.randbytes(rng.choice((1, 8, 56))),
        [],
        [None] * rng.choice((1, 3, 4097)),
        [[]] * rng.choice((1, 200, 4096)),
        {},
        {"a": {}},
        {b"a": 1},
        msgpack.ExtType(rng.randrange(128), rng.randbytes(rng.choice((0, 1, 8)))),
    )
    return rng.choice(kinds)


def _array(rng: random.Random, value: Tree) -> Tree:
    """An array with another dtype, shape or content; some other value where there is none."""
    if not isinstance(value, dict) or value.keys() != {"dtype", "shape", "data"}:
        return _other(rng, value)
    held: bytes = value["data"]
    count = max(len(held) // 8, 1)
    changes: tuple[Tree, ...] = (
        {"dtype": rng.choice(("<f8", ">f8", "<f4", "<i4", "|b1", "|u1", "|O", "<U9", "<M8", ""))},
        {"shape": value["shape"][::-1]},
        {"shape": [math.prod(value["shape"])]},
        {"shape": [*value["shape"], 1]},
        {"shape": [rng.choice(NUMBERS) for _ in value["shape"]]},
        {"shape": [0, 2**63 - 1]},
        {"shape": [0] * len(value["shape"]), "data": b""},
        {"shape": [-1, *value["shape"][1:]]},
        {"shape": [float(n) for n in value["shape"]]},
        {"data": held[:-1]},
        {"data": held + b"\0"},
        {"data": rng.randbytes(len(held))},
        {"data": b"\xff" * len(held)},
        {"data": held[: 8 * (count // 2)] + b"\0\0\0\0\0\0\xf0\x7f" + held[8 * (count // 2) + 8 :]},
        {"data": held.hex()},
        {"more": 1},
    )
    return {**value, **rng.choice(changes)}


def _longer(rng: random.Random, value: Tree) -> Tree:
    if isinstance(value, (str, bytes, list)):
        return value * rng.choice((2, 100))
    if isinstance(value, dict):
        return {**value, **{f"more {i}": i for i in range(rng.choice((1, 70)))}}
    return [value]


def _less(rng: random.Random, value: Tree) -> Tree:
    if isinstance(value, dict) and value:
        gone = rng.choice(list(value))
        return {key: item for key, item in value.items() if key != gone}
    return value[:-1] if isinstance(value, (str, bytes, list)) else None


def _renamed(rng: random.Random, value: Tree) -> Tree:
    if isinstance(value, dict) and value:
        old = rng.choice(list(value))
        new = rng.choice(("", f"{old} ", f"{old}"[::-1], "x" * 4096, "\0"))
        return {new if key == old else key: item for key, item in value.items()}
    return _other(rng, value)


CHANGES: tuple[Callable[[random.Random, Tree], Tree], ...] = (
    _other,
    _array,
    _array,
    _longer,
    _less,
    _renamed,
)
"""Ways to damage a value."""
