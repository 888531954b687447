"""Plain values to checked Structs, with complaints that say where, what and what instead."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from palpate.launch.files.source_map import InputError, KeyPath, SourceMapped, hint, path_text

Target = TypeVar("Target")
# What msgspec calls things, and what people do.
_WORDS = {
    "array": "list",
    "object": "map",
    "str": "text",
    "int": "whole number",
    "float": "number",
    "bool": "true or false",
    "null": "nothing",
}
_KEYED = (inspect.StructType, inspect.DataclassType)
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]")


def convert(given: SourceMapped, wanted: type[Target], name: str = "") -> Target:
    """The value as an instance of `wanted`.

    Parameters
    ----------
    given : Located
        Plain values and the lines on which they stand.
    wanted : type
        A ``msgspec.Struct``, or a dataclass.
    name : str
        Where the document as a whole belongs, put before each path: ``planner`` makes
        ``planner.tolerance``.

    Raises
    ------
    InputError
        If a key is unknown or missing, a value has the wrong type or lies out of range, or a
        number is not finite.
    """
    refuse_unknown(given, wanted, name)
    refuse_infinite(given, name)
    try:
        return msgspec.convert(given.value, wanted)
    except msgspec.ValidationError as error:
        raise _complaint(given, wanted, name, str(error)) from None


def refuse_unknown(given: SourceMapped, wanted: type, name: str = "") -> None:
    """Refuse keys that no Struct within `wanted` has, with the nearest one that it has."""
    _walk_keys(given, given.value, inspect.type_info(wanted), (), name)


def refuse_infinite(given: SourceMapped, name: str = "") -> None:
    """Refuse numbers that are infinite or not a number."""
    _walk_numbers(given, given.value, (), name)


def _walk_keys(
    given: SourceMapped, value: Any, kind: inspect.Type, path: KeyPath, name: str
) -> None:
    if isinstance(kind, inspect.UnionType):
        for choice in kind.types:
            if isinstance(choice, _KEYED) == isinstance(value, Mapping):
                _walk_keys(given, value, choice, path, name)
    elif isinstance(kind, _KEYED) and isinstance(value, Mapping):
        fields = {field.encode_name: field.type for field in kind.fields}
        if isinstance(kind, inspect.StructType) and kind.tag_field is not None:
            fields[kind.tag_field] = inspect.AnyType()
        for key, item in value.items():
            if key not in fields:
                where = path_text((name, *path) if name else path)
                owner = f" in {where}" if where else ""
                text = f"unknown key {key!r}{owner}; {hint(str(key), fields)}"
                raise given.error((*path, key), text)
            _walk_keys(given, item, fields[key], (*path, key), name)
    elif isinstance(value, (list, tuple)):
        kinds = getattr(kind, "item_types", None) or [getattr(kind, "item_type", None)] * len(value)
        for i, (item, item_kind) in enumerate(zip(value, kinds, strict=False)):
            if item_kind is not None:
                _walk_keys(given, item, item_kind, (*path, i), name)


def _walk_numbers(given: SourceMapped, value: Any, path: KeyPath, name: str) -> None:
    if isinstance(value, Mapping):
        for key, item in value.items():
            _walk_numbers(given, item, (*path, key), name)
    elif isinstance(value, (list, tuple)):
        for i, item in enumerate(value):
            _walk_numbers(given, item, (*path, i), name)
    elif isinstance(value, float) and not math.isfinite(value):
        where = path_text((name, *path) if name else path)
        raise given.error(path, f"{where} is {value}; a number must be finite")


def _complaint(given: SourceMapped, wanted: type, name: str, text: str) -> InputError:
    """Turn msgspec's ``Expected ... - at `$.a[0]``` into a sentence with place, path and value."""
    what, _, at = text.partition(" - at `$")
    # A key of a map with free keys is told as [...]: the complaint is then about the map.
    path = _steps(at.rstrip("`").partition("[...]")[0])
    what = what.replace("`", "")
    where = path_text((name, *path) if name else path) or "the document"
    if what.startswith("Object missing required field "):
        missing = what.removeprefix("Object missing required field ")
        return given.error(path, f"{where} lacks the key {missing!r}")
    value = given.value
    for key in path:
        value = value[key]
    if what.startswith("Invalid enum value"):
        allowed = ", ".join(sorted(map(str, _choices(inspect.type_info(wanted), path))))
        return given.error(path, f"{where} is {_shown(value)}; expected one of {allowed}")
    # A Struct that checks itself names field and value in its own words.
    if not what.startswith("Expected"):
        at_fault = _steps(f".{what.partition(' ')[0].rstrip(':,')}")
        known = isinstance(value, Mapping) and bool(at_fault) and at_fault[0] in value
        return given.error((*path, *at_fault) if known else path, f"{where}: {what}")
    return given.error(path, f"{where} is {_shown(value)}; {_plain(what)}")


def _steps(text: str) -> KeyPath:
    """The path that is written as ``.key[0]``."""
    return tuple(int(index) if index else key for key, index in _STEP.findall(text))


def _choices(kind: inspect.Type, path: KeyPath) -> list[object]:
    """What may stand at a path that takes one of a few words."""
    if isinstance(kind, inspect.UnionType):
        return [choice for one in kind.types for choice in _choices(one, path)]
    if isinstance(kind, inspect.LiteralType) and not path:
        return list(kind.values)
    if isinstance(kind, _KEYED) and path:
        found = [field.type for field in kind.fields if field.encode_name == path[0]]
        return [choice for one in found for choice in _choices(one, path[1:])]
    return []


def _plain(text: str) -> str:
    wanted, _, got = text.removeprefix("Expected ").partition(", got ")
    words = re.sub(r"[a-z]+", lambda word: _WORDS.get(word[0], word[0]), wanted.replace("|", "or"))
    return f"expected {words}" + (f", got {_WORDS.get(got, got)}" if got else "")


def _shown(value: Any) -> str:
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, Mapping):
        return f"a map of {', '.join(map(str, value)) or 'nothing'}"[:60]
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
