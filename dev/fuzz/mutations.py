"""Damage to bytes, texts, trees of values, and packed msgpack."""

from __future__ import annotations

import math
import random
import re
import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import msgpack

# At and beside the limits of integers of some width.
BOUNDARY_NUMBERS = (
    0,
    1,
    -1,
    127,
    128,
    255,
    256,
    2**15,
    2**16 - 1,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63 - 1,
)
BOUNDARY_FLOATS = (0.0, -0.0, 1e-320, 1e30, -1e308, float("inf"), float("-inf"), float("nan"))
_WORD = re.compile(rb"[^\s,:\[\]{}]+")
# Replacements of words.
HOSTILE_WORDS: tuple[bytes, ...] = (
    *b"nan inf -inf -1 0 1e309 -1e308 1e-400 2000000000 4294967296 -9223372036854775808".split(),
    *(b"9" * 30, b"9" * 5000, b"0x10", b"0x" + b"f" * 400, b"1_0"),
    b"\xef\xbc\x91",  # a wide digit
    *(b"\xff\xfe", b"\x00", b"", b"-", b"1/2/3/4", b"null", b"true", b"x" * 300),
    b"\xef\xbb\xbf",  # a byte order mark
    *(b"\\", b"#"),
)
# Heads of values: lengths without content, extensions, and codes without meaning in msgpack.
_PREFIXES = """\
ddffffffff dfffffffff c6ffffffff dbffffffff c9ffffffff01 dcffff deffff daffff dd00100000
c7ff05 d40100 d6ff00000000 d7ffffffffffffffffff c1 c400 cfffffffffffffffff d38000000000000000
cb7ff0000000000000 ca7fc00000"""
PREFIXES = tuple(bytes.fromhex(code) for code in _PREFIXES.split())
_MARK = "\0the place of the damage\0"
Tree = Any  # Maps, lists, texts, bytes and numbers
TreePath = tuple[str | int, ...]


def mutate_bytes(rng: random.Random, data: bytes, other: bytes = b"") -> bytes:
    """Bytes with one to four kinds of damage; parts of an `other` input may be inserted."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(BYTE_MUTATIONS)(rng, data, other)
    return data


def mutate_text(rng: random.Random, text: bytes, words: Sequence[bytes] = HOSTILE_WORDS) -> bytes:
    """A text with one to three kinds of damage; some replace a word by one of `words`."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        text = rng.choice(TEXT_MUTATIONS)(rng, text, words)
    return text


def mutate_body(rng: random.Random, body: Tree) -> bytes:
    """A packed value with damage in one place."""
    path = rng.choice(tree_paths(body))
    if rng.random() < 0.35:
        packed: bytes = msgpack.packb(with_value(body, path, _MARK))
        return packed.replace(msgpack.packb(_MARK), _raw(rng), 1)
    changed = rng.choice(VALUE_MUTATIONS)(rng, value_at(body, path))
    data: bytes = msgpack.packb(with_value(body, path, changed))
    return data


def _raw(rng: random.Random) -> bytes:
    """Bytes that a packer does not produce."""
    if rng.random() < 0.7:
        return rng.choice(PREFIXES) + rng.randbytes(rng.choice((0, 0, 4, 16)))
    depth = rng.choice((2, 8, 9, 500, 1023, 1024, 2000))
    if rng.random() < 0.5:
        return b"\x91" * depth + b"\xc0"
    return b"\x81\xa1a" * depth + b"\xc0"


def tree_paths(tree: Tree, path: TreePath = (), max_entries: int = 8) -> list[TreePath]:
    """Paths of a value and of all values inside; of lists only the first entries."""
    paths: list[TreePath] = [path]
    if isinstance(tree, dict):
        for key, item in tree.items():
            paths += tree_paths(item, (*path, key), max_entries)
    elif isinstance(tree, list):
        for i, item in enumerate(tree[:max_entries]):
            paths += tree_paths(item, (*path, i), max_entries)
    return paths


def value_at(tree: Tree, path: TreePath) -> Tree:
    """The value at a path."""
    for key in path:
        tree = tree[key]
    return tree


def with_value(tree: Tree, path: TreePath, new: Tree) -> Tree:
    """The tree with another value at a path."""
    if not path:
        return new
    if isinstance(tree, dict):
        return {**tree, path[0]: with_value(tree[path[0]], path[1:], new)}
    return [with_value(v, path[1:], new) if i == path[0] else v for i, v in enumerate(tree)]


class InputFile(NamedTuple):
    """A file to read."""

    name: str
    data: bytes


def _changed(flip: bool, rng: random.Random, data: bytes, _: bytes) -> bytes:
    """Some bytes with one bit flipped, or replaced."""
    damaged = bytearray(data)
    for _i in range(rng.choice((1, 1, 2, 8)) if data else 0):
        new = 0 if flip else rng.randrange(256)
        at = rng.randrange(len(damaged))
        damaged[at] = damaged[at] ^ 1 << rng.randrange(8) if flip else new
    return bytes(damaged)


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


def _length(rng: random.Random, max_usual: int = 64) -> int:
    """Length of a span that is inserted, deleted or doubled; rarely a long one."""
    return rng.randint(1, max_usual * (1 if rng.random() < 0.95 else 100))


def _overwritten(rng: random.Random, data: bytes, _: bytes) -> bytes:
    """A boundary number of some width and byte order, over other bytes."""
    order: Literal["little", "big"] = "little" if rng.choice("<>") == "<" else "big"
    if rng.random() < 0.3:
        number = struct.pack("<d" if order == "little" else ">d", rng.choice(BOUNDARY_FLOATS))
    else:
        width = rng.choice((1, 2, 4, 8))
        number = (rng.choice(BOUNDARY_NUMBERS) % (1 << 8 * width)).to_bytes(width, order)
    at = rng.randrange(max(len(data) - len(number), 0) + 1)
    return data[:at] + number + data[at + len(number) :]


def _reworded(rng: random.Random, text: bytes, words: Sequence[bytes]) -> bytes:
    """Another match in a part of a text, more often in its beginning, where headers are."""
    start = 0 if rng.random() < 0.4 else rng.randrange(len(text) + 1)
    matches = list(_WORD.finditer(text, start, start + 400))
    if not matches:
        return text + rng.choice(words)
    match = rng.choice(matches)
    return text[: match.start()] + rng.choice(words) + text[match.end() :]


def _relined(rng: random.Random, text: bytes, _: Sequence[bytes]) -> bytes:
    lines = text.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            del lines[at]
        case 1:
            lines.insert(other, lines[at])
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case 3:
            lines[at] = lines[at] + b" " + lines[other]
        case _:
            lines[at:at] = lines[at : at + 1] * rng.choice((2, 50, 2000))
    return b"\n".join(lines)


def _reblanked(rng: random.Random, text: bytes, _: Sequence[bytes]) -> bytes:
    """Other ends of lines or other blanks."""
    old, new = rng.choice(
        ((b"\n", b"\r\n"), (b"\n", b"\r"), (b" ", b"\t"), (b" ", b""), (b"\n", b"\n\n\n"))
    )
    return text.replace(old, new)


def _other(rng: random.Random, _: Tree) -> Tree:
    """A value of another type."""
    number, float_ = rng.choice(BOUNDARY_NUMBERS), rng.choice(BOUNDARY_FLOATS)
    text, data = "x" * rng.choice((1, 40, 4096, 4097)), rng.randbytes(rng.choice((1, 8, 56)))
    nothing: Tree = [None] * rng.choice((1, 3, 4097))
    nested: Tree = [[]] * rng.choice((1, 200, 4096))
    own = msgpack.ExtType(rng.randrange(128), rng.randbytes(rng.choice((0, 1, 8))))
    maps: tuple[Tree, ...] = ({}, {"a": {}}, {b"a": 1}, own)
    lists: tuple[Tree, ...] = ([], nothing, nested, *maps)
    return rng.choice(
        (None, True, number, -(2**63), 2**64 - 1, float_, "", text, b"", data, *lists)
    )


def _damaged_array(rng: random.Random, value: Tree) -> Tree:
    """An array with another dtype, shape or content; another value in place of other types."""
    if not isinstance(value, dict) or value.keys() != {"dtype", "shape", "data"}:
        return _other(rng, value)
    data: bytes = value["data"]
    count = max(len(data) // 8, 1)
    half, shape = 8 * (count // 2), value["shape"]
    dtypes = "<f8", ">f8", "<f4", "<i4", "|b1", "|u1", "|O", "<U9", "<M8", ""
    changes: tuple[Tree, ...] = (
        {"dtype": rng.choice(dtypes)},
        *({"shape": shape[::-1]}, {"shape": [math.prod(shape)]}, {"shape": [*shape, 1]}),
        {"shape": [rng.choice(BOUNDARY_NUMBERS) for _ in shape]},
        *({"shape": [0, 2**63 - 1]}, {"shape": [0] * len(shape), "data": b""}),
        *({"shape": [-1, *shape[1:]]}, {"shape": [float(n) for n in shape]}),
        *({"data": data[:-1]}, {"data": data + b"\0"}, {"data": rng.randbytes(len(data))}),
        {"data": b"\xff" * len(data)},
        {"data": data[:half] + b"\0\0\0\0\0\0\xf0\x7f" + data[half + 8 :]},
        *({"data": data.hex()}, {"more": 1}),
    )
    return {**value, **rng.choice(changes)}


def _lengthened(rng: random.Random, value: Tree) -> Tree:
    if isinstance(value, (str, bytes, list)):
        return value * rng.choice((2, 100))
    if isinstance(value, dict):
        return {**value, **{f"more {i}": i for i in range(rng.choice((1, 70)))}}
    return [value]


def _shortened(rng: random.Random, value: Tree) -> Tree:
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


# Kinds of damage; frequent ones are repeated.
BYTE_MUTATIONS: tuple[Callable[[random.Random, bytes, bytes], bytes], ...] = (
    *(partial(_changed, True), partial(_changed, False)),
    lambda rng, data, _: data[: rng.randrange(len(data) + 1)],
    lambda rng, data, _: data[rng.randrange(len(data) + 1) :],
    *(_inserted, _deleted, _doubled),
    lambda rng, data, other: (
        data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]
    ),
    _overwritten,
)
TEXT_MUTATIONS: tuple[Callable[[random.Random, bytes, Sequence[bytes]], bytes], ...] = (
    *(_reworded, _reworded, _reworded, _relined, _reblanked),
)
VALUE_MUTATIONS: tuple[Callable[[random.Random, Tree], Tree], ...] = (
    *(_other, _damaged_array, _damaged_array, _lengthened, _shortened, _renamed),
)
