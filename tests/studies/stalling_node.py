"""A node that subscribes to a flood, stalls now and then, and counts what is missing or late."""

from __future__ import annotations

import multiprocessing
import time
from dataclasses import dataclass, replace

import msgspec

from palpate.messages.types import Clock
from palpate.nodes.runtime import Finished, Input, Node, Outputs, Wiring

MODULE = __name__
SOURCE, TOPIC = "source", "/flood"


class StallingParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a subscriber does."""

    expects: int  # Messages that will be published, numbered by their times in ms
    # Messages at which it stands still, and for how long, s.
    stalls: tuple[tuple[int, float], ...] = ()
    late: float = 0.0  # Time after which its process begins to join, s

    def __post_init__(self) -> None:
        if multiprocessing.parent_process() is not None:
            time.sleep(self.late)


@dataclass(frozen=True, slots=True)
class FloodCount:
    """What was received so far."""

    number: int = 0  # Messages
    latest: int = -1  # Highest number
    missing: int = 0  # Numbers that were left out when a higher one came
    late: int = 0  # Messages with a number that is not higher than the one before


def _on_message(
    params: StallingParams, count: FloodCount, message: Clock
) -> tuple[FloodCount, Outputs]:
    number = round(1000.0 * message.time)
    for place, seconds in params.stalls:
        if place == number:
            time.sleep(seconds)
    if number > count.latest:
        count = replace(count, latest=number, missing=count.missing + number - count.latest - 1)
    else:
        count = replace(count, late=count.late + 1)
    count = replace(count, number=count.number + 1)
    if count.number < params.expects:
        return count, []
    told = f"{count.number} received, {count.missing} missing, {count.late} out of turn"
    return count, [Finished(told)]


NODE = Node(
    params=StallingParams,
    start=lambda params: (FloodCount(), []),
    inputs={"/in": (Clock, _on_message)},
    outputs={},
    handler_timeout=5.0,
)


def subscriber(name: str, params: StallingParams) -> Wiring:
    """Wiring of a subscriber to the flood."""
    return Wiring(
        name=name,
        module=MODULE,
        params=params,
        inputs=(Input(SOURCE, TOPIC, "/in", "Clock"),),
        outputs={},
        subscribers={},
        handler_timeout=NODE.handler_timeout,
    )
