"""The thesis' planner: steps by curvature and its change, (3.1), (3.2), (3.28), (3.34), (3.35).

From half height to one end, then to the other (3.2.2). A step is a fraction of the height: s =
(most - least) shape + least. The shape is a product of two templates, one of the curvature and one
of its change, (3.28), or one template of a sum of both: section 6.1 asks for forms that cannot be
separated. Lengths are over the object's height, curvatures times it: as printed, in 1/length, the
same rule gave 15, 5 and 3 contours for one vase in three units. Templates fall from 1 at 0, never
below 0; as printed some leave that range: a / ln(b x + c) is infinite where b x + c is 1, and 1 /
(a x + b)^c begins at 1 only where b is 1. The piecewise linear form (section 3.6) is written there
as sums of |x - k| over knots k, (3.29), with normal equations, (3.33): collinear where knots come
close. Hat functions span the same functions, and their condition stays small whatever the knots.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners import protocol
from palpate.core.plugins import Range, check_ranges

Template = Literal["exponential", "inverse_power", "logarithmic"]
StepTemplate = Callable[[Floats, float], Floats]  # of x >= 0, and a number that the last two take


@dataclass(frozen=True, slots=True, kw_only=True)
class StepSearchSettings:
    """How a search continues where slices have failed."""

    max_failures: int = 3  # in a row, in one direction
    # Fractions of a step that are tried, where a slice was requested before at its full length.
    shortened: tuple[float, ...] = (1.0, 0.75, 0.6, 0.4)


@dataclass(frozen=True, slots=True, kw_only=True)
class Thesis:
    """The step rule. The text gives no constants: these are ours."""

    template: Template = "exponential"  # how a step falls with curvature
    form: Literal["product", "joint"] = "product"  # two templates multiplied, or one of the sum
    bend_rate: Annotated[float, Range(0.0, 1e3, "1")] = 0.15  # times mean curvature times height
    change_rate: Annotated[float, Range(0.0, 1e3, "1")] = 0.3  # times the change of that
    # Of the inverse power; one less than the constant of the logarithm.
    power: Annotated[float, Range(0.1, 10.0, "1")] = 1.0
    # Smallest step, over the height; approached, never reached.
    least: Annotated[float, Range(1e-3, 0.5, "1")] = 0.02
    most: Annotated[float, Range(1e-3, 0.5, "1")] = 0.2  # largest step, over the height
    # eta of (3.1): the larger, the shorter the first step.
    caution: Annotated[float, Range(0.0, 100.0, "1")] = 1.0
    # A step upwards below this fraction of the height ends the search; 0: the object's end does.
    threshold: Annotated[float, Range(0.0, 0.5, "1")] = 0.0
    # A contour shorter than this fraction of the height ends the search.
    perimeter: Annotated[float, Range(0.0, 1.0, "1")] = 0.1
    # Factor of the steps from slice to slice: the fifth heuristic, which no formula has.
    fading: Annotated[float, Range(0.1, 1.0, "1")] = 1.0
    # Of the piecewise linear form; 0: the templates themselves.
    segments: Annotated[int, Range(0, 100, "1")] = 0

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.template not in TEMPLATES:
            raise ValueError(f"template must be one of {sorted(TEMPLATES)}, got {self.template!r}")
        if self.form not in ("product", "joint"):
            raise ValueError(f"form must be product or joint, got {self.form!r}")
        if self.most < self.least:
            raise ValueError(f"most must be at least least, {self.least}, got {self.most}")

    def next(self, observation: protocol.Observation) -> protocol.Choice:
        """The next slice of the search, or that it has ended."""
        return step_search(observation, self, self.perimeter, self.threshold)

    def first(self, curvature: float) -> float:
        """Step from half height, (3.1), over the height; at least `least`."""
        step = self._falling(self.bend_rate * curvature) / (2.0 * (1.0 + self.caution))
        return max(step, self.least)

    def later(self, curvature: float, change: float, count: int) -> float:
        """Any other step, (3.2), over the height."""
        bent, changed = self.bend_rate * curvature, self.change_rate * change
        if self.form == "joint":
            shape = self._falling(bent + changed)
        else:
            shape = self._falling(bent) * self._falling(changed)
        return self.least + (self.most - self.least) * shape * self.fading**count

    def _falling(self, x: float) -> float:
        """The template, from 1 at 0."""
        if self.segments:
            return _polyline(self.template, self.power, self.segments).at(x)
        return TEMPLATES[self.template](np.array([x]), self.power).item()


@cache
def _polyline(
    template: Template, power: float, segments: int, max_argument: float = 40.0
) -> Polyline:
    """The piecewise linear form of a template, up to a rate times curvature times height."""
    return polyline_of(lambda x: TEMPLATES[template](x, power), max_argument, segments)


def polyline_of(
    function: Callable[[Floats], Floats], max_argument: float, segments: int
) -> Polyline:
    """A falling function from 0 to `max_argument` as a polyline, its knots in closed form."""
    places = np.linspace(0.0, max_argument, 40 * segments + 1)
    values = function(places)
    return fit_decreasing(places, values, equal_curvature_knots(places, values, segments))


class StepRule(Protocol):
    """How long steps are, as fractions of the height."""

    def first(self, curvature: float) -> float:
        """From half height; `curvature` is the mean absolute one there, times the height."""
        ...

    def later(self, curvature: float, change: float, count: int) -> float:
        """From the `count`-th slice beyond half height; `change` against the one before it."""
        ...


def step_search(
    observation: protocol.Observation,
    steps: StepRule,
    perimeter: float,
    threshold: float = 0.0,
    settings: StepSearchSettings = StepSearchSettings(),
) -> protocol.Choice:
    """The next slice of a search in one direction and then in the other.

    Before the object's end the search in a direction ends at a contour shorter than the fraction
    `perimeter` of the height, for a pole is near; or at a step upwards below the fraction
    `threshold`.
    """
    spent = protocol.exhausted_budget(observation)
    if spent is not None:
        return protocol.Stop(spent)
    if not observation.slices:
        if observation.busy_heights:
            return protocol.Wait("the first slice is under way")
        return protocol.Height(0.5 * (observation.low + observation.high), "half height")
    start = observation.slices[0]
    if not start.usable:
        return protocol.Stop(f"the slice at half height, {start.height:g} m, could not be traced")
    up = 1.0 if mean_normal_rise(start) >= 0.0 else -1.0
    for direction in (up, -up):
        if any((height - start.height) * direction > 0.0 for height in observation.busy_heights):
            continue
        height = _next_height(observation, steps, perimeter, threshold, direction, settings)
        if height is not None and not protocol.is_near_finger(observation, height):
            return protocol.Height(height, "upwards" if direction > 0.0 else "downwards")
        if height is not None:
            return protocol.Wait("another finger is too near")
    if observation.busy_heights:
        return protocol.Wait("a step follows from the slice before it, which is under way")
    return protocol.Stop("the search has ended in both directions")


def mean_normal_rise(contour: protocol.ObservedSlice) -> float:
    """Mean upward component of the outward unit normals (the thesis' phi)."""
    radii, turn = contour.radii, 2.0 * math.pi / len(contour.radii)
    around = (np.roll(radii, -1) - np.roll(radii, 1)) / (2.0 * turn) / radii
    return float(np.mean(-contour.slopes / np.sqrt(1.0 + contour.slopes**2 + around**2)))


def _next_height(
    observation: protocol.Observation,
    steps: StepRule,
    perimeter: float,
    threshold: float,
    direction: float,
    settings: StepSearchSettings,
) -> float | None:
    """The next height in a direction [m]; None where the search in it has ended."""
    start, extent = observation.slices[0], observation.extent
    beyond = [
        made for made in observation.slices[1:] if (made.height - start.height) * direction > 0.0
    ]
    if any(made.outcome is protocol.SliceOutcome.LOST for made in beyond):
        return None
    usable = [start, *(made for made in beyond if made.usable)]
    last = usable[-1]
    failures = next((i for i, made in enumerate(reversed(beyond)) if made.usable), len(beyond))
    # An untouched end is where the grasp has it: beyond it slices fail, and steps shrink.
    exact = replace(observation, low_deviation=0.0, high_deviation=0.0)
    bottom, top = protocol.first_and_last(exact)
    # The ends may have been moved since; the search from a slice beyond them begins at them.
    here, end = min(max(last.height, bottom), top), top if direction > 0.0 else bottom
    is_at_end = (end - here) * direction <= protocol.MAX_ROUNDING * extent
    if failures >= settings.max_failures or is_at_end:
        return None
    if 2.0 * math.pi * float(last.radii.mean()) < perimeter * extent:
        return None
    curvature = mean_profile_curvature(last, extent)
    if len(usable) == 1:
        step = steps.first(curvature)
    else:
        change = abs(curvature - mean_profile_curvature(usable[-2], extent))
        step = steps.later(curvature, change, len(usable) - 1)
        if direction > 0.0 and step < threshold:
            return None
    step = min(step * extent * 0.5**failures, (end - here) * direction)
    heights = (here + direction * step * share for share in settings.shortened)
    return next((height for height in heights if not protocol.was_asked(observation, height)), None)


def mean_profile_curvature(contour: protocol.ObservedSlice, extent: float) -> float:
    """Mean absolute curvature along the height, times the object's height [1].

    A hollow calls for steps as small as a bulge; with its sign they would exceed the largest.
    """
    return float(np.abs(contour.curvatures).mean()) * extent


class Polyline(NamedTuple):
    """A piecewise linear function; beyond its knots it stays at its last values."""

    knots: Floats  # (n + 1,) increasing
    values: Floats  # (n + 1,)

    def at(self, place: float) -> float:
        """Value at a place."""
        return float(np.interp(place, self.knots, self.values))


def fit_decreasing(places: Floats, values: Floats, knots: Floats) -> Polyline:
    """The least squares polyline that never rises and is never below 0."""
    from scipy.optimize import nnls

    falls = np.triu(np.ones((len(knots), len(knots))))
    steps, _ = nnls(hat_basis(places, knots) @ falls, values)
    return Polyline(knots, falls @ steps)


def hat_basis(places: Floats, knots: Floats) -> Floats:
    """Values (n, m) of the m hat functions of increasing knots at n places."""
    return np.stack([np.interp(places, knots, hat) for hat in np.eye(len(knots))], axis=1)


def equal_curvature_knots(
    places: Floats, values: Floats, segments: int, min_density: float = 1e-12
) -> Floats:
    """Knots between which the root of the second derivative has the same integral: closed form.

    `min_density`: added to that root, where a function is straight.
    """
    second = np.gradient(np.gradient(values, places), places)
    density = np.sqrt(np.abs(second)) + min_density
    steps = 0.5 * (density[1:] + density[:-1]) * np.diff(places)
    mass = np.concatenate([[0.0], np.cumsum(steps)])
    return np.interp(np.linspace(0.0, mass[-1], segments + 1), mass, places)


TEMPLATES: Mapping[Template, StepTemplate] = {
    "exponential": lambda x, power: np.asarray(np.exp(-x)),
    "inverse_power": lambda x, power: np.asarray((1.0 + x) ** -power),
    # The offset c in ln(c) / ln(x + c) is kept above 1.
    "logarithmic": lambda x, power: np.asarray(np.log(1.0 + power) / np.log(x + (1.0 + power))),
}
