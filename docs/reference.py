"""Writes the reference of the names that users import, one page for each public room.

A hook of mkdocs: the pages are made while the site is built and stand in no folder. Which names a
room offers is read from its own list of exports, so that nothing has to be kept in step by hand.
"""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import griffe
from mkdocs.structure.files import File, Files

ROOMS = (
    "palpate",
    "palpate.shapes",
    "palpate.splines",
    "palpate.geometry",
    "palpate.touch",
    "palpate.effects",
    "palpate.planning",
    "palpate.procedures",
    "palpate.rebuild",
    "palpate.thesis",
    "palpate.messages",
    "palpate.messages.types",
    "palpate.messages.recording",
    "palpate.nodes",
    "palpate.launch",
    "palpate.testing",
)


COMMENT = re.compile(r"#\s*(.*)$")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages of the reference to those that are written by hand."""
    index = ["# Reference", "What users import, room by room.", "", "| room | what it is for |"]
    index.append("|---|---|")
    documented: set[str] = set()
    for room in ROOMS:
        title = (import_module(room).__doc__ or "").partition("\n")[0]
        index.append(f"| [{room}]({room}.md) | {title} |")
        text = page(room, documented)
        files.append(File.generated(config, f"reference/{room}.md", content=text))
    files.append(File.generated(config, "reference/index.md", content="\n".join(index) + "\n"))
    return files


def page(room: str, documented: set[str]) -> str:
    """The page of one room: its docstring, then every class and function that it exports."""
    module = import_module(room)
    parts = [f"# {room}", inspect.cleandoc(module.__doc__ or "")]
    for name in (name for name in dir(module) if not name.startswith("_")):
        found = getattr(module, name)
        if not (inspect.isclass(found) or inspect.isfunction(found)):
            continue
        place = f"{found.__module__}.{found.__qualname__}"
        if place in documented:
            parts.append(f"`{name}`: see [{place}][].")
        elif place.startswith("palpate."):
            documented.add(place)
            parts.append(f"::: {place}")
    return "\n\n".join(parts) + "\n"


class CommentsAsDocstrings(griffe.Extension):
    """Fields and constants are described by the comment behind them, or by those above."""

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Give an attribute without a docstring the comment that stands beside it."""
        if attr.docstring or not attr.lineno or not isinstance(attr.filepath, Path):
            return
        lines = attr.filepath.read_text(encoding="utf-8").splitlines()
        beside = COMMENT.search(lines[(attr.endlineno or attr.lineno) - 1])
        above: list[str] = []
        for line in reversed(lines[: attr.lineno - 1]):
            if not line.strip().startswith("#"):
                break
            above.insert(0, line.strip("# "))
        text = beside[1] if beside else " ".join(above)
        if text:
            attr.docstring = griffe.Docstring(text, parent=attr)
