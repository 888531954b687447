"""YAML 1.2 with the line of every value, and without what makes YAML dangerous.

Aliases, tags, duplicate keys, deep nesting and large files are refused before anything is
built from them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    MappingEndEvent,
    MappingStartEvent,
    NodeEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from palpate.launch.located import InputError, KeyPath, Located

MAX_BYTES = 256 << 10
"""Largest file; a scene of a few dozen lines has some 1 kB."""
MAX_DEPTH = 16
"""Deepest nesting; a scene has 5."""


def read_yaml(path: Path) -> Located:
    """The document in a file.

    Parameters
    ----------
    path : Path
        A file of at most 256 kB with one document, a map.

    Raises
    ------
    InputError
        If the file is missing, unreadable, too large, empty, not YAML, or not a map.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        text = data.decode()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8: {error.reason}") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: is larger than {MAX_BYTES >> 10} kB, the most that is read")
    found = parse_yaml(text, str(path))
    if found.value is None:
        raise InputError(
            f"{path}: is empty; shipped scenes and launch files show what belongs here"
        )
    if not isinstance(found.value, dict):
        raise InputError(f"{path}: must be a map of keys to values, got {_kind(found.value)}")
    return found


def parse_yaml(text: str, source: str) -> Located:
    """The document in a text; `source` names it in complaints.

    Raises
    ------
    InputError
        If it is not exactly one YAML document of plain values.
    """
    yaml = YAML(typ="safe", pure=True)
    try:
        _refuse_hostile(yaml, text, source)
        top = yaml.compose(text)
        places: dict[KeyPath, str] = {}
        value = None if top is None else _value(yaml, top, (), places, source)
    except YAMLError as error:
        raise InputError(_syntax(error, source)) from None
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{source}: is not YAML: {_one_line(str(error))}") from None
    return Located(value, source, places)


def _refuse_hostile(yaml: YAML, text: str, source: str) -> None:
    """Look at the events, which cost nothing, before any value is built."""
    depth = 0
    for event in yaml.parse(text):
        if isinstance(event, (MappingStartEvent, SequenceStartEvent)):
            depth += 1
        elif isinstance(event, (MappingEndEvent, SequenceEndEvent)):
            depth -= 1
        if isinstance(event, NodeEvent):
            line = event.start_mark.line + 1
            if depth > MAX_DEPTH:
                raise InputError(f"{source}:{line}: is nested deeper than {MAX_DEPTH}")
            if isinstance(event, AliasEvent) or event.anchor:
                raise InputError(f"{source}:{line}: anchors and aliases (& and *) are not allowed")
            tag = getattr(event, "tag", None)
            if tag:
                raise InputError(f"{source}:{line}: the tag {str(tag)[:40]} is not allowed")


def _value(yaml: YAML, node: Node, path: KeyPath, places: dict[KeyPath, str], source: str) -> Any:
    places.setdefault(path, f"{source}:{node.start_mark.line + 1}")
    if isinstance(node, SequenceNode):
        return [_value(yaml, item, (*path, i), places, source) for i, item in enumerate(node.value)]
    if isinstance(node, MappingNode):
        built: dict[str, Any] = {}
        for key_node, item in node.value:
            key = key_node.value if isinstance(key_node, ScalarNode) else ""
            at = f"{source}:{key_node.start_mark.line + 1}"
            if not key:
                raise InputError(f"{at}: a key must be a word")
            if key in built:
                raise InputError(f"{at}: the key {key!r} is given twice")
            places[(*path, key)] = at
            built[key] = _value(yaml, item, (*path, key), places, source)
        return built
    return yaml.constructor.construct_object(node)


def _syntax(error: YAMLError, source: str) -> str:
    mark = getattr(error, "problem_mark", None)
    place = source if mark is None else f"{source}:{mark.line + 1}"
    problem = getattr(error, "problem", None) or str(error)
    return f"{place}: is not YAML: {_one_line(problem)}"


def _one_line(text: str) -> str:
    return " ".join(text.split())[:160]


def _kind(value: Any) -> str:
    return "a list" if isinstance(value, list) else repr(value)[:60]
