"""Template of a planner: single touches, each where the largest error is expected. Adapt it.

Name it in a scene, and start palpate in the folder of this file:

    explore:
      planner: template:Template
      settings: {least_gain: 0.001}

`observation.surface`, a `palpate.planning.ObservedSurface`, is the solid rebuilt so far: its
triangles, their expected errors, and `offers`, touches that the finger can reach on a free path. A
planner has no memory: it decides from `observation` alone, so that a recorded run can be planned
again. Lengths are in m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from palpate.core.plugins import Range, check_ranges
from palpate.planning import (
    Choice,
    Height,
    Observation,
    ObservedSurface,
    Stop,
    Touch,
    Wait,
    estimate_error,
    exhausted_budget,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """Touches the places with the largest expected error until all limits are kept."""

    single_touches: ClassVar[bool] = True  # no slices but the first; the solid can have any shape
    # Smallest gain of a touch, as a share of the demanded squared error over the whole surface.
    least_gain: Annotated[float, Range(0.0, 1.0, "1")] = 0.001

    def __post_init__(self) -> None:
        check_ranges(self)

    def next(self, observation: Observation) -> Choice:
        """The next touch, or a reason to stop or wait; called when a touch is finished."""
        exhausted = exhausted_budget(observation)
        if exhausted is not None:
            return Stop(exhausted)
        surface = observation.surface
        if surface is not None:
            return self._next_on(surface, observation)
        if observation.busy_heights:
            return Wait("other fingers are at work")
        if observation.slices:
            return Stop("there is no solid whose surface could be touched")
        return Height(0.5 * (observation.low + observation.high), "there is no solid yet")

    def _next_on(self, surface: ObservedSurface, observation: Observation) -> Choice:
        if estimate_error(observation).reached:
            return Stop("every limit is kept")
        # Gain of a touch: the squared errors at its places, or only those far from all touches.
        left = surface.left(observation.tried)
        wanted = self.least_gain * observation.tolerance**2 * len(left)
        if surface.rms_bound_95 <= observation.tolerance:
            left, wanted = np.where(surface.away, left, 0.0), 0.0
        gains = [float(left[offer.places].sum()) for offer in surface.offers]
        if max(gains, default=0.0) <= wanted:
            return Stop("no further touch would reduce the error much")
        best = surface.offers[int(np.argmax(gains))]
        return Touch(best.pose, best.reach, best.target, "most of the error is expected there")
