from __future__ import annotations

import random

import pytest

from palpate.launch.damage import spans, text
from palpate.launch.damage.spans import damaged
from palpate.launch.damage.text import damaged_text

DATA, OTHER = bytes(range(200)), b"x" * 50


def test_the_same_seed_gives_the_same_damage() -> None:
    first = [damaged(random.Random(f"a {i}"), DATA, OTHER) for i in range(50)]

    assert [damaged(random.Random(f"a {i}"), DATA, OTHER) for i in range(50)] == first
    assert len(set(first)) > 40


@pytest.mark.parametrize("kind", spans.KINDS)
def test_every_kind_of_damage_hurts_bytes_and_bears_none(kind: object) -> None:
    results = {kind(random.Random(i), DATA, OTHER) for i in range(20)}  # type: ignore[operator]

    assert results - {DATA}
    assert isinstance(kind(random.Random(1), b"", b""), bytes)  # type: ignore[operator]


@pytest.mark.parametrize("kind", set(text.KINDS))
def test_every_kind_of_damage_hurts_text_and_bears_none(kind: object) -> None:
    lines = b"".join(b"vertex %d 2.5 x\n" % i for i in range(20))
    results = {kind(random.Random(i), lines, text.WORDS) for i in range(20)}  # type: ignore[operator]

    assert results - {lines}
    assert isinstance(kind(random.Random(1), b"", text.WORDS), bytes)  # type: ignore[operator]


def test_hostile_words_come_into_a_text() -> None:
    hurt = [damaged_text(random.Random(i), b"element vertex 12\n" * 5) for i in range(60)]

    assert any(b"nan" in one for one in hurt)
    assert any(b"2000000000" in one for one in hurt)
