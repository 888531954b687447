"""Publishes what a user typed, through the console of a running graph."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count
from typing import Any

from palpate.launch.located import InputError
from palpate.launch.looking.ask import ask
from palpate.launch.looking.plain import from_plain
from palpate.launch.nearest import hint
from palpate.launch.processes.register import Card, find_run
from palpate.launch.yaml_file import parse_yaml
from palpate.messages.codec import encode
from palpate.messages.types import TYPES
from palpate.nodes.node import Source
from palpate.nodes.wiring import load_node


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
        data = encode(from_plain(cls, _fields(body)))
        for number in range(times) if times is not None else count():
            if number:
                time.sleep(1.0 / rate)
            ask(card, "publish", node=node, topic=topic, body=data)
            echo(f"published {cls.__name__} on {topic}")
    except ValueError as error:
        raise InputError(str(error)) from None


def _console(card: Card, topic: str) -> str:
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


def _fields(body: str) -> dict[str, Any]:
    value = parse_yaml(body, "BODY").value
    if not isinstance(value, dict):
        raise ValueError(f"BODY must be a map of fields in YAML, got {body!r:.60}")
    return value
