"""Everything that an exploration has found so far, in the slicing frame, as a value.

A planner receives it as an `Observation`: radii about one axis, slopes, curvatures, bands of
contact. The axis is the straight line through the middles of the contours.
Where one contour does not surround that line, as in a banana, the radii of each contour are about
its own middle, and slopes are corrected for the middle's shift with height. Results of several
fingers are taken up in the order of robot time, not in the order of arrival.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import ObjectFrame
from palpate.core.explore.planners import (
    Limits,
    ObservedSlice,
    SliceOutcome,
    slice_without_contour,
)
from palpate.core.explore.probing import End, ProbeResult
from palpate.core.geometry import area_centroid, winding_number


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveySettings:
    """Which contours are of use, and how planners see them."""

    # [tolerances] default of the largest height that may stay untouched: an arc of this length that
    # turns by 4.6 degrees bows by one tolerance.
    feature_ratio: float = 100.0
    finger_spacing: float = 1.5  # [pad widths] of height between the slices of two fingers
    n_azimuths: int = 48  # at which planners see a contour
    min_points: int = 8  # of a usable contour
    max_missing: float = 0.35  # fraction of a usable contour's length that could not be touched
    max_band_shift: int = 6  # points to each side whose bands may widen a point's band
    min_facing: float = 0.15  # smallest outward part of a normal by which a slope is divided
    approach_distance: float = 30e-3  # [m] from the widest contour so far, where the pad starts


DEFAULT_SURVEY = SurveySettings()


# The side on which an object stands is assumed flat, or must be touched ("known").
Underside = Literal["flat", "known"]


class Demand(NamedTuple):
    """What is asked of an exploration."""

    tolerance: float  # [m] root mean square error
    feature: float  # [m] largest height that may stay untouched
    most_touches: float  # largest number of touches
    most_seconds: float  # [s] longest robot time
    underside: Underside = "flat"
    most_turns: int = 0  # how often the object may be set down on another side

    @property
    def limits(self) -> Limits:
        """What is asked of the solid."""
        share = None if self.underside == "flat" else 0.0
        return Limits(tolerance=self.tolerance, feature=self.feature, underside_share=share)


class ModelUncertainty(NamedTuple):
    """Errors that the last model states for itself."""

    heights: Floats = np.zeros(0)  # (n,) [m]
    deviations: Floats = np.zeros(0)  # (n,) [m] standard deviation of the side at these heights
    whole: float | None = None  # [m] standard deviation of the whole surface; None without a solid
    ends: float = 0.0  # [m] part of `whole` that comes from the ends
    pose: float = 0.0  # [m] standard deviation of a touch's place
    # False if slices are not star-shaped, so that it was rebuilt from contours alone.
    starlike: bool = False
    bounded: bool = True  # whether the method of rebuilding states errors


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Survey:
    """What is known of an object."""

    frame: ObjectFrame  # slicing frame, with the extent that the grasp suggests
    low: float  # [m] height of its lower end along the slicing axis
    high: float  # [m] height of its upper end
    low_deviation: float  # [m] standard deviation of `low`; 0 once that end was touched
    high_deviation: float  # [m] standard deviation of `high`; 0 once that end was touched
    standing: bool  # whether it stands on its lower end, whose height is then known
    reached: tuple[float, float]  # [m] lowest and highest height at which anything was touched
    traced: tuple[TracedContour, ...] = ()  # slices in the order in which they were taken up
    # Touches of each end, slicing frame.
    ends: Mapping[End, tuple[ProbeResult, ...]] = field(default_factory=dict)
    tips: tuple[Floats, ...] = ()  # (3,) [m] outermost touched place of each touched end
    uncertainty: ModelUncertainty = field(default_factory=ModelUncertainty)  # of the last model
    settings: SurveySettings = DEFAULT_SURVEY

    @property
    def slices(self) -> tuple[ObservedSlice, ...]:
        """Slices in the form that planners use, in the same order."""
        return observed_slices(self.traced, self._deviations(), self.settings)

    @property
    def contours(self) -> tuple[int, ...]:
        """Numbers of the contours that a model is fitted to."""
        return tuple(contour.number for contour in self.traced if contour.tells)

    @property
    def arcs(self) -> tuple[int, ...]:
        """Numbers of unusable contours, of which the model uses only the touched taxels."""
        return tuple(contour.number for contour in self.traced if not contour.tells)

    @property
    def failed(self) -> bool:
        """Whether a slice could not be traced, for another reason than a spent budget."""
        return any(not (contour.tells or contour.ran_out) for contour in self.traced)

    def approach(self, height: float) -> tuple[Floats, float]:
        """Expected middle (2,) [m] of a slice, and the distance [m] from which the pad comes."""
        contours = [contour for contour in self.traced if contour.usable]
        if not contours:
            return np.zeros(2), self.frame.radius + self.settings.approach_distance
        heights, points = [made.height for made in contours], [made.points for made in contours]
        return expected_approach(height, heights, points, self.tips, self.settings)

    def outermost(self, *, upper: bool) -> TracedContour | None:
        """The usable contour nearest to an end; None while there is none."""
        usable = (contour for contour in self.traced if contour.usable)
        return (max if upper else min)(usable, key=lambda contour: contour.height, default=None)

    def with_slice(self, traced: TracedContour) -> Survey:
        """The survey with one more slice."""
        survey = replace(self, traced=(*self.traced, traced))
        if not traced.usable:
            return survey
        return survey.reaching(float(traced.contact_low.min()), float(traced.contact_high.max()))

    def reaching(self, low: float, high: float) -> Survey:
        """The survey after contact at these heights [m]: the object reaches at least as far."""
        low, high = min(low, self.reached[0]), max(high, self.reached[1])
        below = self.low if self.standing else min(self.low, low)
        return replace(self, reached=(low, high), low=below, high=max(self.high, high))

    def with_dropped(self, numbers: Collection[int]) -> Survey:
        """The survey in which exactly these contours are marked as dropped by the model."""
        traced = tuple(
            old if old.dropped == (old.number in numbers) else replace(old, dropped=not old.dropped)
            for old in self.traced
        )
        return replace(self, traced=traced)

    def with_end_touch(self, end: End, touch: ProbeResult) -> Survey:
        """The survey with one more touch of an end."""
        touches = (*self.ends.get(end, ()), touch)
        survey = replace(self, ends={**self.ends, end: touches})
        if touch.touched:
            survey = survey.reaching(float(touch.point[2]), float(touch.point[2]))
        faces = [made.point for made in touches if made.touched and made.command.reason != "edge"]
        if not faces:
            return survey
        upper = end == "upper"
        tip = (max if upper else min)(faces, key=lambda point: point[2])
        return survey.ended(tip, upper=upper)

    def ended(self, tip: Floats, *, upper: bool) -> Survey:
        """The survey with an end at a touched place (3,) [m], or at any touch beyond it."""
        height = float(tip[2])
        middle = 0.5 * (self.low + self.high)
        opposite = tuple(other for other in self.tips if (other[2] > middle) != upper)
        survey = replace(self, tips=(*opposite, tip))
        if upper:
            return replace(survey, high=max(height, self.reached[1]), high_deviation=0.0)
        return replace(survey, low=min(height, self.reached[0]), low_deviation=0.0)

    def _deviations(self) -> tuple[float, ...]:
        if not len(self.uncertainty.heights):
            return (0.0,) * len(self.traced)
        at = [contour.height for contour in self.traced]
        return tuple(np.interp(at, self.uncertainty.heights, self.uncertainty.deviations).tolist())


@lru_cache(maxsize=4)  # between two contours many decisions are made
def observed_slices(
    traced: tuple[TracedContour, ...],
    deviations: tuple[float, ...],
    settings: SurveySettings = DEFAULT_SURVEY,
) -> tuple[ObservedSlice, ...]:
    """Slices in the form that planners use, in the same order."""
    seen = iter(zip(*contour_axis([contour for contour in traced if contour.usable]), strict=True))
    return tuple(
        _seen(made, *next(seen), deviation, settings)
        if made.usable
        else slice_without_contour(made.height, made.outcome, made.touches, made.seconds)
        for made, deviation in zip(traced, deviations, strict=True)
    )


def contour_axis(contours: Sequence[TracedContour]) -> tuple[Floats, Floats]:
    """Origins (m, 2) [m] of the contours' radii, and their shift per height (m, 2).

    They lie on the straight line through the middles; where it leaves a contour, at the middles.
    """
    if not contours:
        return np.zeros((0, 2)), np.zeros((0, 2))
    heights = np.array([contour.height for contour in contours])
    middles = np.stack([contour.middle for contour in contours])
    if len(contours) == 1:
        return middles, np.zeros((1, 2))
    offset = heights - heights.mean()
    lean = offset @ middles / max(float(offset @ offset), np.finfo(float).tiny)
    places = middles.mean(axis=0) + offset[:, None] * lean
    if all(_surrounds(seen.points, place) for seen, place in zip(contours, places, strict=True)):
        return places, np.broadcast_to(lean, places.shape)
    order = np.argsort(heights, kind="stable")
    leans = np.empty_like(middles)
    leans[order] = np.gradient(middles[order], heights[order], axis=0)
    return middles, leans


def _surrounds(points: Floats, place: Floats) -> bool:
    """Whether a closed contour goes around a place (2,) [m]: it winds by more than half a turn."""
    away = points[:, :2] - place
    turn = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return abs(turn[-1] - turn[0]) > np.pi and float(np.linalg.norm(away, axis=1).min()) > 0.0


def _seen(
    contour: TracedContour,
    place: Floats,
    lean: Floats,
    deviation: float,
    settings: SurveySettings,
) -> ObservedSlice:
    """A contour as planners see it, about `place` (2,) [m], which shifts by `lean` per height."""
    away = contour.points[:, :2] - place
    radii = np.linalg.norm(away, axis=1)
    outward = away / np.maximum(radii, np.finfo(float).tiny)[:, None]
    facing = np.maximum((contour.normals[:, :2] * outward).sum(axis=1), settings.min_facing)
    moved = contour.normals[:, 2] + contour.normals[:, :2] @ lean
    around = _by_azimuth(np.arctan2(away[:, 1], away[:, 0]), settings.n_azimuths)
    return ObservedSlice(
        height=contour.height,
        outcome=contour.outcome,
        radii=np.maximum(around(radii), np.finfo(float).eps),
        slopes=around(-moved / facing),
        curvatures=around(contour.across),
        contact_low=around(contour.contact_low),
        contact_high=around(contour.contact_high),
        deviation=deviation,
        touches=contour.touches,
        seconds=contour.seconds,
    )


def _by_azimuth(turns: Floats, count: int) -> Callable[[Floats], Floats]:
    """A function that interpolates values (n,) at azimuths (n,) [rad] to `count` even ones."""
    whole = 2.0 * np.pi
    at, turns = whole * np.arange(count) / count, turns % whole
    order = np.argsort(turns)
    closed = np.concatenate([order[-1:], order, order[:1]])
    known = turns[closed] + np.concatenate([[-whole], np.zeros(len(order)), [whole]])
    return lambda values: np.interp(at, known, values[closed])


def expected_approach(
    height: float,
    heights: Sequence[float],
    contours: Sequence[Floats],
    tips: Sequence[Floats] = (),
    settings: SurveySettings = DEFAULT_SURVEY,
) -> tuple[Floats, float]:
    """Expected middle (2,) [m] of a slice, and the distance [m] from which the pad comes."""
    nearest = int(np.argmin([abs(other - height) for other in heights]))
    middle = _leant(height, heights[nearest], contours[nearest], tips)
    widest = max(float(np.linalg.norm(points[:, :2] - middle, axis=1).max()) for points in contours)
    return middle, widest + settings.approach_distance


def _leant(height: float, nearest: float, contour: Floats, tips: Sequence[Floats]) -> Floats:
    """Middle (2,) [m] of a contour, moved towards a tip that lies beyond the slice, beside it."""
    middle = area_centroid(contour)
    for tip in tips:
        share = (height - nearest) / (tip[2] - nearest) if tip[2] != nearest else 0.0
        if 0.0 < share < 1.0 and winding_number(contour[:, :2], tip[None, :2])[0] == 0:
            return np.asarray(middle + share * (tip[:2] - middle))
    return middle


@dataclass(frozen=True, eq=False)
class TracedContour:
    """A contour, slicing frame."""

    height: float  # [m]
    status: str  # as in `palpate.messages.types.Contour`
    points: Floats  # (n, 3) [m]
    normals: Floats  # (n, 3) outward unit normals
    across: Floats  # (n,) [1/m] normal curvature across the contour
    contact_low: Floats  # (n,) [m] lowest height touched below each point
    contact_high: Floats  # (n,) [m] highest height touched above it
    missing: float  # [m] sum of the straight lengths of its gaps
    touches: int  # that it took
    seconds: float  # [s] robot time that it took
    number: int = 0  # of its goal
    max_touches: int = 0  # after which tracing would have given up
    dropped: bool = False  # whether the model left it out
    settings: SurveySettings = DEFAULT_SURVEY

    @property
    def outcome(self) -> SliceOutcome:
        """How it ended, for a planner."""
        return SliceOutcome.FAILED if self.dropped and self.tells else self.ended

    @property
    def tells(self) -> bool:
        """Whether it shows where the surface is, even if the model left it out."""
        return self.ended in (SliceOutcome.CLOSED, SliceOutcome.OCCLUDED)

    @property
    def ran_out(self) -> bool:
        """Whether the run's budget ended it, and not its own limit of touches."""
        return self.status == "budget" and self.touches < self.max_touches

    @cached_property
    def ended(self) -> SliceOutcome:
        """How tracing ended, before any model."""
        if self.status in ("pole", "no_contact"):
            return SliceOutcome.LOST
        if self.status == "budget":
            return SliceOutcome.CUT
        if self.status not in ("closed", "occluded"):
            return SliceOutcome.FAILED
        gaps = self.settings.max_missing * self.perimeter
        if len(self.points) < self.settings.min_points or self.missing > gaps:
            return SliceOutcome.FAILED
        return SliceOutcome.CLOSED if self.status == "closed" else SliceOutcome.OCCLUDED

    @property
    def usable(self) -> bool:
        """Whether it shows where the surface is, and the model uses it."""
        return self.tells and not self.dropped

    @cached_property
    def middle(self) -> Floats:
        """Centroid (2,) [m] of its area."""
        return area_centroid(self.points)

    @cached_property
    def perimeter(self) -> float:
        """Its length [m], gaps included."""
        steps = np.diff(self.points, axis=0, append=self.points[:1])
        return float(np.linalg.norm(steps, axis=1).sum())


def widened(
    contour: TracedContour, feature: float, settings: SurveySettings = DEFAULT_SURVEY
) -> TracedContour:
    """A contour whose bands include those of points within half a `feature` [m] beside them."""
    low, high = contour.contact_low, contour.contact_high
    for shift in range(1, settings.max_band_shift + 1):
        for step in (shift, -shift):
            away = np.linalg.norm(contour.points - np.roll(contour.points, step, axis=0), axis=1)
            near = away <= 0.5 * feature
            low = np.where(near, np.minimum(low, np.roll(contour.contact_low, step)), low)
            high = np.where(near, np.maximum(high, np.roll(contour.contact_high, step)), high)
    return replace(contour, contact_low=low, contact_high=high)


def next_finished(
    finished: Mapping[int, float], busy: Collection[int], clocks: Mapping[int, float]
) -> int | None:
    """The finger whose result is taken up next; None if one must still be waited for.

    `finished`: robot time of each finger's result that is not yet taken up [s]. `busy`: fingers
    with a task. `clocks`: robot time that each finger is known to have reached [s].
    """
    if not finished:
        return None
    first = min((seconds, finger) for finger, seconds in finished.items())
    others = (finger for finger in busy if finger not in finished)
    return first[1] if all((clocks.get(other, 0.0), other) > first for other in others) else None
