"""YAML as data of declared types: parsed within limits, with file and line of each value.

msgspec converts the values to the types.
"""

from __future__ import annotations

import io
import math
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import inspect
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

from palpate.core.plugins import UNITS, describe_error, in_base_unit, ranges_of
from palpate.launch.files.file_access import read_bounded
from palpate.launch.files.source_map import (
    InputError,
    KeyPath,
    SourceMapped,
    hint,
    key_path,
    path_text,
)

MAX_DEPTH = 16  # of nesting; a scene has 5
MAX_VALUES = 12_500  # of 30 us each; a scene has some 30 keys and values, a polyhedron 12,300
MAX_BYTES_PER_VALUE = 16  # of a file with comments, over its allowed number of values
MAX_BITS = 1024  # of a whole number: larger ones are larger than all floats
Target = TypeVar("Target")
# Names of types in msgspec, and in errors for users.
_WORDS = {
    "array": "list",
    "object": "map",
    "str": "text",
    "int": "whole number",
    "float": "number",
    "bool": "true or false",
    "null": "nothing",
}
type_info = lru_cache(maxsize=256)(inspect.type_info)  # it takes milliseconds
_KEYED = (inspect.StructType, inspect.DataclassType)


def read_yaml(path: Path, max_values: int = MAX_VALUES) -> SourceMapped:
    """The document in a file: a map of at most `max_values` keys and values.

    Raises InputError if the file is missing, unreadable, too large, empty, not YAML, or not a map.
    """
    try:
        text = read_bounded(path, MAX_BYTES_PER_VALUE * max_values).decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8: {error.reason}") from None
    document = parse_yaml(text, str(path), max_values)
    if document.value is None:
        raise InputError(
            f"{path}: is empty; shipped scenes and launch files show what belongs here"
        )
    if not isinstance(document.value, dict):
        raise InputError(f"{path}: must be a map of keys to values, got {_kind(document.value)}")
    return document


def _kind(value: Any) -> str:
    return "a list" if isinstance(value, list) else repr(value)[:60]


def parse_yaml(text: str, source: str, max_values: int = MAX_VALUES) -> SourceMapped:
    """The document in a text; `source` names it in errors.

    Raises InputError if it is not exactly one YAML document of at most `max_values` plain values.
    """
    yaml = YAML(typ="safe", pure=True)
    reader = _Reader(yaml, source, max_values)
    try:
        value = reader.document(yaml.parse(text))
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = source if mark is None else f"{source}:{mark.line + 1}"
        problem = _one_line(getattr(error, "problem", None) or str(error))
        raise InputError(f"{place}: is not YAML: {problem}") from None
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{source}: is not YAML: {_one_line(str(error))}") from None
    return SourceMapped(value, source, reader.places)


def _one_line(text: str) -> str:
    return " ".join(text.split())[:160]


class _Reader:
    """Builds values from parser events, each of which is checked first."""

    def __init__(self, yaml: YAML, source: str, max_values: int) -> None:
        self.places: dict[KeyPath, str] = {}
        self._yaml, self._source, self._max_values = yaml, source, max_values
        self._n_values = 0

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
        """Refuse dangerous parts of YAML before a value is built."""
        at = self._at(event)
        self._n_values += 1
        if self._n_values > self._max_values:
            raise InputError(
                f"{at}: has more than {self._max_values} values, the most that are read"
            )
        if len(path) >= MAX_DEPTH and not isinstance(event, ScalarEvent):
            raise InputError(f"{at}: is nested deeper than {MAX_DEPTH}")
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
            raise InputError(f"{at}: anchors and aliases (& and *) are not allowed")
        if tag := getattr(event, "tag", None):
            raise InputError(f"{at}: the tag {str(tag)[:40]} is not allowed")

    def _at(self, event: Event) -> str:
        return f"{self._source}:{event.start_mark.line + 1}"


def yaml_text(value: Any) -> str:
    """Plain values as a YAML document, with small lists and maps on one line."""
    stream = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.dump(value, stream)
    return stream.getvalue()


def convert(document: SourceMapped, wanted: type[Target], name: str = "") -> Target:
    """The value as an instance of `wanted`, a ``msgspec.Struct`` or a dataclass.

    `name` comes before each path in errors: ``planner`` gives ``planner.tolerance``. A number with
    the declared unit m or s may be a text with a unit, as ``0.2mm``. Raises InputError if a key is
    unknown or missing, a value has the wrong type or unit or is out of range, a number is not
    finite, or a text is not Unicode.
    """
    kind = type_info(wanted)  # type: ignore[arg-type]
    _refuse_unknown(document, document.value, kind, (), name)
    document = replace(document, value=_in_base_units(document, document.value, kind, (), name))
    _refuse_strange(document, document.value, (), name)
    try:
        return msgspec.convert(document.value, wanted)
    except msgspec.ValidationError as error:
        raise _complaint(document, wanted, name, str(error)) from None
    except Exception as error:  # a user's own class may raise anything
        raise document.error(
            (), f"{wanted.__name__} cannot be made: {describe_error(error)}"
        ) from None


def _refuse_unknown(
    document: SourceMapped, value: Any, kind: inspect.Type, path: KeyPath, name: str
) -> None:
    """Refuse keys that no Struct in `kind` has, with the nearest known key."""
    if isinstance(kind, inspect.UnionType):
        for choice in kind.types:
            if isinstance(choice, _KEYED) == isinstance(value, Mapping):
                _refuse_unknown(document, value, choice, path, name)
    elif isinstance(kind, _KEYED) and isinstance(value, Mapping):
        fields = {field.encode_name: field.type for field in kind.fields}
        if isinstance(kind, inspect.StructType) and kind.tag_field is not None:
            fields[kind.tag_field] = inspect.AnyType()
        for key, item in value.items():
            if key not in fields:
                where = path_text((name, *path) if name else path)
                owner = f" in {where}" if where else ""
                text = f"unknown key {key!r}{owner}; {hint(str(key), fields)}"
                raise document.error((*path, key), text)
            _refuse_unknown(document, item, fields[key], (*path, key), name)
    elif isinstance(value, (list, tuple)):
        kinds = getattr(kind, "item_types", None) or [getattr(kind, "item_type", None)] * len(value)
        for i, (item, item_kind) in enumerate(zip(value, kinds, strict=False)):
            if item_kind is not None:
                _refuse_unknown(document, item, item_kind, (*path, i), name)


def _in_base_units(
    document: SourceMapped, value: Any, kind: inspect.Type | None, path: KeyPath, name: str
) -> Any:
    """The value with texts of lengths and times converted to numbers, in m and s."""
    if isinstance(kind, inspect.UnionType):
        for choice in kind.types:
            value = _in_base_units(document, value, choice, path, name)
    elif isinstance(kind, inspect.Metadata):
        unit = (kind.extra_json_schema or {}).get("description", "")
        return _in_base_unit(document, value, unit, path, name)
    elif isinstance(kind, _KEYED) and isinstance(value, Mapping):
        ranges = ranges_of(kind.cls) if isinstance(kind, inspect.DataclassType) else {}
        value = {**value}
        for field in kind.fields:
            key = field.encode_name
            if key in ranges and key in value:
                unit = ranges[key].unit
                value[key] = _in_base_unit(document, value[key], unit, (*path, key), name)
            elif key in value:
                value[key] = _in_base_units(document, value[key], field.type, (*path, key), name)
    elif isinstance(kind, inspect.DictType) and isinstance(value, Mapping):
        inner = kind.value_type
        return {k: _in_base_units(document, v, inner, (*path, k), name) for k, v in value.items()}
    elif isinstance(value, (list, tuple)):
        kinds = getattr(kind, "item_types", None) or [getattr(kind, "item_type", None)] * len(value)
        return [
            _in_base_units(document, item, item_kind, (*path, i), name)
            for i, (item, item_kind) in enumerate(zip_longest(value, kinds[: len(value)]))
        ]
    return value


def _in_base_unit(document: SourceMapped, value: Any, unit: str, path: KeyPath, name: str) -> Any:
    """The value as a number, if it is a text and its declared unit has multiples."""
    if not isinstance(value, str) or unit not in UNITS:
        return value
    try:
        return in_base_unit(value, UNITS[unit])
    except ValueError as error:
        where = path_text((name, *path) if name else path)
        raise document.error(path, f"{where} is {value[:60]!r}; expected number: {error}") from None


def _refuse_strange(document: SourceMapped, value: Any, path: KeyPath, name: str) -> None:
    """Refuse values that no message can hold: infinity, NaN, and names that are not Unicode."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            _refuse_strange(document, item, (*path, key), name)
    elif isinstance(value, (list, tuple)):
        for i, item in enumerate(value):
            _refuse_strange(document, item, (*path, i), name)
    elif isinstance(value, float) and not math.isfinite(value):
        where = path_text((name, *path) if name else path)
        raise document.error(path, f"{where} is {value}; a number must be finite")
    elif isinstance(value, str) and any("\ud800" <= char <= "\udfff" for char in value):
        where = path_text((name, *path) if name else path)
        coding = sys.getfilesystemencoding().upper()
        why = f"no text in {coding}; give the file or folder another name"
        raise document.error(path, f"{where} is {value[:60]!r}, {why}")


def _complaint(document: SourceMapped, wanted: type, name: str, text: str) -> InputError:
    """Turn msgspec's ``Expected ... - at `$.a[0]``` into a sentence with place, path and value."""
    what, _, at = text.partition(" - at `$")
    # msgspec writes [...] for a key of a map with free keys: the error is then about the map.
    path = key_path(at.rstrip("`").partition("[...]")[0])
    what = what.replace("`", "")
    where = path_text((name, *path) if name else path) or "the document"
    if what.startswith("Object missing required field "):
        missing = what.removeprefix("Object missing required field ")
        return document.error(path, f"{where} lacks the key {missing!r}")
    value = document.value
    for key in path:
        value = value[key]
    if what.startswith("Invalid enum value"):
        allowed = ", ".join(sorted(map(str, _choices(type_info(wanted), path))))
        return document.error(path, f"{where} is {_shown(value)}; expected one of {allowed}")
    # A Struct that checks itself names field and value in its own text.
    if not what.startswith("Expected"):
        at_fault = key_path(f".{what.partition(' ')[0].rstrip(':,')}")
        known = isinstance(value, Mapping) and bool(at_fault) and at_fault[0] in value
        return document.error((*path, *at_fault) if known else path, f"{where}: {what}")
    return document.error(path, f"{where} is {_shown(value)}; {_plain(what)}")


def _choices(kind: inspect.Type, path: KeyPath) -> list[object]:
    """The words that are allowed at a path."""
    if isinstance(kind, inspect.UnionType):
        return [choice for option in kind.types for choice in _choices(option, path)]
    if isinstance(kind, inspect.LiteralType) and not path:
        return list(kind.values)
    if isinstance(kind, _KEYED) and path:
        types = [field.type for field in kind.fields if field.encode_name == path[0]]
        return [choice for option in types for choice in _choices(option, path[1:])]
    return []


def _shown(value: Any) -> str:
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, Mapping):
        return f"a map of {', '.join(map(str, value)) or 'nothing'}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _plain(text: str) -> str:
    expected, _, got = text.removeprefix("Expected ").partition(", got ")
    words = re.sub(
        r"[a-z]+", lambda word: _WORDS.get(word[0], word[0]), expected.replace("|", "or")
    )
    return f"expected {words}" + (f", got {_WORDS.get(got, got)}" if got else "")
