"""What a replay came to, as lines for people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from palpate.launch.replay.changes import FieldChange, Kind, Note
from palpate.launch.replay.comparison import TopicComparison
from palpate.launch.replay.exchange import Shortage
from palpate.launch.replay.player import Player

COUNTS = ("topic", "field", "compared", "differ", "first")
SIZES = ("largest", "rms", "unit")
LEFT = ("topic", "field", "unit")
"""Columns of texts; numbers stand to the right."""
UNITS = {"#": "count"}
WORDS: dict[Kind, str] = {
    "shape": "of another shape",
    "keys": "with other keys",
    "element": "elements changed",
    "value": "changed",
    "byte": "with other bytes",
}


class _Row(NamedTuple):
    """What is told of one field; where it has no size, the note stands in its place."""

    counts: tuple[str, ...]
    sizes: tuple[str, ...] = ()
    note: str = ""


def verdict(player: Player) -> str:
    """One line on a node: identical, its first difference, or how it failed."""
    if player.failure:
        return f"{player.name}: fails, {player.failure}"
    if player.first:
        return f"{player.name}: differs, {player.first}"
    counts = ", ".join(f"{one.compared} on {topic}" for topic, one in player.says.items())
    return f"{player.name}: identical, {counts or 'nothing said'}"


def shortage_text(shortage: Shortage) -> str:
    """One line on a topic of which another number was heard than had been recorded."""
    topic, publisher, listeners, fewer, more = shortage
    if fewer:
        told = f"{_messages(fewer, 'fewer')} on {topic} than recorded: {publisher} says no more"
    else:
        told = f"{_messages(more, 'more')} on {topic}, after those recorded: {publisher} says more"
    return f"{', '.join(listeners)}: heard {told}"


def table(players: Sequence[Player]) -> Iterator[str]:
    """Lines of what has changed, by topic and field; none if nothing has."""
    rows = [row for player in players for one in player.says.values() for row in _rows(one)]
    if not rows:
        return
    rows.insert(0, _Row(COUNTS, SIZES))
    counts, sizes = _widths(row.counts for row in rows), _widths(row.sizes for row in rows)
    for row in rows:
        cells = (*_aligned(COUNTS, row.counts, counts), *_aligned(SIZES, row.sizes, sizes))
        yield "  ".join((*cells, row.note)).rstrip()


def _rows(one: TopicComparison) -> Iterator[_Row]:
    for field, change in one.changes.fields.items():
        counts = (str(one.compared), str(change.differ), str(change.first))
        notes = "; ".join(_note(kind, note) for kind, note in change.notes.items())
        yield _Row((one.topic, field, *counts), _sizes(change), notes)
    if one.fewer or one.more:
        told = f"{one.fewer} fewer" if one.fewer else f"{one.more} more"
        counts = (str(one.compared), "", str(one.compared))
        yield _Row((one.topic, "messages", *counts), note=f"{told} than recorded")


def _sizes(change: FieldChange) -> tuple[str, ...]:
    if not change.numbers:
        return ()
    unit = UNITS.get(change.unit, change.unit)
    return (f"{change.largest:.3g}", f"{change.rms:.3g}", unit)


def _widths(rows: Iterable[tuple[str, ...]]) -> list[int]:
    """Width of each column; rows may be empty."""
    return [max(map(len, column)) for column in zip(*filter(None, rows), strict=True)]


def _aligned(heads: tuple[str, ...], row: tuple[str, ...], widths: Sequence[int]) -> Iterator[str]:
    for head, cell, width in zip(heads, row, widths, strict=False):
        yield cell.ljust(width) if head in LEFT else cell.rjust(width)


def _note(kind: Kind, note: Note) -> str:
    return f"{note.count} {WORDS[kind]}, first {note.then} -> {note.now}"


def _messages(number: int, which: str) -> str:
    return f"{number} {which} message{'s' if number > 1 else ''}"
