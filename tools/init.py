"""A new node, driver, filter, effect or planner of a user, written from a template."""

from __future__ import annotations

import keyword
import re
from collections.abc import Container, Mapping, Sequence
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

MAX_NAME_LENGTH = 32  # letters of a node's name in a graph
TEMPLATES = Path(__file__).parent / "templates"  # working examples, one class Template each
# Sources of the filter's node and of its steps, and the names that the node imports of these.
FILTER, FILTER_STEPS = (Path(str(getsourcefile(module))) for module in (filter_node, clean))
STEP_NAMES = ("FilterOrder", "clean")
_WORD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def begin(
    kind: Literal["node", "driver", "effect", "filter", "planner"],
    name: str,
    folder: Path,
    template: str = "",  # name of a template, if not that of the kind
) -> tuple[tuple[Path, ...], str]:
    """Write the module NAME.py and its files; returns their paths, and ``module:Class``.

    All kinds have a test; a node, driver or filter also has a launch file, and a filter a copy of
    palpate's steps. The name is lower case with underscores, at most 32 letters for a node. Raises
    InputError if the name cannot be that of a module, or is taken, or a file cannot be written:
    then no file is left.
    """
    like = template or kind
    texts = {
        folder / form.format(name): path.read_text(encoding="utf-8")
        for form, path in _template_files(like).items()
    }
    article = "an effect" if kind == "effect" else f"a {kind}"
    cls = _checked_class(kind, name, article, folder / f"{name}.py", tuple(texts.values()))
    words = {
        f"Template of {article}:": f"The {kind} {name}:",
        f"palpate.tools.templates.{like}": name,
        "Template": cls,
        "template": name,
    }
    written = list[Path]()
    try:
        for path, text in texts.items():
            text = _filled_in(text, name, words, own_steps=kind == "filter")
            write_new(path, partial(Path.write_text, data=text, encoding="utf-8"))
            written.append(path)
    except InputError:
        for path in written:
            path.unlink()
        raise
    return tuple(texts), f"{name}:{cls}"


def _checked_class(kind: str, name: str, article: str, path: Path, texts: Sequence[str]) -> str:
    """Name of the class in a new module; raises InputError if the name of the module is no good."""
    if kind in ("effect", "planner"):
        taken = EFFECT_NAMES if kind == "effect" else PLANNER_NAMES
        return class_name_of(name, article, taken, path, *texts)
    taken = (*list_kinds(), LAUNCHER)
    cls = class_name_of(name, article, taken, path, *texts, " ".join(TYPES))
    if len(name) > MAX_NAME_LENGTH:
        limit = f"a node's name has at most {MAX_NAME_LENGTH} letters"
        raise InputError(f"{name!r} is too long; {limit}")
    return cls


def _filled_in(text: str, name: str, words: Mapping[str, str], *, own_steps: bool) -> str:
    """A template with the names of a new module."""
    if own_steps:
        text = _with_own_steps(text, name)
    for old, new in words.items():
        text = text.replace(old, new)
    return _with_imports_apart(text, name)


def _template_files(like: str) -> dict[str, Path]:
    """Paths of templates by the names of the files that are written; {} is the module's name."""
    forms = {"{}.py": ".py", "test_{}.py": "_check.py", "{}.yaml": ".yaml"}
    paths = {form: TEMPLATES / f"{like}{end}" for form, end in forms.items()}
    if like == "filter":  # the shipped filter is its own template
        paths["{}.py"], paths["{}_steps.py"] = FILTER, FILTER_STEPS
    return {form: path for form, path in paths.items() if path.exists()}


def _with_own_steps(text: str, name: str) -> str:
    """The filter, or its test, importing the copied steps instead of palpate's."""

    def divided(match: re.Match[str]) -> str:
        imported = match[1].split(", ")
        lines = (
            ("palpate.core.touch", [part for part in imported if part not in STEP_NAMES]),
            (f"{name}_steps", [part for part in imported if part in STEP_NAMES]),
        )
        return "".join(f"from {module} import {', '.join(parts)}\n" for module, parts in lines)

    text = re.sub(r"from palpate\.core\.touch import (.*\bclean)\n", divided, text)
    text = text.replace("from palpate.nodes.filter import", f"from {name} import")
    return text.replace('"""Filter node:', f'"""The filter {name}:')


def _with_imports_apart(text: str, name: str) -> str:
    """Imports sorted as in a project where palpate is foreign, and the new module is not."""
    foreign = r"((?:from|import) (?:msgspec|numpy|pytest)\b.*\n)"
    text = re.sub(rf"{foreign}\n(from palpate)", r"\1\2", text)
    ours = re.compile(rf"^from {name}(?:_steps)? import .+\n", re.MULTILINE)
    rest = ours.sub("", text)
    palpate = re.compile(r"^from palpate\S* import (?:\([^)]*\)|.+)\n", re.MULTILINE)
    end = max((match.end() for match in palpate.finditer(rest)), default=0)
    own = "".join(sorted(ours.findall(text)))
    return f"{rest[:end]}\n{own}{rest[end:]}" if own and end else text


def class_name_of(name: str, what: str, taken: Container[str], path: Path, *texts: str) -> str:
    """Name of the class in a new module; raises InputError if either name is bad or taken."""
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
