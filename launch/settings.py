"""Parameters of a graph: set from outside, and written down as they were resolved."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from msgspec import to_builtins
from ruamel.yaml import YAML

from palpate.launch.files import InputError, SourceMapped, hint, parse_yaml
from palpate.launch.graph import Graph
from palpate.launch.node_kinds import Entry, search_current_folder
from palpate.nodes.runtime import Wiring


def override(graph: Graph, settings: Mapping[str, SourceMapped]) -> Graph:
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
            entries[name] = _with_parameter(entries[name], param, value)
    return replace(graph, entries=tuple(entries.values()))


def _with_parameter(entry: Entry, param: str, value: SourceMapped) -> Entry:
    if isinstance(value.value, str):
        search_current_folder(value.value)  # a planner of one's own
    keys = tuple(param.split("."))
    params = to_builtins(entry.params, builtin_types=(bytes,))
    return replace(
        entry,
        params=_nested(params, keys, value),
        places={**entry.places, keys: value.source},
    )


def _nested(
    params: Mapping[str, Any], keys: tuple[str, ...], value: SourceMapped
) -> dict[str, Any]:
    """Parameters with one of them set, maybe within a map that they hold."""
    first, *rest = keys
    if not rest:
        return {**params, first: value.value}
    inner = params.get(first) or {}
    if not isinstance(inner, Mapping):
        raise value.error((), f"{first} is {inner!r:.40}, which has no {'.'.join(rest)} to set")
    return {**params, first: _nested(inner, tuple(rest), value)}


def read_settings(texts: Iterable[str]) -> dict[str, SourceMapped]:
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
        found[target] = parsed_option(value, f"--set {text}")
    return found


def read_arguments(texts: Iterable[str]) -> dict[str, SourceMapped]:
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
        found[name] = parsed_option(value, text)
    return found


def parsed_option(text: str, source: str) -> SourceMapped:
    """A value typed on the command line, read as YAML."""
    return SourceMapped(parse_yaml(text, source).value, source)


def resolved_text(graph: Graph, wirings: Sequence[Wiring]) -> str:
    """The graph as YAML, every reference replaced and every default filled in.

    A mesh within a parameter is named by its size and SHA-256.
    """
    entries = {entry.name: entry for entry in graph.entries}
    nodes = {}
    for wiring in wirings:
        entry = entries[wiring.name]
        node: dict[str, Any] = {
            "kind": entry.kind or entry.name,
            "params": plain_params(wiring.params),
        }
        if entry.remap:
            node["remap"] = dict(entry.remap)
        if entry.namespace:
            node["namespace"] = entry.namespace
        if entry.host:
            node["host"] = entry.host
        if entry.nice:
            node["nice"] = entry.nice
        if entry.on_exit != "restart":
            node["on_exit"] = entry.on_exit
        nodes[wiring.name] = node
    stream = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.dump({"nodes": nodes, "ends": graph.ends}, stream)
    return stream.getvalue()


def plain_params(params: Any) -> Any:
    """The parameters of a node as plain values; bytes are named by their number and SHA-256."""
    return _plain(to_builtins(params, builtin_types=(bytes,)))


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return f"{len(value)} bytes, sha256 {hashlib.sha256(value).hexdigest()}"
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
