"""The uniform planner: slices at even heights, in an order that the user chooses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.explore.planners import protocol
from palpate.core.plugins import Range, check_ranges


@dataclass(frozen=True, slots=True, kw_only=True)
class Uniform:
    """A number of slices, whatever they bring."""

    count: Annotated[int, Range(1, 1000, "1")] = 9  # slices
    # "sweep": from the middle up, then from below it down; "nested": every beginning is even.
    order: Literal["sweep", "nested"] = "sweep"

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.order not in ("sweep", "nested"):
            raise ValueError(f"order must be sweep or nested, got {self.order!r}")

    def next(self, observation: protocol.Observation) -> protocol.Choice:
        """The first height in the order that has neither its slice nor two tries.

        The second try lies a quarter of the spacing nearer to the middle.
        """
        spent = protocol.exhausted_budget(observation)
        if spent is not None:
            return protocol.Stop(spent)
        low, high = protocol.first_and_last(observation)
        middle = 0.5 * (low + high)
        heights = np.linspace(low, high, self.count) if self.count > 1 else np.array([middle])
        spacing = (high - low) / max(self.count - 1, 1)
        tries, is_done = _visits(observation, heights, spacing)
        has_to_wait = False
        for i in sweep(self.count) if self.order == "sweep" else nested(self.count):
            if is_done[i]:
                continue
            wanted = float(heights[i])
            if tries[i]:
                wanted += 0.25 * spacing * (1.0 if wanted < middle else -1.0)
            if protocol.was_asked(observation, wanted):
                continue  # the ends have been moved since, and another height with them
            if not protocol.is_near_finger(observation, wanted):
                return protocol.Height(wanted, f"slice {i + 1} of {self.count} even ones")
            has_to_wait = True
        if has_to_wait:
            return protocol.Wait("other fingers are too near to the heights that are left")
        return protocol.Stop(f"all {self.count} heights have been visited")

    def settled(self, observation: protocol.Observation) -> protocol.Choice:
        """The same as `next`: it depends on no model."""
        return self.next(observation)


def _visits(
    observation: protocol.Observation, heights: Floats, spacing: float, reach: float = 0.3
) -> tuple[Ints, Bools]:
    """How often each height (n,) was tried, and whether nothing is left to do there.

    `reach`: fraction of the spacing within which a slice was meant for a height.
    """
    made = np.array([part.height for part in observation.slices])
    usable = np.array([part.usable for part in observation.slices], np.bool_)
    is_visited = np.abs(heights[:, None] - made) <= reach * spacing
    tries, busy = is_visited.sum(axis=1, dtype=np.int32), np.array(observation.busy_heights)
    is_done: Bools = (is_visited & usable).any(axis=1) | (tries >= 2)
    is_done |= (np.abs(heights[:, None] - busy) <= reach * spacing).any(axis=1)
    return tries, is_done


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
