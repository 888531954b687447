"""Requests to the launcher of a running graph: its status, a player, a console."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Mapping
from itertools import count
from typing import Any, get_type_hints

import numpy as np

from palpate.launch.files import InputError, hint, parse_yaml
from palpate.launch.processes import RunCard, find_run
from palpate.messages import Array, encode
from palpate.messages.bus import TO_TOOLS, ControlClient, ControlMessage, SocketContext
from palpate.messages.types import TYPES
from palpate.nodes.runtime import Source, load_node

REQUEST_PATIENCE = 5.0  # Who does not answer for so long is busy, or stopped, s
RETRY = 0.02  # A node that is not up is asked for again after this long, s
PLAYER_MODULE = "palpate.nodes.player"


def notify(card: RunCard, kind: str, **fields: Any) -> None:
    """Say a word to the launcher of a running graph, without waiting for an answer."""
    wires = SocketContext(card.key)
    line = _line(wires, card)
    line.send(kind, **fields)
    line.close()
    wires.close()


def request(card: RunCard, kind: str, **fields: Any) -> ControlMessage:
    """Ask the launcher of a running graph, and return what it answers.

    A node that is just being started, or started again, is waited for.

    Raises
    ------
    ValueError
        If it refuses, or gives no answer.
    """
    deadline = time.monotonic() + REQUEST_PATIENCE
    wires = SocketContext(card.key)
    line = _line(wires, card)
    try:
        while True:
            line.send(kind, **fields)
            answer = _answer(line, card, deadline)
            if answer["kind"] != "not_ready" or time.monotonic() > deadline:
                break
            time.sleep(RETRY)
    finally:
        line.socket.close(0)
        wires.close()
    if answer["kind"] in ("refused", "not_ready"):
        raise ValueError(str(answer["text"]))
    return answer


def _line(wires: SocketContext, card: RunCard) -> ControlClient:
    return ControlClient(
        wires.context,
        card.tools,
        name=f"tool {os.getpid()} {os.urandom(4).hex()}",
        accepts=TO_TOOLS,
    )


def _answer(line: ControlClient, card: RunCard, deadline: float) -> ControlMessage:
    left = deadline - time.monotonic()
    answer = line.receive() if line.socket.poll(int(1000 * max(left, 0.1))) else None
    if answer is None:
        raise ValueError(
            f"run {card.run[:6]} ({card.name}) gives no answer within {REQUEST_PATIENCE:g} s; "
            "it is busy or stopped"
        )
    return answer


def control_player(run: str | None, kind: str, **fields: Any) -> None:
    """Say a word to the player of a running graph.

    Raises
    ------
    InputError
        If no such graph runs, it has no player or several, or the word is refused.
    """
    try:
        card = find_run(run)
        request(card, kind, node=_player(card), **fields)
    except ValueError as error:
        raise InputError(str(error)) from None


def _player(card: RunCard) -> str:
    players = [one.name for one in card.nodes if one.module == PLAYER_MODULE]
    if len(players) != 1:
        has = ", ".join(players) or "none"
        raise ValueError(f"run {card.run[:6]} ({card.name}) must have one player, it has {has}")
    return players[0]


def publish(
    topic: str,
    body: str,
    *,
    rate: float,
    times: int | None,
    run: str | None,
    echo: Callable[[str], None],
) -> None:
    """Publish a message on a console's topic, once or again and again.

    Parameters
    ----------
    topic : str
        The topic, on the wire.
    body : str
        The message's fields, in YAML.
    rate : float
        Messages in a second.
    times : int or None
        How many; None until Ctrl-C.
    run : str or None
        Which running graph; None for the latest.
    echo : function
        Prints a line.

    Raises
    ------
    InputError
        If no such graph runs, the topic is not a console's, or the body is no such message.
    """
    if not rate > 0.0:
        raise InputError(f"--rate must be positive, got {rate:g}")
    try:
        card = find_run(run)
        node = _console(card, topic)
        cls = TYPES[card.topics[topic]]
        data = encode(message_from_plain(cls, _fields(body)))
        for number in range(times) if times is not None else count():
            if number:
                time.sleep(1.0 / rate)
            request(card, "publish", node=node, topic=topic, body=data)
            echo(f"published {cls.__name__} on {topic}")
    except ValueError as error:
        raise InputError(str(error)) from None


def _console(card: RunCard, topic: str) -> str:
    """The node that publishes a topic, if tools may speak for it."""
    name = card.publishers.get(topic)
    if name is None:
        raise ValueError(
            f"run {card.run[:6]} ({card.name}) has no topic {topic!r}; {hint(topic, card.topics)}"
        )
    module = next(one.module for one in card.nodes if one.name == name)
    node = load_node(module)
    if not (isinstance(node, Source) and node.outside):
        raise ValueError(
            f"{topic} is published by {name}, and a topic has one publisher; only the topics of a "
            "console in the launch file can be published from outside"
        )
    return name


def message_from_plain(cls: type, values: Mapping[str, Any]) -> object:
    """The message of a type whose fields have these values; lists become arrays.

    Raises
    ------
    ValueError
        If fields are missing or unknown, or a list is no such array. What else may be wrong is
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


def _fields(body: str) -> dict[str, Any]:
    value = parse_yaml(body, "BODY").value
    if not isinstance(value, dict):
        raise ValueError(f"BODY must be a map of fields in YAML, got {body!r:.60}")
    return value
