"""A node, a driver, a filter, an effect or a planner of a user's own, written from its template."""

from __future__ import annotations

import keyword
import re
from collections.abc import Container
from functools import partial
from importlib.util import find_spec
from inspect import getsourcefile
from pathlib import Path
from typing import Literal

from palpate.core.explore.planners import PLANNER_NAMES
from palpate.core.touch import clean
from palpate.core.touch.effects import EFFECT_NAMES
from palpate.launch.files.file_access import write_new
from palpate.launch.files.source_map import InputError
from palpate.launch.node_kinds import list_kinds
from palpate.messages.bus import LAUNCHER
from palpate.messages.types import TYPES
from palpate.nodes import filter as filter_node

MAX_NAME_LENGTH = 32  # Letters of a node's name in a graph
TEMPLATES = Path(__file__).parent / "templates"  # Working examples, one class Template each
# The filter's node and its steps, and what the node takes of them
FILTER, FILTER_STEPS = (Path(str(getsourcefile(one))) for one in (filter_node, clean))
STEP_NAMES = ("FilterOrder", "clean")
_WORD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def begin(
    kind: Literal["node", "driver", "effect", "filter", "planner"],
    name: str,
    folder: Path,
    template: str = "",  # Which one, if not that of the kind's own name
) -> tuple[tuple[Path, ...], str]:
    """Write the module NAME.py and what belongs to it; returns the files, and ``module:Class``.

    A test comes with it; with a node, driver or filter also a launch file, and with a filter the
    steps of palpate's own. The name is lower case, with underscores, that of a node at most 32
    letters long. Raises InputError if it cannot be a module's, or is taken, or a file cannot be
    written: then none is.
    """
    like = template or kind
    texts = {
        folder / form.format(name): path.read_text(encoding="utf-8")
        for form, path in _parts(like).items()
    }
    article, taken, known = f"a {kind}", (*list_kinds(), LAUNCHER), " ".join(TYPES)
    if kind in ("effect", "planner"):
        article, known = "an effect" if kind == "effect" else article, ""
        taken = EFFECT_NAMES if kind == "effect" else PLANNER_NAMES
    cls = class_name_of(name, article, taken, folder / f"{name}.py", *texts.values(), known)
    if known and len(name) > MAX_NAME_LENGTH:
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
        for path, text in texts.items():
            if kind == "filter":
                text = _with_own_steps(text, name)
            for old, new in words.items():
                text = text.replace(old, new)
            text = _with_imports_apart(text, name)
            write_new(path, partial(Path.write_text, data=text, encoding="utf-8"))
            written.append(path)
    except InputError:
        for path in written:
            path.unlink()
        raise
    return tuple(texts), f"{name}:{cls}"


def _parts(like: str) -> dict[str, Path]:
    """What is written, by the form of its name, and from what."""
    forms = {"{}.py": ".py", "test_{}.py": "_check.py", "{}.yaml": ".yaml"}
    found = {form: TEMPLATES / f"{like}{end}" for form, end in forms.items()}
    if like == "filter":  # palpate's own is the template, so that the copy is what is shipped
        found["{}.py"], found["{}_steps.py"] = FILTER, FILTER_STEPS
    return {form: path for form, path in found.items() if path.exists()}


def _with_own_steps(text: str, name: str) -> str:
    """A module of palpate's filter, or its test, with the copied steps in place of palpate's."""

    def divided(found: re.Match[str]) -> str:
        names = found[1].split(", ")
        lines = (
            ("palpate.core.touch", [one for one in names if one not in STEP_NAMES]),
            (f"{name}_steps", [one for one in names if one in STEP_NAMES]),
        )
        return "".join(f"from {where} import {', '.join(what)}\n" for where, what in lines)

    text = re.sub(r"from palpate\.core\.touch import (.*\bclean)\n", divided, text)
    text = text.replace("from palpate.nodes.filter import", f"from {name} import")
    return text.replace('"""Filter node:', f'"""The filter {name}:')


def _with_imports_apart(text: str, name: str) -> str:
    """The imports as they are sorted where palpate is somebody else's, and this is not."""
    foreign = r"((?:from|import) (?:msgspec|numpy|pytest)\b.*\n)"
    text = re.sub(rf"{foreign}\n(from palpate)", r"\1\2", text)
    ours = re.compile(rf"^from {name}(?:_steps)? import .+\n", re.MULTILINE)
    rest = ours.sub("", text)
    palpate = re.compile(r"^from palpate\S* import (?:\([^)]*\)|.+)\n", re.MULTILINE)
    place = max((found.end() for found in palpate.finditer(rest)), default=0)
    own = "".join(sorted(ours.findall(text)))
    return f"{rest[:place]}\n{own}{rest[place:]}" if own and place else text


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
