"""``node.param=value`` from the command line, laid over what the launch file says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from msgspec import to_builtins

from palpate.launch.entry import Entry
from palpate.launch.graph import Graph
from palpate.launch.located import InputError, Located
from palpate.launch.nearest import hint
from palpate.launch.yaml_file import parse_yaml


def override(graph: Graph, settings: Mapping[str, Located]) -> Graph:
    """The graph with parameters set from outside.

    Parameters
    ----------
    graph : Graph
        The graph as described.
    settings : map
        ``node.param`` to its value.

    Raises
    ------
    InputError
        If a setting does not look like this or names no node. The parameter itself is checked
        with the graph.
    """
    entries = {entry.name: entry for entry in graph.entries}
    for target, value in settings.items():
        node, _, param = target.partition(".")
        if not param:
            raise value.error((), "must look like planner.contours=9")
        if node not in entries:
            raise value.error((), f"there is no node {node!r}; {hint(node, entries)}")
        entries[node] = _with(entries[node], param, value)
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
            raise InputError(f"--set {text}: must look like planner.contours=9")
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
    params = to_builtins(entry.params, builtin_types=(bytes,))
    return replace(
        entry,
        params={**params, param: value.value},
        places={**entry.places, (param,): value.source},
    )
