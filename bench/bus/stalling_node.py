"""A node that subscribes to a flood, stalls now and then.

And counts what is missing or out of turn.
"""

from __future__ import annotations

import multiprocessing
import time
from dataclasses import dataclass, replace

import msgspec

from palpate.messages.types import Clock
from palpate.nodes.runtime import Finished, Input, Node, Outputs, Wiring

MODULE = "palpate.bench.bus.stalling_node"
SOURCE, TOPIC = "source", "/flood"


class StallingParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a listener does."""

    expects: int  # Messages that will be said, numbered by their times in ms
    # Messages at which it stands still, and for how long, s.
    stalls: tuple[tuple[int, float], ...] = ()
    late: float = 0.0  # Time after which its process begins to join, s

    def __post_init__(self) -> None:
        if multiprocessing.parent_process() is not None:
            time.sleep(self.late)


@dataclass(frozen=True, slots=True)
class FloodCount:
    """What was heard so far."""

    number: int = 0  # Messages
    latest: int = -1  # Highest number
    early: int = 0  # Numbers that were left out when a higher one came
    again: int = 0  # Messages with a number that is not higher than the one before


def _on_message(
    params: StallingParams, heard: FloodCount, message: Clock
) -> tuple[FloodCount, Outputs]:
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
    params=StallingParams,
    start=lambda params: (FloodCount(), []),
    inputs={"/in": (Clock, _on_message)},
    outputs={},
    longest=5.0,
)


def listener(name: str, params: StallingParams) -> Wiring:
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
