"""A node that hears a flood, stalls now and then, and counts what is wrong with what it hears."""

from __future__ import annotations

import multiprocessing
import time
from dataclasses import dataclass, replace

import msgspec

from palpate.messages.types import Clock
from palpate.nodes.node import Finished, Node, Outputs
from palpate.nodes.wiring import Input, Wiring

MODULE = "palpate.launch.bench_listener"
SOURCE, TOPIC = "source", "/flood"


class Params(msgspec.Struct, frozen=True, kw_only=True):
    """What a listener does."""

    expects: int
    """Messages that will be said, numbered by their times in ms."""
    stalls: tuple[tuple[int, float], ...] = ()
    """Messages at which it stands still, and for how long, s."""
    late: float = 0.0
    """Time after which its process begins to join, s."""

    def __post_init__(self) -> None:
        if multiprocessing.parent_process() is not None:
            time.sleep(self.late)


@dataclass(frozen=True, slots=True)
class Heard:
    """What was heard so far."""

    number: int = 0
    """Messages."""
    latest: int = -1
    """Highest number."""
    early: int = 0
    """Numbers that were left out when a higher one came."""
    again: int = 0
    """Messages with a number that is not higher than the one before."""


def _on_message(params: Params, heard: Heard, message: Clock) -> tuple[Heard, Outputs]:
    number = round(1000.0 * message.time)
    for place, seconds in params.stalls:
        if place == number:
            time.sleep(seconds)
    if number > heard.latest:
        left_out = number - heard.latest - 1
        heard = replace(heard, latest=number, early=heard.early + left_out)
    else:
        heard = replace(heard, again=heard.again + 1)
    heard = replace(heard, number=heard.number + 1)
    if heard.number < params.expects:
        return heard, []
    said = f"{heard.number} heard, {heard.early} left out, {heard.again} out of turn"
    return heard, [Finished(said)]


NODE = Node(
    params=Params,
    start=lambda params: (Heard(), []),
    inputs={"/in": (Clock, _on_message)},
    outputs={},
    longest=5.0,
)


def listener(name: str, params: Params) -> Wiring:
    """Wiring of a listener to the flood."""
    return Wiring(
        name=name,
        module=MODULE,
        params=params,
        inputs=(Input(SOURCE, TOPIC, "/in", "Clock"),),
        outputs={},
        listeners={},
        longest=NODE.longest,
    )
