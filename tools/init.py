"""A node, a driver, an effect or a planner of a user's own, written from its template."""

from __future__ import annotations

import keyword
import re
from collections.abc import Container, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, NamedTuple

from palpate.core.explore.planners import PLANNER_NAMES
from palpate.core.touch.effects import EFFECT_NAMES
from palpate.launch import list_kinds
from palpate.launch.files import InputError
from palpate.messages.bus import LAUNCHER
from palpate.messages.types import TYPES

MAX_NAME_LENGTH = 32  # Letters of a node's name in a graph
# Working examples, each with one class called Template.
TEMPLATES = Path(__file__).parent / "templates"
_WORD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


class NodeFiles(NamedTuple):
    """The files of a new node."""

    module: Path  # The node
    test: Path  # What must hold of it
    launch: Path  # A graph with it


def init_node(name: str, folder: Path, kind: Literal["node", "driver"]) -> NodeFiles:
    """Write the module of a new node or driver, its test, and a launch file.

    `name`: the module's name, and the node's: lower case, with underscores, at most 32 letters;
    `folder`: where to put them; `kind`: ``node``, which receives and publishes, or ``driver``,
    which publishes a sensor's frames. Raises InputError if the name cannot be a module's, or is
    taken, or a file cannot be written.
    """
    begun = NodeFiles(folder / f"{name}.py", folder / f"test_{name}.py", folder / f"{name}.yaml")
    files = (f"{kind}.py", f"{kind}_check.py", f"{kind}.yaml")
    texts = [(TEMPLATES / file).read_text(encoding="utf-8") for file in files]
    taken = (*list_kinds(), LAUNCHER)
    cls = class_name_of(name, f"a {kind}", taken, begun.module, *texts, " ".join(TYPES))
    if len(name) > MAX_NAME_LENGTH:
        raise InputError(
            f"{name!r} is too long; a node's name has at most {MAX_NAME_LENGTH} letters"
        )
    words = {
        f"Template of a {kind}:": f"The {kind} {name}:",
        f"palpate.tools.templates.{kind}": name,
        "Template": cls,
        "template": name,
    }
    for old, new in words.items():
        texts = [text.replace(old, new) for text in texts]
    texts = [_sorted_imports(text, name) for text in texts]
    write_new_files(dict(zip(begun, texts, strict=True)))
    return begun


def _sorted_imports(text: str, name: str) -> str:
    """The imports as they are sorted where palpate is somebody else's, and the module one's own."""
    text = re.sub(r"(from msgspec import .+\n)\n(from palpate)", r"\1\2", text)
    return re.sub(rf"(from palpate.+\n)(from {name} import .+\n)", r"\1\n\2", text)


def init_effect(name: str, folder: Path) -> tuple[Path, str]:
    """Write the module of a new effect.

    Returns `path`: the new file; `listed`: how a scene lists the effect. Raises InputError if the
    name cannot be a module's, or is taken, or the file cannot be written.
    """
    path = folder / f"{name}.py"
    text = (TEMPLATES / "effect.py").read_text(encoding="utf-8")
    cls = class_name_of(name, "an effect", EFFECT_NAMES, path, text)
    text = text.replace("Template of an effect: mains hum", f"The effect {name}: mains hum")
    text = text.replace("template:Template", f"{name}:{cls}").replace("Template", cls)
    write_new_files({path: text})
    return path, f"{name}:{cls}"


def init_planner(name: str, folder: Path) -> tuple[Path, Path, str]:
    """Write the module of a new planner, and its test.

    Returns `path`: the new module; `test`: its test; `named`: how a scene names the planner. Raises
    InputError if the name cannot be a module's, or is taken, or a file cannot be written.
    """
    path, test = folder / f"{name}.py", folder / f"test_{name}.py"
    rule, check = (
        (TEMPLATES / file).read_text(encoding="utf-8")
        for file in ("planner.py", "planner_check.py")
    )
    cls = class_name_of(name, "a planner", PLANNER_NAMES, path, rule, check)
    named = f"{name}:{cls}"
    rule = rule.replace("Template of a planner: first", f"The planner {name}: first")
    rule = rule.replace("template:Template", named).replace("Template", cls)
    check = check.replace("palpate.tools.templates.planner", name).replace("Template", cls)
    write_new_files({path: rule, test: check})
    return path, test, named


def class_name_of(name: str, what: str, taken: Container[str], path: Path, *texts: str) -> str:
    """The class in a new module.

    Raises InputError if the name cannot be a module's, or is taken.
    """
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


def write_new_files(texts: Mapping[Path, str]) -> None:
    """Write files that are not there yet: all of them, or none.

    Raises InputError if one of them is there already, or cannot be written.
    """
    written = list[Path]()
    for path, text in texts.items():
        try:
            with path.open("x", encoding="utf-8") as file:
                written.append(path)
                file.write(text)
        except OSError as error:
            for part in written:
                part.unlink()
            if isinstance(error, FileExistsError):
                raise InputError(f"{path}: is there already; choose another name") from None
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
