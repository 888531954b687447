"""Requests of tools to the launcher of a running graph, and samples of the status of its nodes."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import os
import textwrap
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from typing import Any, NamedTuple, get_type_hints

import msgspec
import numpy as np

from palpate.launch.files.source_map import InputError, as_input_errors, hint
from palpate.launch.files.yaml_file import parse_yaml
from palpate.launch.printing import TEXT_WIDTH
from palpate.launch.processes.registry import RunCard, find_run
from palpate.messages import Array, bus, decode, encode
from palpate.messages.types import NodeStatus
from palpate.nodes.runtime.node import RecordedNode
from palpate.tools.introspection.echo import yaml_lines
from palpate.tools.introspection.topics import (
    STATUS_TOPICS,
    TapSubscription,
    Topic,
    find_topic,
    topics_of,
    type_of,
)

NODES_PACKAGE = "palpate.nodes."
PLAYER_MODULE = "palpate.nodes.player"


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestTimeouts:
    """Waits for answers of a running graph [s]."""

    answer: float = 5.0  # longest wait for the launcher; without an answer it is busy or stopped
    retry: float = 0.02  # before the launcher is asked again about a node that is starting
    status: float = 1.5  # longest wait for two statuses of a node; without: busy, hung or stopped


TIMEOUTS = RequestTimeouts()


def describe_node(card: RunCard, name: str) -> dict[str, Any]:
    """Facts and state of a node; raises ValueError if there is none, or no answer."""
    node = find_node(card, name)
    about = request(card, "status")["nodes"][node.name]
    beats = sample_status(card, [node.name]) if about["pid"] else {}
    sample, topics = beats.get(node.name), topics_of(card)
    return {
        "node": node.name,
        "kind": node.module.removeprefix(NODES_PACKAGE),
        "pid": about["pid"] or None,
        "restarts": about["restarts"],
        "silent_s": about["silent_s"],
        "status": sample and msgspec.to_builtins(sample.status),
        "load": sample and sample.load,
        "subscribes": [
            {key: getattr(edge, key) for key in ("topic", "type", "publisher")}
            for edge in node.inputs
        ],
        "publishes": [
            {"topic": wire, "type": topics[wire].type, "subscribers": topics[wire].subscribers}
            for wire in node.outputs.values()
        ],
        "params": params_of(node),
    }


def node_text(about: Mapping[str, Any]) -> str:
    """Lines about a node."""
    params = (f"    {line}" for line in yaml_lines(about["params"]))
    return "\n".join([*_health_lines(about), *_traffic_lines(about), "  params", *params])


def _health_lines(about: Mapping[str, Any]) -> Iterator[str]:
    yield about["node"]
    yield f"  kind      {about['kind']}"
    yield f"  pid       {about['pid'] or 'none: it does not run'}"
    yield f"  restarts  {about['restarts']}"
    status = about["status"]
    if status is not None:
        load = "" if about["load"] is None else f", {100.0 * about['load']:.0f} % of a core now"
        yield f"  state     {status['state']}"
        yield f"  messages  {status['messages']} handled, {status['sent']} sent"
        yield f"  gaps      {status['gaps']}, duplicates {status['duplicates']}"
        yield f"  handler   p50 {status['p50']:.0f} us, p99 {status['p99']:.0f} us"
        yield f"  cpu       {status['cpu']:.2f} s{load}"
    elif about["pid"]:
        yield f"  state     silent for {about['silent_s']:.1f} s: it works, or hangs"


def _traffic_lines(about: Mapping[str, Any]) -> Iterator[str]:
    yield "  subscribes"
    for edge in about["subscribes"]:
        yield f"    {edge['topic']}  {edge['type']}  from {edge['publisher']}"
    yield "  publishes"
    for edge in about["publishes"]:
        to = ", ".join(edge["subscribers"]) or "no node"
        yield from textwrap.wrap(
            f"{edge['topic']}  {edge['type']}  to {to}",
            TEXT_WIDTH,
            initial_indent=" " * 4,
            subsequent_indent=" " * 8,
        )


class StatusSample(NamedTuple):
    """The latest status of a node, and its load."""

    status: NodeStatus
    load: float | None  # fraction of a processor since the status before; None without one


def sample_status(
    card: RunCard, names: Collection[str], timeouts: RequestTimeouts = TIMEOUTS
) -> dict[str, StatusSample]:
    """Two statuses of each node, as far as they come in time."""
    samples: dict[str, StatusSample] = {}
    sent: dict[str, int] = {}
    topic = Topic(bus.STATUS_TOPIC, NodeStatus.__name__, tuple(names), ())
    until = time.monotonic() + timeouts.status
    with TapSubscription(card, [topic]) as taps:
        while (left := until - time.monotonic()) > 0 and not all(
            name in samples and samples[name].load is not None for name in names
        ):
            for received in taps.take(left):
                publisher, sent_ns = received.publisher, received.header.sent_ns
                status, load = decode(NodeStatus, received.body), None
                before = samples.get(publisher)
                if before is not None and status.cpu >= before.status.cpu:
                    elapsed = 1e-9 * (sent_ns - sent[publisher])
                    load = (status.cpu - before.status.cpu) / elapsed
                samples[publisher], sent[publisher] = StatusSample(status, load), sent_ns
    return samples


def dump_params(card: RunCard, name: str | None = None) -> dict[str, Any]:
    """Parameters of one node or of all, ``node: {params: ...}``; bytes as size and SHA-256.

    Raises ValueError if the graph has no such node.
    """
    nodes = card.nodes if name is None else (find_node(card, name),)
    return {node.name: {"params": params_of(node)} for node in nodes}


def find_node(card: RunCard, name: str) -> RecordedNode:
    """A node by name, with or without a slash before it; raises ValueError if there is none."""
    nodes = {node.name: node for node in card.nodes}
    wanted = name.removeprefix("/")
    if wanted not in nodes:
        raise ValueError(f"the graph has no node {wanted!r}; {hint(wanted, nodes)}")
    return nodes[wanted]


def params_of(node: RecordedNode) -> Any:
    """Parameters of a node as plain values; long texts as size and hash."""
    return _short(msgspec.json.decode(node.params))


def _short(value: Any, max_letters: int = 256) -> Any:
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_short(item) for item in value]
    if not isinstance(value, str) or len(value) <= max_letters:
        return value
    try:  # bytes are base64 in the card of a run
        data, what = base64.b64decode(value, validate=True), "bytes"
    except ValueError:
        data, what = value.encode(), "bytes of text"
    return f"{len(data)} {what}, sha256 {hashlib.sha256(data).hexdigest()}"


def notify(card: RunCard, kind: str, **fields: Any) -> None:
    """Send a request to the launcher of a running graph, without waiting for an answer."""
    with _control_line(card) as line:
        line.send(kind, **fields)
        line.close()


def request(
    card: RunCard, kind: str, *, timeouts: RequestTimeouts = TIMEOUTS, **fields: Any
) -> bus.ControlMessage:
    """Send a request to the launcher of a running graph, and return its answer.

    A node that is starting is waited for. Raises ValueError if the launcher refuses, or gives no
    answer.
    """
    deadline = time.monotonic() + timeouts.answer
    with _control_line(card) as line:
        while True:
            line.send(kind, **fields)
            left = max(deadline - time.monotonic(), 0.1)
            answer = line.receive() if line.socket.poll(int(1000 * left)) else None
            if answer is None:
                raise ValueError(
                    f"run {card.run[:6]} ({card.name}) gives no answer within "
                    f"{timeouts.answer:g} s; it is busy or stopped"
                )
            if answer["kind"] != "not_ready" or time.monotonic() > deadline:
                break
            time.sleep(timeouts.retry)
    if answer["kind"] in ("refused", "not_ready"):
        raise ValueError(str(answer["text"]))
    return answer


@contextmanager
def _control_line(card: RunCard) -> Iterator[bus.ControlClient]:
    sockets = bus.SocketContext(card.key)
    name = f"tool {os.getpid()} {os.urandom(4).hex()}"
    line = bus.ControlClient(sockets.context, card.tools, name=name, accepts=bus.TO_TOOLS)
    try:
        yield line
    finally:
        line.socket.close(0)
        sockets.close()


def control_player(run: str | None, kind: str, **fields: Any) -> None:
    """Send a request to the player of a running graph.

    Raises InputError if no such graph runs, it has no player or several, or the request is refused.
    """
    with as_input_errors():
        card = find_run(run)
        players = [node.name for node in card.nodes if node.module == PLAYER_MODULE]
        if len(players) != 1:
            has = ", ".join(players) or "none"
            who = f"run {card.run[:6]} ({card.name})"
            raise ValueError(f"{who} must have one player, it has {has}")
        request(card, kind, node=players[0], **fields)


def publish(
    topic: str,
    body: str,
    *,
    rate: float,
    times: int | None,
    run: str | None,
    echo: Callable[[str], None],
) -> None:
    """Ask the publisher of a topic to publish a message, whose fields are in YAML.

    `times`: number of messages; None: until Ctrl-C. Raises InputError if no such graph runs, no
    node of it publishes the topic, or the body is no such message.
    """
    if not rate > 0.0:
        raise InputError(f"--rate must be positive, got {rate:g}")
    with as_input_errors():
        card = find_run(run)
        target = find_topic(card, topic)
        if target.name in STATUS_TOPICS:
            raise ValueError(
                f"{target.name} is what nodes report of themselves; nothing can be added"
            )
        cls = type_of(target)
        fields = parse_yaml(body, "BODY").value
        if not isinstance(fields, dict):
            raise ValueError(f"BODY must be a map of fields in YAML, got {body!r:.60}")
        data = encode(message_from_plain(cls, fields))
        for number in range(times) if times is not None else count():
            if number:
                time.sleep(1.0 / rate)
            request(card, "publish", node=target.publishers[0], topic=target.name, body=data)
            echo(f"published {cls.__name__} on {target.name}")


def message_from_plain(cls: type, values: Mapping[str, Any]) -> object:
    """A message of a type with these values of fields; lists become arrays.

    Raises ValueError if fields are missing or unknown, or a list is no such array. Other faults are
    found when the message is encoded.
    """
    hints = get_type_hints(cls, include_extras=True)
    names = [field.name for field in dataclasses.fields(cls)]
    missing = [name for name in names if name not in values]
    unknown = [str(name) for name in values if name not in names]
    if missing or unknown:
        lacks = f"lacks {', '.join(missing)}" if missing else f"has no {', '.join(unknown)}"
        raise ValueError(f"a {cls.__name__} {lacks}; its fields are {', '.join(names)}")
    return cls(**{name: _field_value(name, hints[name], values[name]) for name in names})


def _field_value(name: str, hint: Any, value: Any) -> Any:
    array = next((m for m in getattr(hint, "__metadata__", ()) if isinstance(m, Array)), None)
    if array is not None:
        kind = np.dtype(array.dtype)
        try:
            made = np.array(value, kind)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"{name} must be an array of {kind}, got {value!r:.60}") from None
        empty = made.size == 0 and made.ndim != len(array.shape)
        return made.reshape([n or 0 for n in array.shape]) if empty else made
    if isinstance(value, int) and not isinstance(value, bool) and "float" in str(hint):
        return float(value)
    return tuple(value) if isinstance(value, list) else value
