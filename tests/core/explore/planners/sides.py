"""Round bodies with simple formulas, what a planner observes of them, and whole explorations."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.core.explore import planners
from palpate.core.explore.planners import Estimate, Observation, ObservedSlice, SliceOutcome, Stop

Side = Callable[[float], float]  # Radius over the height, both as shares of the height
HEIGHT = 0.09  # Of every body [m]
BAND = 7e-3  # Touched above and below a slice, along the surface [m]
STEP = 1e-4
CONTOUR = ("radii", "slopes", "curvatures", "contact_low", "contact_high")
SIDES: dict[str, Side] = {
    "vase": lambda z: float(0.28 + 0.09 * np.sin(8.5 * z + 0.4)),
    "bottle": lambda z: float(0.35 - 0.11 * (1.0 + np.tanh((z - 0.7) / 0.04))),
    "ball": lambda z: float(np.sqrt(max(z * (1.0 - z), 1e-9))),
    "cylinder": lambda z: 0.3,
}
CYLINDER = SIDES["cylinder"]


def slice_of(
    side: Side, share: float, unit: float = 1.0, base: float = 0.0, **changes: Any
) -> ObservedSlice:
    """A slice of a round body that stands at height `base`, in units of 1 / `unit` m."""
    size = HEIGHT * unit
    below, here, above = (side(share + d) for d in (-STEP, 0.0, STEP))
    slope = (above - below) / (2.0 * STEP)
    bend = -(above - 2.0 * here + below) / STEP**2 / (1.0 + slope**2) ** 1.5
    reach, height = BAND * unit / np.sqrt(1.0 + slope**2), base + share * size
    values = here * size, slope, bend / size, height - reach, height + reach
    fields = {name: np.full(16, value) for name, value in zip(CONTOUR, values, strict=True)}
    defaults = {"height": height, "outcome": SliceOutcome.CLOSED, **fields}
    return ObservedSlice(**(defaults | changes))


def slices_of(side: Side, shares: Sequence[float], **changes: Any) -> list[ObservedSlice]:
    return [slice_of(side, share, **changes) for share in shares]


def failed(height: float, outcome: SliceOutcome = SliceOutcome.FAILED) -> ObservedSlice:
    return planners.slice_without_contour(height, outcome)


def known(
    slices: Sequence[ObservedSlice] = (), unit: float = 1.0, base: float = 0.0, **changes: Any
) -> Observation:
    fields = {
        "low": base,
        "high": base + HEIGHT * unit,
        "tolerance": 0.0025 * HEIGHT * unit,
        "resolution": 1e-5 * unit,
        "feature": 2.5e-3 * unit,
        "slices": tuple(slices),
    }
    return Observation(**(fields | changes))


@dataclass(frozen=True)
class Says:
    """A planner that always gives the same answer."""

    choice: Any

    def next(self, observation: Observation) -> planners.Choice:
        return self.choice


def explore(
    planner: planners.Planner,
    side: Side,
    unit: float = 1.0,
    base: float = 0.0,
    top: float = 1.0,
    **changes: Any,
) -> tuple[list[float], Stop, Estimate]:
    """Heights asked for, as shares, why it ended, and what is known then."""
    slices: list[ObservedSlice] = []
    shares: list[float] = []
    while True:
        observation = known(slices, unit, base, **changes)
        choice = planner.next(observation)
        if not isinstance(choice, planners.Height):
            assert isinstance(choice, Stop)
            return shares, choice, planners.estimate_error(observation)
        shares.append((choice.height - base) / (HEIGHT * unit))
        assert len(shares) <= 60
        if shares[-1] < top:
            slices.append(slice_of(side, shares[-1], unit, base))
        else:
            slices.append(failed(choice.height, SliceOutcome.LOST))
