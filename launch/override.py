"""``node.param=value`` from the command line, laid over what the launch file says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from msgspec import to_builtins

from palpate.launch.entry import Entry
from palpate.launch.graph import Graph
from palpate.launch.located import InputError, Located
from palpate.launch.nearest import hint
from palpate.launch.own_modules import look_here
from palpate.launch.yaml_file import parse_yaml


def override(graph: Graph, settings: Mapping[str, Located]) -> Graph:
    """The graph with parameters set from outside.

    Parameters
    ----------
    graph : Graph
        The graph as described.
    settings : map
        ``node.param`` to its value; where there is one such node for each finger, its name
        without the number means all of them.

    Raises
    ------
    InputError
        If a setting does not look like this or names no node. The parameter itself is checked
        with the graph.
    """
    entries = {entry.name: entry for entry in graph.entries}
    groups: dict[str, list[str]] = {name: [name] for name in entries}
    for name, entry in entries.items():
        if entry.finger:
            groups.setdefault(entry.group, []).append(name)
    for target, value in settings.items():
        node, _, param = target.partition(".")
        if not param:
            raise value.error((), "must look like planner.tolerance=0.2e-3")
        if node not in groups:
            raise value.error((), f"there is no node {node!r}; {hint(node, groups)}")
        for name in groups[node]:
            entries[name] = _with(entries[name], param, value)
    return replace(graph, entries=tuple(entries.values()))


def read_settings(texts: Iterable[str]) -> dict[str, Located]:
    """Settings as typed on the command line, ``node.param=value`` each; later ones win.

    Raises
    ------
    InputError
        If one has no ``=``, or a value that is not YAML.
    """
    found = {}
    for text in texts:
        target, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text}: must look like planner.tolerance=0.2e-3")
        found[target] = option(value, f"--set {text}")
    return found


def read_arguments(texts: Iterable[str]) -> dict[str, Located]:
    """Arguments of a launch file as typed on the command line, ``name:=value`` each.

    Raises
    ------
    InputError
        If one has no ``:=``, or a value that is not YAML.
    """
    found = {}
    for text in texts:
        name, sign, value = text.partition(":=")
        if not (sign and name):
            raise InputError(f"{text!r}: an argument must look like scene:=vase")
        found[name] = option(value, text)
    return found


def option(text: str, source: str) -> Located:
    """A value typed on the command line, read as YAML."""
    return Located(parse_yaml(text, source).value, source)


def _with(entry: Entry, param: str, value: Located) -> Entry:
    if isinstance(value.value, str):
        look_here(value.value)  # a planner of one's own
    keys = tuple(param.split("."))
    params = to_builtins(entry.params, builtin_types=(bytes,))
    return replace(
        entry,
        params=_nested(params, keys, value),
        places={**entry.places, keys: value.source},
    )


def _nested(params: Mapping[str, Any], keys: tuple[str, ...], value: Located) -> dict[str, Any]:
    """Parameters with one of them set, maybe within a map that they hold."""
    first, *rest = keys
    if not rest:
        return {**params, first: value.value}
    inner = params.get(first) or {}
    if not isinstance(inner, Mapping):
        raise value.error((), f"{first} is {inner!r:.40}, which has no {'.'.join(rest)} to set")
    return {**params, first: _nested(inner, tuple(rest), value)}
