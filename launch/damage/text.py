"""Damage to text of words and lines: hostile words, lines doubled, dropped and swapped."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

_WORD = re.compile(rb"[^\s,:\[\]{}]+")

WORDS: tuple[bytes, ...] = (
    b"nan",
    b"inf",
    b"-inf",
    b"-1",
    b"0",
    b"1e309",
    b"-1e308",
    b"1e-400",
    b"2000000000",
    b"4294967296",
    b"-9223372036854775808",
    b"9" * 30,
    b"9" * 5000,
    b"0x10",
    b"0x" + b"f" * 400,
    b"1_0",
    b"\xef\xbc\x91",  # a wide digit
    b"\xff\xfe",
    b"\x00",
    b"",
    b"-",
    b"1/2/3/4",
    b"null",
    b"true",
    b"x" * 300,
    b"\xef\xbb\xbf",  # a byte order mark
    b"\\",
    b"#",
)
"""Put in the place of words."""


def damaged_text(rng: random.Random, text: bytes, words: Sequence[bytes] = WORDS) -> bytes:
    """A text with one to three kinds of damage; `words` are put in the place of others."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        text = rng.choice(KINDS)(rng, text, words)
    return text


def _reworded(rng: random.Random, text: bytes, words: Sequence[bytes]) -> bytes:
    found = list(_WORD.finditer(text, *_stretch(rng, len(text))))
    if not found:
        return text + rng.choice(words)
    word = rng.choice(found)
    return text[: word.start()] + rng.choice(words) + text[word.end() :]


def _stretch(rng: random.Random, length: int) -> tuple[int, int]:
    """Some kB of a text, more often of its beginning, where headers are."""
    start = 0 if rng.random() < 0.4 else rng.randrange(length + 1)
    return start, start + 400


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
    """Other ends of lines, other blanks."""
    old, new = rng.choice(
        ((b"\n", b"\r\n"), (b"\n", b"\r"), (b" ", b"\t"), (b" ", b""), (b"\n", b"\n\n\n"))
    )
    return text.replace(old, new)


KINDS: tuple[Callable[[random.Random, bytes, Sequence[bytes]], bytes], ...] = (
    _reworded,
    _reworded,
    _reworded,
    _relined,
    _reblanked,
)
"""Ways to damage text."""
