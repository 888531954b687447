"""The nodes of a running graph: their status, their topics and their parameters."""

from __future__ import annotations

import base64
import binascii
import hashlib
import time
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import msgspec

from palpate.launch.files import hint
from palpate.launch.processes import RunCard
from palpate.messages import decode
from palpate.messages.bus import STATUS_TOPIC
from palpate.messages.types import NodeStatus
from palpate.nodes.runtime import RecordedNode
from palpate.tools.introspection.message_text import yaml_lines
from palpate.tools.introspection.requests import request
from palpate.tools.introspection.topics import TapSubscription, Topic, topics_of

NODES_PACKAGE = "palpate.nodes."
STATUS_PATIENCE = 1.5  # A node that says nothing for so long works, hangs or is stopped, s
LONG_TEXT = 256  # A longer text is named by its size and hash, characters


def running_nodes(card: RunCard) -> list[str]:
    """Names of the nodes whose process runs, sorted.

    Raises
    ------
    ValueError
        If the launcher gives no answer.
    """
    return sorted(name for name, about in request(card, "status")["nodes"].items() if about["pid"])


def node_text(card: RunCard, name: str) -> str:
    """What a node is, how it is doing, what it hears and says, and its parameters.

    Raises
    ------
    ValueError
        If the graph has no such node, or the launcher gives no answer.
    """
    node = find_node(card, name)
    about = request(card, "status")["nodes"][node.name]
    beats = sample_status(card, [node.name]) if about["pid"] else {}
    return "\n".join(
        [
            node.name,
            f"  kind      {node.module.removeprefix(NODES_PACKAGE)}",
            *_health_lines(about, beats.get(node.name)),
            *_traffic_lines(card, node),
            "  params",
            *(f"    {line}" for line in yaml_lines(params_of(node))),
        ]
    )


def _health_lines(about: Mapping[str, Any], beats: StatusSample | None) -> list[str]:
    lines = [f"  pid       {about['pid'] or 'none: it does not run'}"]
    lines.append(f"  restarts  {about['restarts']}")
    if beats is None:
        if about["pid"]:
            lines.append(f"  state     silent for {about['silent_s']:.1f} s: it works, or hangs")
        return lines
    status = beats.status
    load = "" if beats.load is None else f", {100.0 * beats.load:.0f} % of a core now"
    return [
        *lines,
        f"  state     {status.state}",
        f"  messages  {status.messages} handled, {status.sent} sent",
        f"  gaps      {status.gaps}, duplicates {status.duplicates}",
        f"  handler   p50 {status.p50:.0f} us, p99 {status.p99:.0f} us",
        f"  cpu       {status.cpu:.2f} s{load}",
    ]


def _traffic_lines(card: RunCard, node: RecordedNode) -> list[str]:
    topics = topics_of(card)
    subscriptions = [(one.topic, one.type, f"from {one.publisher}") for one in node.inputs]
    publications = [
        (wire, topics[wire].type, f"to {', '.join(topics[wire].listeners) or 'nobody'}")
        for wire in node.outputs.values()
    ]
    lines = []
    for what, rows in (("hears", subscriptions), ("says", publications)):
        lines += [f"  {what}", *(f"    {topic}  {said}  {who}" for topic, said, who in rows)]
    return lines


class StatusSample(NamedTuple):
    """The last words of one node about itself."""

    status: NodeStatus  # The latest
    load: float | None  # Share of one processor since the word before; None if there was none


def sample_status(
    card: RunCard, names: Collection[str], patience: float = STATUS_PATIENCE
) -> dict[str, StatusSample]:
    """What the nodes of these names say; twice each, unless the patience ends, s.

    Raises
    ------
    ValueError
        If what comes is no such word.
    """
    found: dict[str, StatusSample] = {}
    sent: dict[str, int] = {}
    topic = Topic(STATUS_TOPIC, NodeStatus.__name__, tuple(names), ())
    until = time.monotonic() + patience
    with TapSubscription(card, [topic]) as hearing:
        while (left := until - time.monotonic()) > 0 and not _twice(found, names):
            for heard in hearing.take(left):
                status, when = decode(NodeStatus, heard.body), heard.header.sent_ns
                before = found.get(heard.publisher)
                load = None
                if before is not None and status.cpu >= before.status.cpu:
                    passed = 1e-9 * (when - sent[heard.publisher])
                    load = (status.cpu - before.status.cpu) / passed
                found[heard.publisher] = StatusSample(status, load)
                sent[heard.publisher] = when
    return found


def _twice(found: dict[str, StatusSample], names: Collection[str]) -> bool:
    return all(name in found and found[name].load is not None for name in names)


def dump_params(card: RunCard, name: str | None = None) -> str:
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


def find_node(card: RunCard, name: str) -> RecordedNode:
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


def params_of(node: RecordedNode) -> Any:
    """A node's parameters as plain values, long texts by size and hash."""
    return _short(msgspec.json.decode(node.params))


def _short(value: Any) -> Any:
    if isinstance(value, str) and len(value) > LONG_TEXT:
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
