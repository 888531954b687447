"""What a user wrote, and where: values and complaints that know their file and line.

Every complaint about a user's input is one `InputError` of one sentence, with the nearest known
name where one was mistyped. Imports nothing heavy: the command line needs it for every verb.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

KeyPath = tuple[str | int, ...]  # Keys and positions from the top of a document to a value
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]")


class InputError(ValueError):
    """What the user gave cannot be used; the text is one sentence for the user."""


@contextmanager
def as_input_errors(path: Path | None = None) -> Iterator[None]:
    """A ValueError is one sentence for the user, which begins with the file where there is one."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error) if path is None else f"{path}: {error}") from None


@dataclass(frozen=True, slots=True)
class SourceMapped:
    """A document with the line of each of its values."""

    value: Any  # Plain maps, lists, texts and numbers
    source: str  # The file, or the option, that it came from
    places: Mapping[KeyPath, str] = field(default_factory=dict)  # ``file:line``, where known

    def place(self, path: KeyPath = ()) -> str:
        """``file:line`` of a value, or of the nearest thing around it that has one."""
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
        """A complaint about the value at this path."""
        place = self.place(path)
        return InputError(f"{place}: {text}" if place else text)


def set_within(holder: Any, path: KeyPath, setting: SourceMapped, name: str = "it") -> Any:
    """Maps and lists with the setting's value at a path; what is missing on the way is a map.

    Raises InputError if something on the way can hold no such key.
    """
    if not path:
        return setting.value
    key, rest = path[0], path[1:]
    if isinstance(holder, (list, tuple)) and isinstance(key, int) and key < len(holder):
        inner = set_within(holder[key], rest, setting, f"{name}[{key}]")
        return [inner if i == key else one for i, one in enumerate(holder)]
    held = {} if holder is None else holder
    if isinstance(key, str) and isinstance(held, Mapping):
        return {**held, key: set_within(held.get(key), rest, setting, key)}
    raise setting.error((), f"{name} is {holder!r:.40}, which has no {path_text(path)} to set")


def path_text(path: KeyPath) -> str:
    """A path as people write it: ``object.superquadric.size[0]``."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else str(key)
    return text


def key_path(text: str) -> KeyPath:
    """The path that is written as ``.key[0]``."""
    return tuple(int(index) if index else key for key, index in _STEP.findall(text))


def hint(name: str, known: Iterable[str]) -> str:
    """What was perhaps meant by an unknown name, or else what is known."""
    names = sorted(set(known))
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]!r}?"
    if not names:
        return "none is known here"
    return f"known: {', '.join(names)}"
