"""What a recording holds, as lines for people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate.launch.bag.info import Info, Topic
from palpate.messages.recording.writer import MISSING

FEW = 12
"""Entries of a metadata record that are named one by one."""
HEAD = ("topic", "type", "publisher", "messages", "bytes", "share")


def info_text(info: Info) -> str:
    """All that is known of a recording, and a table of its topics."""
    lines = [
        *_parts(info),
        _line("version", info["version"] or "not known"),
        _line("closed", _closed(info)),
        _line("duration", f"{info['duration_s']:.3f} s"),
        _line("messages", str(info["messages"])),
        _line("nodes", ", ".join(info["nodes"]) or "not known"),
    ]
    for name, values in info["metadata"].items():
        if name == MISSING:
            values = {topic: lacks for topic, lacks in values.items() if lacks != "0"}
        lines.append(_line("metadata", f"{name}: {_entries(values)}"))
    return "\n".join([*lines, "", *_table([HEAD, *map(_row, info["topics"])])])


def size_text(size: int) -> str:
    """A number of bytes in the unit that suits it."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.1f} {unit}"
    return f"{size} B"


def _parts(info: Info) -> list[str]:
    names = [
        f"{part['path']}, {size_text(part['bytes'])}{'' if part['closed'] else ', not closed'}"
        for part in info["parts"]
    ]
    return [_line("" if number else "recording", name) for number, name in enumerate(names)]


def _closed(info: Info) -> str:
    end = info["end"]
    if end is None:
        return "yes"
    name = Path(end["path"]).name
    return f"no: {name} {end['why']}; {end['byte']} bytes of it are whole"


def _entries(values: dict[str, str | int]) -> str:
    if len(values) > FEW:
        return f"{len(values)} entries"
    return (
        "none"
        if not values
        else ", ".join(
            f"{name} of {value} characters" if isinstance(value, int) else f"{name} {value}"
            for name, value in values.items()
        )
    )


def _row(one: Topic) -> Sequence[str]:
    size, share = size_text(one["bytes"]), f"{100.0 * one['share']:.1f} %"
    return one["topic"], one["type"], one["publisher"], str(one["messages"]), size, share


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEAD))]
    return [
        "  ".join(
            cell.ljust(width) if column < 3 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _line(name: str, text: str) -> str:
    return f"{name:<10} {text}"
