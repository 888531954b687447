"""A planner at work on an object that answers exactly, no touch is simulated; and such objects.

The answer to a height is the object's own contour with normals and curvature, and the band that a
pad touches around it. The side is rebuilt by one method for all planners. Radii are over heights
and azimuths, as shares of the object's height. `TUNED` had a say in the numbers of `predicted`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners import protocol
from palpate.core.explore.planners.coverage import hermite, stack_slices

EXTENT = 0.09  # Height of every object, m
HALF_BAND = 7.0e-3  # The pad touches as far above and below a slice, m, along the surface
RESOLUTION, FEATURE = 1e-5, 2.5e-3  # Of the sensor; and what may stay untouched, m
PROFILE_AZIMUTHS, TOUCH = 48, 3  # Azimuths, and how many of them one touch touches
NOISY_SLOPE = 5e-3  # Standard deviation of a slope where there is noise: 0.3 degrees
NOISY_BEND = 1.0  # Standard deviation of a curvature, 1/m
ROWS = 401  # Heights at which a side is compared with the truth
MOST_CONTOURS_PLANNED = 21  # A plan that does not get there counts as so many contours
AROUND = 2.0 * np.pi * np.arange(PROFILE_AZIMUTHS) / PROFILE_AZIMUTHS
HEIGHTS = np.linspace(protocol.END_SHARE, 1.0 - protocol.END_SHARE, ROWS)
SHARE_STEP = 2e-4  # Of the height: over which derivatives are taken
Radius = Callable[[Floats, Floats], Floats]  # Of heights z from 0 to 1 and azimuths t


class PlannerTrial:
    """One object, its truth and what was asked of it."""

    def __init__(self, radius: Radius, noise: float = 0.0, seed: int = 0) -> None:
        """Noise is the standard deviation of a pad's position, m."""
        self._radius, self._noise, self._seed = radius, noise, seed
        truth = measure_side(radius, HEIGHTS, AROUND)
        turning = np.gradient(truth.radii, AROUND, axis=1) / truth.radii
        self._truth = truth
        self._normal = 1.0 / np.sqrt(1.0 + truth.slopes**2 + turning**2)
        area = truth.radii / self._normal
        self._share = area / area.sum()
        self._kept: dict[float, protocol.ObservedSlice] = {}

    def slice_at(self, height: float) -> protocol.ObservedSlice:
        """What tracing at this height, m, brings."""
        share = height / EXTENT
        if not 0.0 < share < 1.0:
            return lost_slice(height)
        if height not in self._kept:
            self._kept[height] = self._trace(share)
        return self._kept[height]

    def rms(self, slices: Sequence[protocol.ObservedSlice], *, slopes: bool = True) -> float:
        """Error of the side over the object's height; without `slopes` by monotone cubics."""
        usable = sorted((one for one in slices if one.usable), key=lambda one: one.height)
        if len(usable) < 2:
            return 1.0
        profile = stack_slices(usable, 0.0, EXTENT)
        # Beyond the first and the last contour nothing is rebuilt: the nearest one is carried on.
        inside = np.clip(HEIGHTS, profile.heights[0], profile.heights[-1])
        if slopes:
            squares = hermite(profile, inside)
        else:
            squares = positions_only(profile.heights, profile.squares, inside)
        off = np.sqrt(np.maximum(squares, 0.0)) - self._truth.radii
        return float(np.sqrt((self._share * (off * self._normal) ** 2).sum()))

    def _trace(self, share: float) -> protocol.ObservedSlice:
        exact = measure_side(self._radius, np.array([share]), AROUND)
        found = self._disturbed(exact, share) if self._noise else exact
        reach = HALF_BAND / np.sqrt(1.0 + exact.slopes[0] ** 2)
        return protocol.ObservedSlice(
            height=share * EXTENT,
            outcome=protocol.SliceOutcome.CLOSED,
            radii=np.maximum(found.radii[0], 1e-3) * EXTENT,
            slopes=found.slopes[0],
            curvatures=found.curvatures[0] / EXTENT,
            contact_low=share * EXTENT - reach,
            contact_high=share * EXTENT + reach,
            deviation=self._noise,
        )

    def _disturbed(self, exact: MeasuredSide, share: float) -> MeasuredSide:
        """Each touch is off as a whole."""
        rng = np.random.default_rng([self._seed, round(1e6 * share)])
        touches = PROFILE_AZIMUTHS // TOUCH
        shift = np.repeat(rng.normal(size=touches), TOUCH) * self._noise / EXTENT
        lean = np.repeat(rng.normal(size=touches), TOUCH) * NOISY_SLOPE
        bend = np.repeat(rng.normal(size=touches), TOUCH) * NOISY_BEND * EXTENT
        return MeasuredSide(exact.radii + shift, exact.slopes + lean, exact.curvatures + bend)


def measure_side(radius: Radius, heights: Floats, azimuths: Floats) -> MeasuredSide:
    """Radii, slopes and curvatures of an object."""
    z, t = heights[:, None], azimuths[None, :]
    below, here, above = (np.asarray(radius(z + d, t)) for d in (-SHARE_STEP, 0.0, SHARE_STEP))
    slope = (above - below) / (2.0 * SHARE_STEP)
    second = (above - 2.0 * here + below) / SHARE_STEP**2
    return MeasuredSide(here, slope, -second / (1.0 + slope**2) ** 1.5)


def positions_only(heights: Floats, squares: Floats, wanted: Floats) -> Floats:
    """Squared radii between contours from their positions alone."""
    from scipy.interpolate import PchipInterpolator

    if len(heights) == 2:
        share = ((wanted - heights[0]) / (heights[1] - heights[0]))[:, None]
        return np.asarray((1.0 - share) * squares[0] + share * squares[1])
    return np.asarray(PchipInterpolator(heights, squares)(wanted))


def lost_slice(height: float) -> protocol.ObservedSlice:
    """A slice beside the object."""
    return protocol.slice_without_contour(height, protocol.SliceOutcome.LOST)


def run_planner(
    planner: protocol.Planner,
    trial: PlannerTrial,
    tolerance: float,
    most: int = MOST_CONTOURS_PLANNED - 1,
) -> tuple[tuple[protocol.ObservedSlice, ...], protocol.Stop | None]:
    """Let a planner work until it stops, or has `most` slices.

    `tolerance`: root mean square error asked for, over the object's height. Raises ValueError if
    its answer is none to act on; see `palpate.core.explore.planners.check_choice`.
    """
    slices: tuple[protocol.ObservedSlice, ...] = ()
    while True:
        choice = protocol.check_choice(planner, observation_of(slices, tolerance))
        if isinstance(choice, protocol.Stop):
            return slices, choice
        if len(slices) >= most or not isinstance(choice, protocol.Height):
            return slices, None
        slices = (*slices, trial.slice_at(choice.height))


def observation_of(
    slices: tuple[protocol.ObservedSlice, ...], tolerance: float
) -> protocol.Observation:
    """What the planner is told."""
    return protocol.Observation(
        low=0.0,
        high=EXTENT,
        tolerance=tolerance * EXTENT,
        resolution=RESOLUTION,
        feature=FEATURE,
        slices=slices,
    )


class MeasuredSide(NamedTuple):
    """A side at heights (m,) and azimuths (k,); lengths over the object's height."""

    radii: Floats  # (m, k)
    slopes: Floats  # Over the height; (m, k)
    curvatures: Floats  # Along the height, positive where it bulges; (m, k)


def _ball(z: Floats, power: float = 1.0) -> Floats:
    """1 in the middle, 0 at both ends: of a superellipse."""
    away = np.abs(2.0 * z - 1.0)
    return np.asarray(np.maximum(1.0 - away ** (2.0 / power), 1e-9) ** (power / 2.0))


def _rise(z: Floats, at: float, width: float) -> Floats:
    """From 0 to 1 around a height."""
    return np.asarray(0.5 * (1.0 + np.tanh((z - at) / width)))


def _bump(z: Floats, at: float, width: float) -> Floats:
    return np.asarray(np.exp(-(((z - at) / width) ** 2)))


def _square(t: Floats, power: float = 6.0) -> Floats:
    return np.asarray((np.abs(np.cos(t)) ** power + np.abs(np.sin(t)) ** power) ** (-1.0 / power))


def _oval(t: Floats, ratio: float) -> Floats:
    return np.asarray(1.0 / np.sqrt(np.cos(t) ** 2 + (np.sin(t) / ratio) ** 2))


def _bent_cone(z: Floats, t: Floats) -> Floats:
    shift = 0.1 * (2.0 * z - 1.0) ** 2
    base = (0.34 - 0.12 * z) * _ball(z, 0.5)
    away = np.minimum(shift, 0.5 * base)
    return np.asarray(away * np.cos(t) + np.sqrt(base**2 - (away * np.sin(t)) ** 2))


# Plain convex ones and featured ones.
TUNED: Mapping[str, Radius] = {
    "sphere": lambda z, t: 0.5 * _ball(z) + 0.0 * t,
    "ellipsoid": lambda z, t: 0.4 * _ball(z) * _oval(t, 0.8),
    "box": lambda z, t: 0.3 * _ball(z, 0.2) * _square(t, 10.0),
    "cylinder": lambda z, t: 0.3 * _ball(z, 0.1) + 0.0 * t,
    "egg": lambda z, t: 0.38 * _ball(z) * (1.0 - 0.25 * (2.0 * z - 1.0)) + 0.0 * t,
    "bent cone": _bent_cone,
    "pear": lambda z, t: 0.36 * _ball(z) * (1.0 - 0.45 * np.tanh(2.4 * (2.0 * z - 1.2))) + 0.0 * t,
    "bottle": lambda z, t: 0.16 + 0.18 * _rise(z, 0.68, -0.055) + 0.0 * t,
    "vase": lambda z, t: 0.28 + 0.09 * np.sin(8.5 * z + 0.4) + 0.0 * t,
    "stepped": lambda z, t: 0.2 + 0.12 * _rise(z, 0.55, -0.035) + 0.0 * t,
    "groove": lambda z, t: 0.32 - 0.04 * _bump(z, 0.42, 0.07) + 0.0 * t,
    "twisted": lambda z, t: 0.3 * (1.0 + 0.06 * np.cos(4.0 * t - 5.0 * z)),
    "star": lambda z, t: 0.32 * _ball(z, 0.6) * (1.0 + 0.06 * np.cos(5.0 * t)),
    "hourglass": lambda z, t: 0.16 + 0.06 * np.cosh(4.0 * (z - 0.45)) / (1.0 + z) + 0.0 * t,
    "dented": lambda z, t: 0.34 * _ball(z, 0.6) * (1.0 - 0.1 * _bump(z, 0.6, 0.12) * np.cos(t)),
    "deformed": lambda z, t: (
        0.33 * _ball(z, 0.7) * (1.0 + 0.1 * np.sin(5.0 * z + np.cos(t)) + 0.05 * np.cos(2.0 * t))
    ),
}
