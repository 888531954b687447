"""Template of a planner: single touches, each where most of the error is expected. Make it yours.

Name it in a scene, and start palpate in the folder of this file:

    explore:
      planner: template:Template
      settings: {least_gain: 0.001}

It is told of the solid as it is known: `observation.surface`, a `palpate.planning.ObservedSurface`,
has its triangles, the errors that are expected, and `offers`: touches that can be made, on a free
way for the finger. It remembers nothing: all that it goes by is in `observation`, so that a
recorded run can be planned again. Lengths are in m.
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
    """Touches what is known worst until every limit is kept."""

    single_touches: ClassVar[bool] = True  # No slices but the first: the solid may have any shape
    # A touch must take this share of the squared error that is asked for, over the whole surface.
    least_gain: Annotated[float, Range(0.0, 1.0, "1")] = 0.001

    def __post_init__(self) -> None:
        check_ranges(self)

    def next(self, observation: Observation) -> Choice:
        """The next touch, or that there is none: called whenever one has come back."""
        over = exhausted_budget(observation)
        if over is not None:
            return Stop(over)
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
        # What each touch would take: of squared errors, or of what lies far from any touch.
        left = surface.left(observation.tried)
        wanted = self.least_gain * observation.tolerance**2 * len(left)
        if surface.rms_bound_95 <= observation.tolerance:
            left, wanted = np.where(surface.away, left, 0.0), 0.0
        gains = [float(left[offer.places].sum()) for offer in surface.offers]
        if max(gains, default=0.0) <= wanted:
            return Stop("no touch is left that would tell much more")
        best = surface.offers[int(np.argmax(gains))]
        return Touch(best.pose, best.reach, best.target, "most of the error is expected there")
