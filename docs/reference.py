"""Writes the reference of the names that users import, one page for each public room, and settings.

A hook of mkdocs: the pages are made while the site is built and stand in no folder. Which names a
room offers is read from its own list of exports, so that nothing has to be kept in step by hand.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator, Sequence
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
    index.append("| [settings](settings.md) | every number that is tuned |")
    files.append(File.generated(config, "reference/settings.md", content=settings_page()))
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


ROOT = Path(__file__).resolve().parent.parent
TUNED = ("core", "nodes", "launch", "tools", "messages")
UNIT = re.compile(r"^\[([^\]]+)\]\s*")


def settings_page() -> str:
    """All that is tuned: parameters of nodes, which `--set` reaches, and settings of algorithms."""
    parts = [
        "# Settings",
        "`palpate run SCENE --set node.parameter=value` changes a parameter of a node. Settings of "
        "algorithms are arguments of the functions beside them.",
    ]
    for title, folders, name in (
        ("Parameters of nodes", ("nodes",), "Params"),
        ("Settings of algorithms", TUNED, "Settings"),
    ):
        parts.append(f"## {title}")
        for path in sorted(file for folder in folders for file in (ROOT / folder).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            for node in ast.parse(source).body:
                if isinstance(node, ast.ClassDef) and node.name.endswith(name):
                    place = path.relative_to(ROOT).as_posix()
                    head = path.stem if name == "Params" else node.name
                    parts.append(f"### {head}\n\n`{place}`. {ast.get_docstring(node) or ''}")
                    parts.append("\n".join(_rows(node, source)))
    return "\n\n".join(parts) + "\n"


def _rows(settings: ast.ClassDef, source: str) -> Iterator[str]:
    """A table of a class's fields: default, unit and meaning."""
    yield from ("| name | default | unit | meaning |", "|---|---|---|---|")
    for field in settings.body:
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            value = field.value and ast.get_source_segment(source, field.value)
            default = f"`{value}`" if value else ""
            last = field.end_lineno or field.lineno
            meaning = comment_of(field.lineno, last, source.splitlines())
            unit = UNIT.match(meaning)
            cells = (default, unit[1] if unit else "", UNIT.sub("", meaning))
            row = " | ".join(cell.replace("|", "\\|") for cell in cells)
            yield f"| `{field.target.id}` | {row} |"


class CommentsAsDocstrings(griffe.Extension):
    """Fields and constants are described by the comment behind them, or by those above."""

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Give an attribute without a docstring the comment that stands beside it."""
        if attr.docstring or not attr.lineno or not isinstance(attr.filepath, Path):
            return
        lines = attr.filepath.read_text(encoding="utf-8").splitlines()
        text = comment_of(attr.lineno, attr.endlineno or attr.lineno, lines)
        if text:
            attr.docstring = griffe.Docstring(text, parent=attr)


def comment_of(first: int, last: int, lines: Sequence[str]) -> str:
    """The comment behind the statement on these lines, counted from 1, or else the one above it."""
    behind = COMMENT.search(lines[last - 1])
    if behind:
        return behind[1]
    above: list[str] = []
    for line in reversed(lines[: first - 1]):
        if not line.strip().startswith("#"):
            break
        above.insert(0, line.strip("# "))
    return " ".join(above)
