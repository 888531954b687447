"""Everything that an exploration has found so far, in the slicing frame, as a value.

A planner is told of it as an `Observation`: radii about one axis, slopes, curvatures, bands of
contact. That axis is the straight line through the middles of the
contours. Where one of them does not surround it, as in a banana, each contour is seen from its own
middle, and the slopes are corrected for how that moves. Results of several fingers are taken up in
the order of robot time, whatever the order in which they arrived.
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

    # Default of the largest height that may stay untouched, over the tolerance: an arc as long bows
    # by the tolerance where it turns by 4.6 degrees.
    feature_ratio: float = 100.0
    finger_spacing: float = 1.5  # height between the slices of two fingers [pad widths]
    n_azimuths: int = 48
    min_points: int = 8
    max_missing: float = 0.35  # fraction of a contour's length that could not be touched
    max_band_shift: int = 6  # neighbours to each side at which a band is looked for
    min_facing: float = 0.15  # outward part of a normal; a wall that is nearly level counts as this
    approach_distance: float = 30e-3  # of the pad, outside the widest contour so far [m]


SURVEYING = SurveySettings()


# What an object stands on is taken for flat, or must be known.
Underside = Literal["flat", "known"]


class Demand(NamedTuple):
    """What is asked of an exploration."""

    tolerance: float  # Root mean square error, m
    feature: float  # Largest height that may stay untouched, m
    most_touches: float  # Touches that may be made
    most_seconds: float  # Robot time that may pass, s
    underside: Underside = "flat"
    most_turns: int = 0  # Times that the object may be set down on another side

    @property
    def limits(self) -> Limits:
        """What is asked of the solid."""
        share = None if self.underside == "flat" else 0.0
        return Limits(tolerance=self.tolerance, feature=self.feature, underside_share=share)


class ModelUncertainty(NamedTuple):
    """What the last model says of its own errors."""

    heights: Floats = np.zeros(0)  # (n,), m
    deviations: Floats = np.zeros(0)  # Standard deviation of the side there, (n,), m
    whole: float | None = None  # Of the whole surface, ends included, m; None without a solid
    ends: float = 0.0  # Of it, the part that the ends make, m
    pose: float = 0.0  # Standard deviation of a touch's place, m
    # False if it had to be rebuilt from contours alone, for its slices are not star-shaped.
    starlike: bool = False
    bounded: bool = True  # Whether its method of rebuilding states errors


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Survey:
    """What is known of an object."""

    frame: ObjectFrame  # The slicing frame, and what the grasp lets expect
    low: float  # Where it begins along the slicing axis, m
    high: float  # Where it ends, m
    low_deviation: float  # Standard deviation of `low`, m; 0 once it was touched
    high_deviation: float  # Of `high`
    standing: bool  # Whether it stands on its lower end, so that this is known
    reached: tuple[float, float]  # Lowest and highest height at which anything was touched, m
    traced: tuple[TracedContour, ...] = ()  # Slices in the order in which they were taken up
    # Touches of each end, slicing frame.
    ends: Mapping[End, tuple[ProbeResult, ...]] = field(default_factory=dict)
    tips: tuple[Floats, ...] = ()  # Where ends were touched, the farthest place of each, (3,), m
    uncertainty: ModelUncertainty = field(default_factory=ModelUncertainty)  # Of the last model

    @property
    def slices(self) -> tuple[ObservedSlice, ...]:
        """Slices as a planner takes them, in the same order."""
        return observed_slices(self.traced, self._deviations())

    @property
    def contours(self) -> tuple[int, ...]:
        """Numbers of the contours that a model is fitted to."""
        return tuple(one.number for one in self.traced if one.tells)

    @property
    def arcs(self) -> tuple[int, ...]:
        """Numbers of those that are of no use themselves: what their touches met counts."""
        return tuple(one.number for one in self.traced if not one.tells)

    @property
    def failed(self) -> bool:
        """Whether a slice could not be traced, for another reason than a spent budget."""
        return any(not (one.tells or one.ran_out) for one in self.traced)

    def approach(self, height: float) -> tuple[Floats, float]:
        """Where the middle of a slice is expected, (2,), and from how far to come, m."""
        contours = [one for one in self.traced if one.usable]
        if not contours:
            return np.zeros(2), self.frame.radius + SURVEYING.approach_distance
        heights, points = [one.height for one in contours], [one.points for one in contours]
        return expected_approach(height, heights, points, self.tips)

    def outermost(self, *, upper: bool) -> TracedContour | None:
        """The usable contour nearest to an end; None while there is none."""
        contours = (one for one in self.traced if one.usable)
        return (max if upper else min)(contours, key=lambda one: one.height, default=None)

    def with_slice(self, traced: TracedContour) -> Survey:
        """With one slice more."""
        survey = replace(self, traced=(*self.traced, traced))
        if not traced.usable:
            return survey
        return survey.reaching(float(traced.contact_low.min()), float(traced.contact_high.max()))

    def reaching(self, low: float, high: float) -> Survey:
        """With something touched at these heights, m: the object reaches at least as far."""
        low, high = min(low, self.reached[0]), max(high, self.reached[1])
        below = self.low if self.standing else min(self.low, low)
        return replace(self, reached=(low, high), low=below, high=max(self.high, high))

    def with_dropped(self, numbers: Collection[int]) -> Survey:
        """With exactly these contours marked as of no use to the model."""
        traced = tuple(
            one if one.dropped == (one.number in numbers) else replace(one, dropped=not one.dropped)
            for one in self.traced
        )
        return replace(self, traced=traced)

    def with_end_touch(self, end: End, touch: ProbeResult) -> Survey:
        """With one touch more of an end."""
        touches = (*self.ends.get(end, ()), touch)
        survey = replace(self, ends={**self.ends, end: touches})
        if touch.touched:
            survey = survey.reaching(float(touch.point[2]), float(touch.point[2]))
        faces = [one.point for one in touches if one.touched and one.command.reason != "edge"]
        if not faces:
            return survey
        upper = end == "upper"
        tip = (max if upper else min)(faces, key=lambda point: point[2])
        return survey.ended(tip, upper=upper)

    def ended(self, tip: Floats, *, upper: bool) -> Survey:
        """With an end that was touched in this place, (3,); touches beyond still count."""
        height = float(tip[2])
        middle = 0.5 * (self.low + self.high)
        opposite = tuple(one for one in self.tips if (one[2] > middle) != upper)
        survey = replace(self, tips=(*opposite, tip))
        if upper:
            return replace(survey, high=max(height, self.reached[1]), high_deviation=0.0)
        return replace(survey, low=min(height, self.reached[0]), low_deviation=0.0)

    def _deviations(self) -> tuple[float, ...]:
        if not len(self.uncertainty.heights):
            return (0.0,) * len(self.traced)
        at = [one.height for one in self.traced]
        return tuple(np.interp(at, self.uncertainty.heights, self.uncertainty.deviations).tolist())


@lru_cache(maxsize=4)  # between two contours many decisions are made
def observed_slices(
    traced: tuple[TracedContour, ...], deviations: tuple[float, ...]
) -> tuple[ObservedSlice, ...]:
    """Slices as a planner takes them, in the same order."""
    seen = iter(zip(*contour_axis([one for one in traced if one.usable]), strict=True))
    return tuple(
        _seen(one, *next(seen), deviation)
        if one.usable
        else slice_without_contour(one.height, one.outcome, one.touches, one.seconds)
        for one, deviation in zip(traced, deviations, strict=True)
    )


def contour_axis(contours: Sequence[TracedContour]) -> tuple[Floats, Floats]:
    """Places (m, 2) from which contours are seen, m, and how they move with the height, (m, 2).

    On the straight line through middles, or, where it leaves a contour, the middles themselves.
    """
    if not contours:
        return np.zeros((0, 2)), np.zeros((0, 2))
    heights = np.array([one.height for one in contours])
    middles = np.stack([one.middle for one in contours])
    if len(contours) == 1:
        return middles, np.zeros((1, 2))
    offset = heights - heights.mean()
    lean = offset @ middles / max(float(offset @ offset), np.finfo(float).tiny)
    places = middles.mean(axis=0) + offset[:, None] * lean
    if all(_surrounds(one.points, place) for one, place in zip(contours, places, strict=True)):
        return places, np.broadcast_to(lean, places.shape)
    order = np.argsort(heights, kind="stable")
    leans = np.empty_like(middles)
    leans[order] = np.gradient(middles[order], heights[order], axis=0)
    return middles, leans


def _surrounds(points: Floats, place: Floats) -> bool:
    """Whether a closed contour goes round a place once, and never back by much."""
    away = points[:, :2] - place
    turn = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return abs(turn[-1] - turn[0]) > np.pi and float(np.linalg.norm(away, axis=1).min()) > 0.0


def _seen(contour: TracedContour, place: Floats, lean: Floats, deviation: float) -> ObservedSlice:
    away = contour.points[:, :2] - place
    radii = np.linalg.norm(away, axis=1)
    outward = away / np.maximum(radii, np.finfo(float).tiny)[:, None]
    facing = np.maximum((contour.normals[:, :2] * outward).sum(axis=1), SURVEYING.min_facing)
    moved = contour.normals[:, 2] + contour.normals[:, :2] @ lean
    around = _by_azimuth(np.arctan2(away[:, 1], away[:, 0]))
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


def _by_azimuth(turns: Floats) -> Callable[[Floats], Floats]:
    """Interpolates values (n,) at azimuths (n,), rad, at those at which contours are seen."""
    whole = 2.0 * np.pi
    at, turns = whole * np.arange(SURVEYING.n_azimuths) / SURVEYING.n_azimuths, turns % whole
    order = np.argsort(turns)
    closed = np.concatenate([order[-1:], order, order[:1]])
    known = turns[closed] + np.concatenate([[-whole], np.zeros(len(order)), [whole]])
    return lambda values: np.interp(at, known, values[closed])


def expected_approach(
    height: float, heights: Sequence[float], contours: Sequence[Floats], tips: Sequence[Floats] = ()
) -> tuple[Floats, float]:
    """Where the middle of a slice is expected, (2,), and from how far it is approached, m."""
    nearest = int(np.argmin([abs(one - height) for one in heights]))
    middle = _leant(height, heights[nearest], contours[nearest], tips)
    widest = max(float(np.linalg.norm(points[:, :2] - middle, axis=1).max()) for points in contours)
    return middle, widest + SURVEYING.approach_distance


def _leant(height: float, nearest: float, contour: Floats, tips: Sequence[Floats]) -> Floats:
    """The contour's middle, moved towards a tip that the slice lies on the way to, (2,), m."""
    middle = area_centroid(contour)
    for tip in tips:
        share = (height - nearest) / (tip[2] - nearest) if tip[2] != nearest else 0.0
        if 0.0 < share < 1.0 and winding_number(contour[:, :2], tip[None, :2])[0] == 0:
            return np.asarray(middle + share * (tip[:2] - middle))
    return middle


@dataclass(frozen=True, eq=False)
class TracedContour:
    """A contour, slicing frame."""

    height: float  # m
    status: str  # As in `palpate.messages.types.Contour`
    points: Floats  # (n, 3), m
    normals: Floats  # Outward unit normals, (n, 3)
    across: Floats  # Normal curvature across the contour, (n,), 1/m
    contact_low: Floats  # Lowest height touched below each point, (n,), m
    contact_high: Floats  # Highest height touched above it, (n,), m
    missing: float  # Length of its gaps, as the crow flies, m
    touches: int  # That it took
    seconds: float  # Robot time that it took, s
    number: int = 0  # Of the goal
    max_touches: int = 0  # It was to be given up after so many
    dropped: bool = False  # Whether the model had no use for it

    @property
    def outcome(self) -> SliceOutcome:
        """How it ended, for a planner."""
        return SliceOutcome.FAILED if self.dropped and self.tells else self.ended

    @property
    def tells(self) -> bool:
        """Whether it tells where the surface is, whatever use a model had for it."""
        return self.ended in (SliceOutcome.CLOSED, SliceOutcome.OCCLUDED)

    @property
    def ran_out(self) -> bool:
        """Whether the budget ended it."""
        return self.status == "budget" and self.touches < self.max_touches

    @cached_property
    def ended(self) -> SliceOutcome:
        """How it ended by itself."""
        if self.status in ("pole", "no_contact"):
            return SliceOutcome.LOST
        if self.status == "budget":
            return SliceOutcome.CUT
        if self.status not in ("closed", "occluded"):
            return SliceOutcome.FAILED
        gaps = SURVEYING.max_missing * self.perimeter
        if len(self.points) < SURVEYING.min_points or self.missing > gaps:
            return SliceOutcome.FAILED
        return SliceOutcome.CLOSED if self.status == "closed" else SliceOutcome.OCCLUDED

    @property
    def usable(self) -> bool:
        """Whether it tells where the surface is."""
        return self.tells and not self.dropped

    @cached_property
    def middle(self) -> Floats:
        """Centroid of its area, (2,), m."""
        return area_centroid(self.points)

    @cached_property
    def perimeter(self) -> float:
        """Its length, gaps included, m."""
        steps = np.diff(self.points, axis=0, append=self.points[:1])
        return float(np.linalg.norm(steps, axis=1).sum())


def widened(contour: TracedContour, feature: float) -> TracedContour:
    """A contour whose bands count half a feature aside: what is narrower may stay untouched."""
    low, high = contour.contact_low, contour.contact_high
    for shift in range(1, SURVEYING.max_band_shift + 1):
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

    `finished`: finger to the robot time of its result, s, of those not yet taken up. `clocks`:
    finger to the robot time that it is known to have reached, s.
    """
    if not finished:
        return None
    first = min((seconds, finger) for finger, seconds in finished.items())
    others = (finger for finger in busy if finger not in finished)
    return first[1] if all((clocks.get(other, 0.0), other) > first for other in others) else None
