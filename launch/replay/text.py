"""What a replay came to, as lines for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from palpate.launch.replay.changes import FieldChange, Kind, Note
from palpate.launch.replay.comparison import TopicComparison
from palpate.launch.replay.exchange import Shortage
from palpate.launch.replay.player import Player

HEAD = ("topic", "field", "compared", "differ", "first", "largest", "rms", "unit", "")
LEFT = (0, 1, 7, 8)
"""Columns of texts; numbers stand to the right."""
UNITS = {"#": "count"}
WORDS: dict[Kind, str] = {
    "shape": "of another shape",
    "keys": "with other keys",
    "element": "elements changed",
    "value": "changed",
    "byte": "with other bytes",
}


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
        told = f"{_messages(fewer)} less on {topic} than recorded: {publisher} says no more"
    else:
        told = f"{_messages(more)} more on {topic}, after those recorded: {publisher} says more"
    return f"{', '.join(listeners)}: heard {told}"


def table(players: Sequence[Player]) -> Iterator[str]:
    """Lines of what has changed, by topic and field; none if nothing has."""
    rows = [row for player in players for one in player.says.values() for row in _rows(one)]
    if not rows:
        return
    rows.insert(0, HEAD)
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    for row in rows:
        cells = [
            cell.ljust(width) if i in LEFT else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  ".join(cells).rstrip()


def _rows(one: TopicComparison) -> Iterator[tuple[str, ...]]:
    for field, change in one.changes.fields.items():
        yield (one.topic, field, str(one.compared), *_cells(change))
    if one.fewer or one.more:
        told = f"{one.fewer} fewer" if one.fewer else f"{one.more} more"
        other = (str(one.compared), "", str(one.compared), "", "", "")
        yield (one.topic, "messages", *other, f"{told} than recorded")


def _cells(change: FieldChange) -> tuple[str, ...]:
    counts = (str(change.differ), str(change.first))
    notes = "; ".join(_note(kind, note) for kind, note in change.notes.items())
    if not change.numbers:
        return (*counts, "", "", "", notes)
    sizes = (f"{change.largest:.3g}", f"{change.rms:.3g}")
    return (*counts, *sizes, UNITS.get(change.unit, change.unit), notes)


def _note(kind: Kind, note: Note) -> str:
    return f"{note.count} {WORDS[kind]}, first {note.then} -> {note.now}"


def _messages(number: int) -> str:
    return f"{number} message{'s' if number > 1 else ''}"
