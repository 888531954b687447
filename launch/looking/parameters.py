"""The parameters of a running graph's nodes, as a file that people read."""

from __future__ import annotations

import base64
import binascii
import hashlib
from typing import Any

import msgspec

from palpate.launch.looking.showing import yaml_lines
from palpate.launch.nearest import hint
from palpate.launch.processes.register import Card
from palpate.nodes.recording import Recorded

LONG = 256
"""A longer text is named by its size and hash, characters."""


def find_node(card: Card, name: str) -> Recorded:
    """The node of this name, which may begin with a slash.

    Raises
    ------
    ValueError
        If the graph has none.
    """
    nodes = {one.name: one for one in card.nodes}
    wanted = name.removeprefix("/")
    if wanted not in nodes:
        raise ValueError(f"the graph has no node {wanted!r}; {hint(wanted, nodes)}")
    return nodes[wanted]


def dump_params(card: Card, name: str | None = None) -> str:
    """Parameters in YAML, ``node: {params: ...}``.

    Bytes, and other long texts, are named by their size and SHA-256.

    Parameters
    ----------
    card : Card
        The running graph.
    name : str, optional
        Of one node alone.

    Raises
    ------
    ValueError
        If the graph has no such node.
    """
    nodes = card.nodes if name is None else (find_node(card, name),)
    return "\n".join(yaml_lines({one.name: {"params": params_of(one)} for one in nodes}))


def params_of(node: Recorded) -> Any:
    """A node's parameters as plain values, long texts by size and hash."""
    return _short(msgspec.json.decode(node.params))


def _short(value: Any) -> Any:
    if isinstance(value, str) and len(value) > LONG:
        return _named(value)
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_short(item) for item in value]
    return value


def _named(text: str) -> str:
    """A long text by its size and hash; bytes are base64 in the card."""
    try:
        data, what = base64.b64decode(text, validate=True), "bytes"
    except (binascii.Error, ValueError):
        data, what = text.encode(), "bytes of text"
    return f"{len(data)} {what}, sha256 {hashlib.sha256(data).hexdigest()}"
