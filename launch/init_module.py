"""A module of a user's own: what it may be called, and how it is written."""

from __future__ import annotations

import keyword
import re
from collections.abc import Container, Mapping
from importlib.util import find_spec
from pathlib import Path

from palpate.launch.located import InputError

TEMPLATES = Path(__file__).parent / "templates"
"""Working examples, each with one class called Template."""
_WORD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def class_of(name: str, what: str, taken: Container[str], path: Path, *texts: str) -> str:
    """The class in a new module.

    Parameters
    ----------
    name : str
        The module's name: lower case, with underscores.
    what : str
        What it is, with its article.
    taken : container of str
        Names that palpate has given to others.
    path : Path
        Where the module will lie.
    texts : str
        What will be written, in which the class must have no other meaning.

    Raises
    ------
    InputError
        If the name cannot be a module's, or is taken.
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


def write_new(texts: Mapping[Path, str]) -> None:
    """Write files that are not there yet: all of them, or none.

    Raises
    ------
    InputError
        If one of them is there already, or cannot be written.
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
