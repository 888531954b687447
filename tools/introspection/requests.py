"""What a tool asks a running graph: the launcher by requests, the nodes by their status."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import os
import textwrap
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
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
STATUS_PATIENCE = 1.5  # A node that says nothing for so long works, hangs or is stopped, s
LONG_TEXT = 256  # A longer text is named by its size and hash, characters
REQUEST_PATIENCE = 5.0  # Who does not answer for so long is busy, or stopped, s
RETRY = 0.02  # A node that is not up is asked for again after this long, s
PLAYER_MODULE = "palpate.nodes.player"


def describe_node(card: RunCard, name: str) -> dict[str, Any]:
    """What a node is and how it is doing; raises ValueError if there is none, or nobody answers."""
    node = find_node(card, name)
    about = request(card, "status")["nodes"][node.name]
    beats = sample_status(card, [node.name]) if about["pid"] else {}
    found, topics = beats.get(node.name), topics_of(card)
    return {
        "node": node.name,
        "kind": node.module.removeprefix(NODES_PACKAGE),
        "pid": about["pid"] or None,
        "restarts": about["restarts"],
        "silent_s": about["silent_s"],
        "status": found and msgspec.to_builtins(found.status),
        "load": found and found.load,
        "subscribes": [
            {key: getattr(one, key) for key in ("topic", "type", "publisher")}
            for one in node.inputs
        ],
        "publishes": [
            {"topic": wire, "type": topics[wire].type, "subscribers": topics[wire].subscribers}
            for wire in node.outputs.values()
        ],
        "params": params_of(node),
    }


def node_text(about: Mapping[str, Any]) -> str:
    """The same for people."""
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
    for one in about["subscribes"]:
        yield f"    {one['topic']}  {one['type']}  from {one['publisher']}"
    yield "  publishes"
    for one in about["publishes"]:
        to = ", ".join(one["subscribers"]) or "nobody"
        yield from textwrap.wrap(
            f"{one['topic']}  {one['type']}  to {to}",
            TEXT_WIDTH,
            initial_indent=" " * 4,
            subsequent_indent=" " * 8,
        )


class StatusSample(NamedTuple):
    """The last words of one node about itself."""

    status: NodeStatus  # The latest
    load: float | None  # Share of one processor since the word before; None if there was none


def sample_status(card: RunCard, names: Collection[str]) -> dict[str, StatusSample]:
    """What these nodes publish of themselves; twice each, unless the patience ends."""
    found: dict[str, StatusSample] = {}
    sent: dict[str, int] = {}
    topic = Topic(bus.STATUS_TOPIC, NodeStatus.__name__, tuple(names), ())
    until = time.monotonic() + STATUS_PATIENCE
    with TapSubscription(card, [topic]) as taps:
        while (left := until - time.monotonic()) > 0 and not all(
            name in found and found[name].load is not None for name in names
        ):
            for received in taps.take(left):
                status, when = decode(NodeStatus, received.body), received.header.sent_ns
                before, was = found.get(received.publisher), sent.get(received.publisher, 0)
                load = None
                if before is not None and status.cpu >= before.status.cpu:
                    load = (status.cpu - before.status.cpu) / (1e-9 * (when - was))
                found[received.publisher], sent[received.publisher] = (
                    StatusSample(status, load),
                    when,
                )
    return found


def dump_params(card: RunCard, name: str | None = None) -> dict[str, Any]:
    """Parameters of one node or of all, ``node: {params: ...}``; bytes by their size and SHA-256.

    Raises ValueError if the graph has no such node.
    """
    nodes = card.nodes if name is None else (find_node(card, name),)
    return {one.name: {"params": params_of(one)} for one in nodes}


def find_node(card: RunCard, name: str) -> RecordedNode:
    """The node of this name, which may begin with a slash; raises ValueError if there is none."""
    nodes = {one.name: one for one in card.nodes}
    wanted = name.removeprefix("/")
    if wanted not in nodes:
        raise ValueError(f"the graph has no node {wanted!r}; {hint(wanted, nodes)}")
    return nodes[wanted]


def params_of(node: RecordedNode) -> Any:
    """A node's parameters as plain values, long texts by size and hash."""
    return _short(msgspec.json.decode(node.params))


def _short(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_short(item) for item in value]
    if not isinstance(value, str) or len(value) <= LONG_TEXT:
        return value
    try:  # bytes are base64 in the card
        data, what = base64.b64decode(value, validate=True), "bytes"
    except ValueError:
        data, what = value.encode(), "bytes of text"
    return f"{len(data)} {what}, sha256 {hashlib.sha256(data).hexdigest()}"


def notify(card: RunCard, kind: str, **fields: Any) -> None:
    """Send a request to the launcher of a running graph, without waiting for an answer."""
    with _control_line(card) as line:
        line.send(kind, **fields)
        line.close()


def request(card: RunCard, kind: str, **fields: Any) -> bus.ControlMessage:
    """Ask the launcher of a running graph, and return what it answers.

    A node that is just being started, or started again, is waited for. Raises ValueError if it
    refuses, or gives no answer.
    """
    deadline = time.monotonic() + REQUEST_PATIENCE
    with _control_line(card) as line:
        while True:
            line.send(kind, **fields)
            left = max(deadline - time.monotonic(), 0.1)
            answer = line.receive() if line.socket.poll(int(1000 * left)) else None
            if answer is None:
                raise ValueError(
                    f"run {card.run[:6]} ({card.name}) gives no answer within "
                    f"{REQUEST_PATIENCE:g} s; it is busy or stopped"
                )
            if answer["kind"] != "not_ready" or time.monotonic() > deadline:
                break
            time.sleep(RETRY)
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
        players = [one.name for one in card.nodes if one.module == PLAYER_MODULE]
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
    """Have the node that publishes a topic publish a message, its fields in YAML.

    It is published so many times, or until Ctrl-C. InputError if no such graph runs or no node of
    it publishes the topic, or the body is no such message.
    """
    if not rate > 0.0:
        raise InputError(f"--rate must be positive, got {rate:g}")
    with as_input_errors():
        card = find_run(run)
        found = find_topic(card, topic)
        if found.name in STATUS_TOPICS:
            raise ValueError(f"{found.name} is what nodes say of themselves; nothing can be added")
        cls = type_of(found)
        fields = parse_yaml(body, "BODY").value
        if not isinstance(fields, dict):
            raise ValueError(f"BODY must be a map of fields in YAML, got {body!r:.60}")
        data = encode(message_from_plain(cls, fields))
        for number in range(times) if times is not None else count():
            if number:
                time.sleep(1.0 / rate)
            request(card, "publish", node=found.publishers[0], topic=found.name, body=data)
            echo(f"published {cls.__name__} on {found.name}")


def message_from_plain(cls: type, values: Mapping[str, Any]) -> object:
    """The message of a type whose fields have these values; lists become arrays.

    Raises ValueError if fields are missing or unknown, or a list is no such array. What else may be
    wrong is found when the message is encoded.
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
