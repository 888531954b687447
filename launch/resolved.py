"""The launch file as it was resolved, written beside a run's results for whoever reads them."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from typing import Any

from msgspec import to_builtins
from ruamel.yaml import YAML

from palpate.launch.graph import Graph
from palpate.nodes.wiring import Wiring


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
