"""A node, a driver, an effect or a planner of a user's own, written from its template."""

from __future__ import annotations

import keyword
import re
from collections.abc import Container
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from palpate.core.explore.planners import PLANNER_NAMES
from palpate.core.touch.effects import EFFECT_NAMES
from palpate.launch import list_kinds
from palpate.launch.files import InputError, write_new
from palpate.messages.bus import LAUNCHER
from palpate.messages.types import TYPES

MAX_NAME_LENGTH = 32  # Letters of a node's name in a graph
TEMPLATES = Path(__file__).parent / "templates"  # Working examples, one class Template each
_WORD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def begin(
    kind: Literal["node", "driver", "effect", "planner"],
    name: str,
    folder: Path,
    template: str = "",  # Which one, if not that of the kind's own name
) -> tuple[tuple[Path, ...], str]:
    """Write the module NAME.py and what belongs to it; returns the files, and ``module:Class``.

    A planner has a test, a node or a driver also a launch file. The name is lower case, with
    underscores, that of a node at most 32 letters long. Raises InputError if it cannot be a
    module's, or is taken, or a file cannot be written: then none is.
    """
    like = template or kind
    ends = [end for end in (".py", "_check.py", ".yaml") if (TEMPLATES / (like + end)).exists()]
    texts = [(TEMPLATES / (like + end)).read_text(encoding="utf-8") for end in ends]
    files = [folder / f"{name}{end}" for end in ends]
    if len(files) > 1:
        files[1] = folder / f"test_{name}.py"
    article, taken, known = f"a {kind}", (*list_kinds(), LAUNCHER), " ".join(TYPES)
    if kind in ("effect", "planner"):
        article, known = "an effect" if kind == "effect" else article, ""
        taken = EFFECT_NAMES if kind == "effect" else PLANNER_NAMES
    cls = class_name_of(name, article, taken, files[0], *texts, known)
    if kind in ("node", "driver") and len(name) > MAX_NAME_LENGTH:
        most = f"a node's name has at most {MAX_NAME_LENGTH} letters"
        raise InputError(f"{name!r} is too long; {most}")
    words = {
        f"Template of {article}:": f"The {kind} {name}:",
        f"palpate.tools.templates.{like}": name,
        "Template": cls,
        "template": name,
    }
    written = list[Path]()
    try:
        for path, text in zip(files, texts, strict=True):
            for old, new in words.items():
                text = text.replace(old, new)
            # The imports as they are sorted where palpate is somebody else's, and this is not.
            text = re.sub(r"(from msgspec import .+\n)\n(from palpate)", r"\1\2", text)
            text = re.sub(rf"(from palpate.+\n)(from {name} import .+\n)", r"\1\n\2", text)
            write_new(path, partial(Path.write_text, data=text, encoding="utf-8"))
            written.append(path)
    except InputError:
        for path in written:
            path.unlink()
        raise
    return tuple(files), f"{name}:{cls}"


def class_name_of(name: str, what: str, taken: Container[str], path: Path, *texts: str) -> str:
    """The class in a new module; raises InputError if that cannot be called so, or is taken."""
    if not _WORD.fullmatch(name) or keyword.iskeyword(name):
        raise InputError(f"{name!r} cannot name a module; take lower case letters, digits and _")
    if name in taken:
        raise InputError(f"{name!r} is {what} that palpate has; choose another name")
    if not path.exists() and find_spec(name) is not None:
        raise InputError(f"{name!r} is a module that Python has; choose another name")
    cls = "".join(part.capitalize() for part in name.split("_"))
    if keyword.iskeyword(cls) or any(re.search(rf"\b{cls}\b", text) for text in texts):
        raise InputError(f"the class {cls} of {name!r} has a meaning already; choose another name")
    return cls
