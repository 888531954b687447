"""A new node or driver of a user's own, from the template, with its test and its launch file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, NamedTuple

from palpate.launch.init_module import TEMPLATES, class_of, write_new
from palpate.launch.kinds import kinds
from palpate.launch.located import InputError
from palpate.messages.bus.place import LAUNCHER
from palpate.messages.types import TYPES

LONGEST_NAME = 32
"""Letters of a node's name in a graph."""


class Begun(NamedTuple):
    """The files of a new node."""

    module: Path
    """The node."""
    test: Path
    """What must hold of it."""
    launch: Path
    """A graph with it."""


def init_node(name: str, folder: Path, kind: Literal["node", "driver"]) -> Begun:
    """Write the module of a new node or driver, its test, and a launch file.

    Parameters
    ----------
    name : str
        The module's name, and the node's: lower case, with underscores, at most 32 letters.
    folder : Path
        Where to put them.
    kind : str
        ``node``, which hears and says something, or ``driver``, which says what a sensor feels.

    Raises
    ------
    InputError
        If the name cannot be a module's, or is taken, or a file cannot be written.
    """
    begun = Begun(folder / f"{name}.py", folder / f"test_{name}.py", folder / f"{name}.yaml")
    files = (f"{kind}.py", f"{kind}_check.py", f"{kind}.yaml")
    texts = [(TEMPLATES / file).read_text(encoding="utf-8") for file in files]
    taken = (*kinds(), LAUNCHER)
    cls = class_of(name, f"a {kind}", taken, begun.module, *texts, " ".join(TYPES))
    if len(name) > LONGEST_NAME:
        raise InputError(f"{name!r} is too long; a node's name has at most {LONGEST_NAME} letters")
    words = {
        f"Template of a {kind}:": f"The {kind} {name}:",
        f"palpate.launch.templates.{kind}": name,
        "Template": cls,
        "template": name,
    }
    for old, new in words.items():
        texts = [text.replace(old, new) for text in texts]
    texts = [_sorted_imports(text, name) for text in texts]
    write_new(dict(zip(begun, texts, strict=True)))
    return begun


def _sorted_imports(text: str, name: str) -> str:
    """The imports as they are sorted where palpate is somebody else's, and the module one's own."""
    text = re.sub(r"(from msgspec import .+\n)\n(from palpate)", r"\1\2", text)
    return re.sub(rf"(from {name} import .+\n)((?:from palpate.+\n)+)", r"\2\n\1", text)
