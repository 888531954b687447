"""YAML 1.2 with the line of every value, and without what makes YAML dangerous.

Aliases, tags, duplicate keys, deep nesting and large files are refused before anything is built
from them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    NodeEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)
from ruamel.yaml.nodes import ScalarNode

from palpate.launch.files.file_access import read_bounded
from palpate.launch.files.source_map import InputError, KeyPath, SourceMapped

MAX_DEPTH = 16  # Deepest nesting; a scene has 5
# Keys and values; a scene has some 30, the largest polyhedron 12,300; each takes some 30 us.
MAX_VALUES = 12_500
BYTES_PER_VALUE = 16  # Most bytes of a file, for each of its values, comments and all
MAX_BITS = 1024  # Of a whole number: what is larger is larger than all floats


def read_yaml(path: Path, most: int = MAX_VALUES) -> SourceMapped:
    """The document in a file.

    Parameters
    ----------
    path : Path
        A file with one document, a map.
    most : int
        Most keys and values that it may have; 16 bytes for each, and no more.

    Raises
    ------
    InputError
        If the file is missing, unreadable, too large, empty, not YAML, or not a map.
    """
    try:
        text = read_bounded(path, BYTES_PER_VALUE * most).decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8: {error.reason}") from None
    found = parse_yaml(text, str(path), most)
    if found.value is None:
        raise InputError(
            f"{path}: is empty; shipped scenes and launch files show what belongs here"
        )
    if not isinstance(found.value, dict):
        raise InputError(f"{path}: must be a map of keys to values, got {_kind(found.value)}")
    return found


def parse_yaml(text: str, source: str, most: int = MAX_VALUES) -> SourceMapped:
    """The document in a text; `source` names it in complaints.

    Raises
    ------
    InputError
        If it is not exactly one YAML document of at most `most` plain values.
    """
    yaml = YAML(typ="safe", pure=True)
    reader = _Reader(yaml, source, most)
    try:
        value = reader.document(yaml.parse(text))
    except YAMLError as error:
        raise InputError(_syntax(error, source)) from None
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{source}: is not YAML: {_one_line(str(error))}") from None
    return SourceMapped(value, source, reader.places)


class _Reader:
    """Builds values from events as they come, and looks at each before it does."""

    def __init__(self, yaml: YAML, source: str, most: int) -> None:
        self.places: dict[KeyPath, str] = {}
        self._yaml, self._source, self._most = yaml, source, most
        self._values = 0

    def document(self, events: Iterator[Event]) -> Any:
        """The only document; None if there is none."""
        value, documents = None, 0
        for event in events:
            if isinstance(event, DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise InputError(f"{self._at(event)}: is not YAML: a second document begins")
            elif isinstance(event, NodeEvent):
                value = self._value(event, events, ())
        return value

    def _value(self, event: Event, events: Iterator[Event], path: KeyPath) -> Any:
        self._check(event, path)
        self.places.setdefault(path, self._at(event))
        if isinstance(event, SequenceStartEvent):
            items: list[Any] = []
            while not isinstance(item := next(events), SequenceEndEvent):
                items.append(self._value(item, events, (*path, len(items))))
            return items
        if isinstance(event, MappingStartEvent):
            return self._map(events, path)
        assert isinstance(event, ScalarEvent)
        return self._scalar(event)

    def _map(self, events: Iterator[Event], path: KeyPath) -> dict[str, Any]:
        built: dict[str, Any] = {}
        while not isinstance(event := next(events), MappingEndEvent):
            self._check(event, path)
            key, at = event.value if isinstance(event, ScalarEvent) else "", self._at(event)
            if not key:
                raise InputError(f"{at}: a key must be a word")
            if key in built:
                raise InputError(f"{at}: the key {key[:60]!r} is given twice")
            self.places[*path, key] = at
            built[key] = self._value(next(events), events, (*path, key))
        return built

    def _scalar(self, event: ScalarEvent) -> Any:
        tag = self._yaml.resolver.resolve(ScalarNode, event.value, event.implicit)
        node = ScalarNode(tag, event.value, event.start_mark, event.end_mark)
        value = self._yaml.constructor.construct_object(node)
        if type(value) is int and value.bit_length() > MAX_BITS:
            raise InputError(f"{self._at(event)}: has a number of more than {MAX_BITS} bits")
        return value

    def _check(self, event: Event, path: KeyPath) -> None:
        """Refuse what makes YAML dangerous, before anything is built of it."""
        at = self._at(event)
        self._values += 1
        if self._values > self._most:
            raise InputError(f"{at}: has more than {self._most} values, the most that are read")
        if len(path) >= MAX_DEPTH and not isinstance(event, ScalarEvent):
            raise InputError(f"{at}: is nested deeper than {MAX_DEPTH}")
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
            raise InputError(f"{at}: anchors and aliases (& and *) are not allowed")
        if tag := getattr(event, "tag", None):
            raise InputError(f"{at}: the tag {str(tag)[:40]} is not allowed")

    def _at(self, event: Event) -> str:
        return f"{self._source}:{event.start_mark.line + 1}"


def _syntax(error: YAMLError, source: str) -> str:
    mark = getattr(error, "problem_mark", None)
    place = source if mark is None else f"{source}:{mark.line + 1}"
    problem = getattr(error, "problem", None) or str(error)
    return f"{place}: is not YAML: {_one_line(problem)}"


def _one_line(text: str) -> str:
    return " ".join(text.split())[:160]


def _kind(value: Any) -> str:
    return "a list" if isinstance(value, list) else repr(value)[:60]
