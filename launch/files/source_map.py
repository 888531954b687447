"""Values of a user's files and options with their file and line, and errors that name these.

An error in a user's input is an `InputError` of one sentence, with the nearest known name in place
of a mistyped one. This module imports little, since all commands need it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

KeyPath = tuple[str | int, ...]  # keys and indices from the top of a document to a value
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]")


class InputError(ValueError):
    """An input of the user cannot be used; the text is one sentence for the user."""


@contextmanager
def as_input_errors(path: Path | None = None) -> Iterator[None]:
    """Turn a ValueError into an InputError, whose text begins with the path, if any."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error) if path is None else f"{path}: {error}") from None


@dataclass(frozen=True, slots=True)
class SourceMapped:
    """A document with the line of each of its values."""

    value: Any  # plain maps, lists, texts and numbers
    source: str  # file or option of the document
    places: Mapping[KeyPath, str] = field(default_factory=dict)  # ``file:line``, where known

    def place(self, path: KeyPath = ()) -> str:
        """``file:line`` of a value, or of the innermost value around it that has one."""
        for length in range(len(path), -1, -1):
            if path[:length] in self.places:
                return self.places[path[:length]]
        return self.source

    def part(self, path: KeyPath) -> SourceMapped:
        """The value at a path, with its places; KeyError if there is none."""
        value, size = self.value, len(path)
        for key in path:
            value = value[key]
        places = {key[size:]: at for key, at in self.places.items() if key[:size] == path}
        return SourceMapped(value, self.place(path), places)

    def error(self, path: KeyPath, text: str) -> InputError:
        """An error about the value at this path."""
        place = self.place(path)
        return InputError(f"{place}: {text}" if place else text)


def set_within(holder: Any, path: KeyPath, setting: SourceMapped, name: str = "it") -> Any:
    """Maps and lists with the setting's value at a path; missing parents are added as maps.

    Raises InputError if a parent cannot hold the next key.
    """
    if not path:
        return setting.value
    key, rest = path[0], path[1:]
    if isinstance(holder, (list, tuple)) and isinstance(key, int) and key < len(holder):
        inner = set_within(holder[key], rest, setting, f"{name}[{key}]")
        return [inner if i == key else item for i, item in enumerate(holder)]
    parent = {} if holder is None else holder
    if isinstance(key, str) and isinstance(parent, Mapping):
        return {**parent, key: set_within(parent.get(key), rest, setting, key)}
    raise setting.error((), f"{name} is {holder!r:.40}, which has no {path_text(path)} to set")


def path_text(path: KeyPath) -> str:
    """A path as text: ``object.superquadric.size[0]``."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else str(key)
    return text


def key_path(text: str) -> KeyPath:
    """The path of a text ``.key[0]``."""
    return tuple(int(index) if index else key for key, index in _STEP.findall(text))


def hint(name: str, known: Iterable[str]) -> str:
    """The known name that is nearest to an unknown one, or else all known names."""
    names = sorted(set(known))
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]!r}?"
    if not names:
        return "none is known here"
    return f"known: {', '.join(names)}"
