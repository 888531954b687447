"""The thesis' planner: steps by curvature and its change, (3.1), (3.2), (3.28), (3.34), (3.35).

A step is a share of the height: s = (most - least) shape + least. The shape is a product of two
templates, one of the curvature and one of its change, (3.28), or one template of a sum of both:
section 6.1 asks for forms that cannot be separated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

import numpy as np

from palpate.core.explore.planners.choice import Choice
from palpate.core.explore.planners.hats import Polyline, polyline_of
from palpate.core.explore.planners.known import Known
from palpate.core.explore.planners.templates import TEMPLATES, Template
from palpate.core.explore.planners.walk import Ends, walk
from palpate.core.ranges import Range, check_ranges

MOST_BENT = 40.0
"""The piecewise linear form reaches so far, in rate times curvature times height."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Thesis:
    """The step rule. The text gives no constants: these are ours."""

    template: Template = "exponential"
    """How a step falls with curvature."""
    form: Literal["product", "joint"] = "product"
    """Two templates multiplied, or one of the sum."""
    bend_rate: Annotated[float, Range(0.0, 1e3, "1")] = 0.15
    """Times mean curvature times height."""
    change_rate: Annotated[float, Range(0.0, 1e3, "1")] = 0.3
    """Times the change of that."""
    power: Annotated[float, Range(0.1, 10.0, "1")] = 1.0
    """Of the inverse power; one less than the constant of the logarithm."""
    least: Annotated[float, Range(1e-3, 0.5, "1")] = 0.02
    """Smallest step, over the height; approached, never reached."""
    most: Annotated[float, Range(1e-3, 0.5, "1")] = 0.2
    """Largest step, over the height."""
    caution: Annotated[float, Range(0.0, 100.0, "1")] = 1.0
    """eta of (3.1): the larger, the shorter the first step."""
    threshold: Annotated[float, Range(0.0, 0.5, "1")] = 0.0
    """A step upwards below this share of the height ends the search; 0: the object's end does."""
    perimeter: Annotated[float, Range(0.0, 1.0, "1")] = 0.1
    """A contour shorter than this share of the height ends the search."""
    fading: Annotated[float, Range(0.1, 1.0, "1")] = 1.0
    """By which steps shrink from slice to slice: the fifth heuristic, which no formula has."""
    segments: Annotated[int, Range(0, 100, "1")] = 0
    """Of the piecewise linear form; 0: the templates themselves."""

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.template not in TEMPLATES:
            raise ValueError(f"template must be one of {sorted(TEMPLATES)}, got {self.template!r}")
        if self.form not in ("product", "joint"):
            raise ValueError(f"form must be product or joint, got {self.form!r}")
        if self.most < self.least:
            raise ValueError(f"most must be at least least, {self.least}, got {self.most}")

    def next(self, known: Known) -> Choice:
        """The next slice of the search, or that it has ended."""
        return walk(known, self, Ends(self.threshold, self.perimeter))

    def first(self, bend: float) -> float:
        """Step from half height, (3.1), over the height; no smaller than the others may be."""
        step = self._falling(self.bend_rate * bend) / (2.0 * (1.0 + self.caution))
        return max(step, self.least)

    def later(self, bend: float, change: float, count: int) -> float:
        """Any other step, (3.2), over the height."""
        bent, changed = self.bend_rate * bend, self.change_rate * change
        if self.form == "joint":
            shape = self._falling(bent + changed)
        else:
            shape = self._falling(bent) * self._falling(changed)
        return self.least + (self.most - self.least) * shape * self.fading**count

    def _falling(self, x: float) -> float:
        if self.segments:
            return _polyline(self.template, self.power, self.segments).at(x)
        return TEMPLATES[self.template](np.array([x]), self.power).item()


@cache
def _polyline(template: Template, power: float, segments: int) -> Polyline:
    return polyline_of(lambda x: TEMPLATES[template](x, power), MOST_BENT, segments)


PLANNER = Thesis
