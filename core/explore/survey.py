"""Everything that an exploration has found so far, in the slicing frame, as a value.

The planner node keeps one; a rule is told of it as `Known`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.approach import APPROACH, approach
from palpate.core.explore.planners.known import LEAST_FEATURE, Budget, Known
from palpate.core.explore.planners.measured import Traced, measured_slices

APART = 1.5
"""Height between the slices of two fingers, in widths of a pad."""


class Demand(NamedTuple):
    """What is asked of an exploration."""

    tolerance: float
    """Root mean square error, m."""
    feature: float
    """Largest height that may stay unfelt, m."""
    most_touches: float
    """Touches that may be made."""
    most_seconds: float
    """Robot time that may pass, s."""


class Doubt(NamedTuple):
    """What the last model says of its own errors."""

    heights: Floats
    """(n,), m."""
    deviations: Floats
    """Standard deviation of the side there, (n,), m."""
    whole: float
    """Of the whole surface, ends included, m."""
    pose: float = 0.0
    """Standard deviation of a touch's place, m."""
    starlike: bool = True
    """False if it had to be rebuilt from contours alone, for its slices are not star-shaped."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Survey:
    """What is known of an object."""

    low: float
    """Where it begins along the slicing axis, m."""
    high: float
    """Where it ends, m."""
    low_deviation: float
    """Standard deviation of `low`, m; 0 once it was touched."""
    high_deviation: float
    """Of `high`."""
    radius: float
    """Largest distance of its surface from the axis, as the first contacts let expect, m."""
    pad_width: float
    """Of a finger, m."""
    resolution: float
    """Smallest difference that the sensor tells, m."""
    standing: bool
    """Whether it stands on its lower end, so that this is known."""
    reached: tuple[float, float]
    """Lowest and highest height at which anything was felt, m."""
    traced: tuple[Traced, ...] = ()
    """Slices in the order in which they were taken up."""
    tips: tuple[Floats, ...] = ()
    """Where ends were touched, the farthest place of each, (3,), m."""
    doubt: Doubt | None = None
    """Of the last model."""

    def known(
        self, demand: Demand, *, touches: int, seconds: float, taken: tuple[float, ...] = ()
    ) -> Known:
        """What a rule is told.

        Parameters
        ----------
        demand : Demand
            What is asked for.
        touches, seconds : int, float
            What is spent; robot time in s.
        taken : tuple of float
            Heights at which fingers are at work, m.
        """
        budget = Budget(
            most_touches=demand.most_touches,
            most_seconds=demand.most_seconds,
            touches=touches,
            seconds=seconds,
        )
        return Known(
            low=self.low,
            high=self.high,
            low_deviation=self.low_deviation,
            high_deviation=self.high_deviation,
            tolerance=demand.tolerance,
            resolution=self.resolution,
            feature=max(demand.feature, LEAST_FEATURE * (self.high - self.low)),
            budget=budget,
            slices=measured_slices(self.traced, self._deviations()),
            taken=taken,
            apart=self.apart,
            taxels=True,
            deviation=None if self.doubt is None else self.doubt.whole,
        )

    @property
    def apart(self) -> float:
        """Height that two fingers keep between them, m."""
        return APART * self.pad_width

    def approach(self, height: float) -> tuple[Floats, float]:
        """Where the middle of a slice is expected, (2,), and from how far to come, m."""
        contours = [one for one in self.traced if one.usable]
        if not contours:
            return np.zeros(2), self.radius + APPROACH
        heights, points = [one.height for one in contours], [one.points for one in contours]
        return approach(height, heights, points, self.tips)

    def outermost(self, *, upper: bool) -> Traced | None:
        """The usable contour nearest to an end; None while there is none."""
        contours = [one for one in self.traced if one.usable]
        if not contours:
            return None
        return (max if upper else min)(contours, key=lambda one: one.height)

    def with_slice(self, traced: Traced) -> Survey:
        """With one slice more."""
        survey = replace(self, traced=(*self.traced, traced))
        if not traced.usable:
            return survey
        return survey.reaching(float(traced.felt_low.min()), float(traced.felt_high.max()))

    def reaching(self, low: float, high: float) -> Survey:
        """With something felt at these heights, m: the object reaches at least as far."""
        low, high = min(low, self.reached[0]), max(high, self.reached[1])
        below = self.low if self.standing else min(self.low, low)
        return replace(self, reached=(low, high), low=below, high=max(self.high, high))

    def ended(self, tip: Floats, *, upper: bool) -> Survey:
        """With an end that was touched in this place, (3,); what was felt beyond still counts."""
        height = float(tip[2])
        middle = 0.5 * (self.low + self.high)
        others = tuple(one for one in self.tips if (one[2] > middle) != upper)
        survey = replace(self, tips=(*others, tip))
        if upper:
            return replace(survey, high=max(height, self.reached[1]), high_deviation=0.0)
        return replace(survey, low=min(height, self.reached[0]), low_deviation=0.0)

    def _deviations(self) -> tuple[float, ...]:
        if self.doubt is None or not len(self.doubt.heights):
            return (0.0,) * len(self.traced)
        at = [one.height for one in self.traced]
        found = np.interp(at, self.doubt.heights, self.doubt.deviations)
        return tuple(found.tolist())
