"""Traced contours as a planner sees them: radii about one axis, slopes, curvatures, felt bands.

The axis is the straight line through the middles of the contours. Where one of them does not
surround it, as in a banana, each contour is seen from its own middle, and the slopes are corrected
for how that moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.known import Outcome, Slice
from palpate.core.plane.area_centroid import area_centroid

AZIMUTHS = 48
"""At which a contour is seen."""
LEAST_POINTS = 8
"""A contour of fewer points is of no use."""
MOST_MISSING = 0.35
"""Nor is one of whose length more than this share could not be felt."""
MOST_ASIDE = 6
"""Neighbours to each side at which a band is looked for."""
LEAST_FACING = 0.15
"""A normal that faces away from the axis by less has no slope: taken for this."""


class Traced(NamedTuple):
    """A contour, slicing frame."""

    height: float
    """m."""
    status: str
    """As in `palpate.messages.types.Contour`."""
    points: Floats
    """(n, 3), m."""
    normals: Floats
    """Outward unit normals, (n, 3)."""
    across: Floats
    """Normal curvature across the contour, (n,), 1/m."""
    felt_low: Floats
    """Lowest height felt below each point, (n,), m."""
    felt_high: Floats
    """Highest height felt above it, (n,), m."""
    missing: float
    """Length of its gaps, as the crow flies, m."""
    touches: int
    """That it took."""
    seconds: float
    """Robot time that it took, s."""
    dropped: bool = False
    """Whether the model had no use for it."""

    @property
    def outcome(self) -> Outcome:
        """How it ended, for a planner."""
        if self.status in ("pole", "no_contact"):
            return Outcome.LOST
        if self.status not in ("closed", "occluded") or self.dropped:
            return Outcome.FAILED
        if len(self.points) < LEAST_POINTS or self.missing > MOST_MISSING * self.perimeter:
            return Outcome.FAILED
        return Outcome.CLOSED if self.status == "closed" else Outcome.OCCLUDED

    @property
    def usable(self) -> bool:
        """Whether it tells where the surface is."""
        return self.outcome in (Outcome.CLOSED, Outcome.OCCLUDED)

    @property
    def perimeter(self) -> float:
        """Its length, gaps included, m."""
        steps = np.diff(self.points, axis=0, append=self.points[:1])
        return float(np.linalg.norm(steps, axis=1).sum())


class Axis(NamedTuple):
    """Where contours are seen from."""

    places: Floats
    """At each contour's height, (m, 2), m."""
    leans: Floats
    """How the axis moves with the height there, (m, 2)."""


def measured_slices(traced: Sequence[Traced], deviations: Sequence[float]) -> tuple[Slice, ...]:
    """Slices as a planner takes them, in the same order.

    Parameters
    ----------
    traced : sequence of Traced
        In the order in which they were asked for.
    deviations : sequence of float
        Standard deviation of the model at each height, m.
    """
    usable = [one for one in traced if one.usable]
    axis = axis_of(usable)
    seen = iter(zip(axis.places, axis.leans, strict=True))
    return tuple(
        _seen(one, *next(seen), deviation) if one.usable else _unseen(one)
        for one, deviation in zip(traced, deviations, strict=True)
    )


def widened(one: Traced, feature: float) -> Traced:
    """A contour whose bands count half a feature aside: what is narrower may stay unfelt.

    Parameters
    ----------
    one : Traced
        As it was traced.
    feature : float
        m.
    """
    low, high = one.felt_low, one.felt_high
    for shift in range(1, MOST_ASIDE + 1):
        for step in (shift, -shift):
            away = np.linalg.norm(one.points - np.roll(one.points, step, axis=0), axis=1)
            near = away <= 0.5 * feature
            low = np.where(near, np.minimum(low, np.roll(one.felt_low, step)), low)
            high = np.where(near, np.maximum(high, np.roll(one.felt_high, step)), high)
    return one._replace(felt_low=low, felt_high=high)


def axis_of(contours: Sequence[Traced]) -> Axis:
    """The straight line through middles, or, where it leaves a contour, the middles themselves."""
    if not contours:
        return Axis(np.zeros((0, 2)), np.zeros((0, 2)))
    heights = np.array([one.height for one in contours])
    middles = np.stack([area_centroid(one.points) for one in contours])
    if len(contours) == 1:
        return Axis(middles, np.zeros((1, 2)))
    offset = heights - heights.mean()
    lean = offset @ middles / max(float(offset @ offset), np.finfo(float).tiny)
    places = middles.mean(axis=0) + offset[:, None] * lean
    if all(_surrounds(one.points, place) for one, place in zip(contours, places, strict=True)):
        return Axis(places, np.broadcast_to(lean, places.shape))
    order = np.argsort(heights, kind="stable")
    leans = np.empty_like(middles)
    leans[order] = np.gradient(middles[order], heights[order], axis=0)
    return Axis(middles, leans)


def _surrounds(points: Floats, place: Floats) -> bool:
    """Whether a closed contour goes round a place once, and never back by much."""
    away = points[:, :2] - place
    turn = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return abs(turn[-1] - turn[0]) > np.pi and float(np.linalg.norm(away, axis=1).min()) > 0.0


def _seen(one: Traced, place: Floats, lean: Floats, deviation: float) -> Slice:
    away = one.points[:, :2] - place
    radii = np.linalg.norm(away, axis=1)
    outward = away / np.maximum(radii, np.finfo(float).tiny)[:, None]
    facing = np.maximum((one.normals[:, :2] * outward).sum(axis=1), LEAST_FACING)
    moved = one.normals[:, 2] + one.normals[:, :2] @ lean
    turns = np.arctan2(away[:, 1], away[:, 0])
    at = 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS

    def around(values: Floats) -> Floats:
        return np.interp(at, turns, values, period=2.0 * np.pi)

    return Slice(
        height=one.height,
        outcome=one.outcome,
        radii=np.maximum(around(radii), np.finfo(float).eps),
        slopes=around(-moved / facing),
        curvatures=around(one.across),
        felt_low=around(one.felt_low),
        felt_high=around(one.felt_high),
        deviation=deviation,
        touches=one.touches,
        seconds=one.seconds,
    )


def _unseen(one: Traced) -> Slice:
    none = np.zeros(0)
    return Slice(
        height=one.height,
        outcome=one.outcome,
        radii=none,
        slopes=none,
        curvatures=none,
        felt_low=none,
        felt_high=none,
        touches=one.touches,
        seconds=one.seconds,
    )
