"""The uniform planner: slices at even heights, in an order of one's choice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from palpate.core.explore.planners import protocol
from palpate.core.plugins import Range, check_ranges

TRIES = 2  # For each height; the second one is a quarter of the spacing nearer to the middle
REACH = 0.3  # Of the spacing: slices so near to a height were meant for it


@dataclass(frozen=True, slots=True, kw_only=True)
class Uniform:
    """So many slices, whatever they bring."""

    count: Annotated[int, Range(1, 1000, "1")] = 9  # Slices
    # From the middle up and then from it down; or nested, so that every beginning is even.
    order: Literal["sweep", "nested"] = "sweep"

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.order not in ("sweep", "nested"):
            raise ValueError(f"order must be sweep or nested, got {self.order!r}")

    def next(self, observation: protocol.Observation) -> protocol.Choice:
        """The first height in the order that has neither its slice nor all its tries."""
        over = protocol.exhausted_budget(observation)
        if over is not None:
            return protocol.Stop(over)
        low, high = protocol.first_and_last(observation)
        middle = 0.5 * (low + high)
        heights = np.linspace(low, high, self.count) if self.count > 1 else np.array([middle])
        spacing = (high - low) / max(self.count - 1, 1)
        made = np.array([one.height for one in observation.slices])
        usable = np.array([one.usable for one in observation.slices], np.bool_)
        visited = np.abs(heights[:, None] - made) <= REACH * spacing
        tries, busy = visited.sum(axis=1), np.array(observation.busy_heights)
        done = (visited & usable).any(axis=1) | (tries >= TRIES)
        done |= (np.abs(heights[:, None] - busy) <= REACH * spacing).any(axis=1)
        waits = False
        for i in sweep(self.count) if self.order == "sweep" else nested(self.count):
            if done[i]:
                continue
            wanted = float(heights[i])
            if tries[i]:
                wanted += 0.25 * spacing * (1.0 if wanted < middle else -1.0)
            if protocol.was_asked(observation, wanted):
                continue  # the ends have been moved since, and another height with them
            if not protocol.is_near_finger(observation, wanted):
                return protocol.Height(wanted, f"slice {i + 1} of {self.count} even ones")
            waits = True
        if waits:
            return protocol.Wait("other fingers are too near to the heights that are left")
        return protocol.Stop(f"all {self.count} heights have been visited")

    def settled(self, observation: protocol.Observation) -> protocol.Choice:
        """The same: no model has a say in it."""
        return self.next(observation)


def sweep(count: int) -> list[int]:
    """Places from the middle up, then from below it down."""
    middle = count // 2
    return [*range(middle, count), *range(middle - 1, -1, -1)]


def nested(count: int) -> list[int]:
    """The middle, both ends, and then the middles of what is between."""
    middle = count // 2
    order = [middle, count - 1, 0]
    pairs = [(middle, count - 1), (0, middle)]
    while pairs:
        low, high = pairs.pop(0)
        if high - low > 1:
            between = (low + high) // 2
            order.append(between)
            pairs += [(between, high), (low, between)]
    return list(dict.fromkeys(order))
