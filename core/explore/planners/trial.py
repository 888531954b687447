"""A trial of a planner on objects of known form, without simulated touches; and such objects.

The answer to a height is the object's own contour with normals and curvature, and the band that a
pad touches around it. The side is rebuilt by one method for all planners. Radii are functions of
heights and azimuths, as fractions of the object's height. The numbers of `predicted` were tuned
with `TUNED`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners import protocol
from palpate.core.explore.planners.coverage import hermite, stack_slices

Radius = Callable[[Floats, Floats], Floats]  # of heights z from 0 to 1 and azimuths t


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSettings:
    """The objects of trials, the pad and its noise, and how the result is measured."""

    extent: float = 0.09  # [m] height of every object
    half_band: float = 7.0e-3  # [m] that the pad touches above and below, along the surface
    resolution: float = 1e-5  # [m] of the sensor
    feature: float = 2.5e-3  # [m] that may stay untouched
    n_azimuths: int = 48  # of a profile
    n_azimuths_per_touch: int = 3
    slope_noise: float = 5e-3  # standard deviation where there is noise: 0.3 degrees
    curvature_noise: float = 1.0  # [1/m] standard deviation where there is noise
    n_heights: int = 401  # at which a side is compared with the truth
    max_slices: int = 21  # counted for a plan that does not reach the tolerance
    min_radius: float = 1e-3  # [height] of a measured radius, at least
    slicing: protocol.SliceSettings = field(default=protocol.SliceSettings())

    @property
    def azimuths(self) -> Floats:
        """Azimuths (n_azimuths,) of a profile [rad]."""
        return 2.0 * np.pi * np.arange(self.n_azimuths) / self.n_azimuths

    @property
    def heights(self) -> Floats:
        """Heights (n_heights,) at which a side is measured, as fractions of the height."""
        end = self.slicing.end_fraction
        return np.linspace(end, 1.0 - end, self.n_heights)


DEFAULT_TRIAL = TrialSettings()


class PlannerTrial:
    """One object, its truth and the slices that were requested."""

    def __init__(
        self,
        radius: Radius,
        noise: float = 0.0,
        seed: int = 0,
        settings: TrialSettings = DEFAULT_TRIAL,
    ) -> None:
        """Take `noise` as the standard deviation of a pad's position [m]."""
        self.settings = settings
        self._radius, self._noise, self._seed = radius, noise, seed
        azimuths = settings.azimuths
        truth = measure_side(radius, settings.heights, azimuths)
        turning = np.gradient(truth.radii, azimuths, axis=1) / truth.radii
        self._truth = truth
        self._normal = 1.0 / np.sqrt(1.0 + truth.slopes**2 + turning**2)
        area = truth.radii / self._normal
        self._share = area / area.sum()
        self._slices: dict[float, protocol.ObservedSlice] = {}

    def slice_at(self, height: float) -> protocol.ObservedSlice:
        """The slice that is traced at a height [m]."""
        share = height / self.settings.extent
        if not 0.0 < share < 1.0:
            return lost_slice(height)
        if height not in self._slices:
            self._slices[height] = self._trace(share)
        return self._slices[height]

    def rms(self, slices: Sequence[protocol.ObservedSlice], *, slopes: bool = True) -> float:
        """Error of the side over the object's height; without `slopes` by monotone cubics."""
        usable = sorted((made for made in slices if made.usable), key=lambda made: made.height)
        if len(usable) < 2:
            return 1.0
        profile = stack_slices(usable, 0.0, self.settings.extent)
        # Beyond the first and the last contour nothing is rebuilt: the nearest one is continued.
        inside = np.clip(self.settings.heights, profile.heights[0], profile.heights[-1])
        if slopes:
            squares = hermite(profile, inside)
        else:
            squares = positions_only(profile.heights, profile.squares, inside)
        off = np.sqrt(np.maximum(squares, 0.0)) - self._truth.radii
        return float(np.sqrt((self._share * (off * self._normal) ** 2).sum()))

    def _trace(self, share: float) -> protocol.ObservedSlice:
        """The slice at a fraction of the height."""
        extent = self.settings.extent
        exact = measure_side(self._radius, np.array([share]), self.settings.azimuths)
        measured = self._disturbed(exact, share) if self._noise else exact
        reach = self.settings.half_band / np.sqrt(1.0 + exact.slopes[0] ** 2)
        return protocol.ObservedSlice(
            height=share * extent,
            outcome=protocol.SliceOutcome.CLOSED,
            radii=np.maximum(measured.radii[0], self.settings.min_radius) * extent,
            slopes=measured.slopes[0],
            curvatures=measured.curvatures[0] / extent,
            contact_low=share * extent - reach,
            contact_high=share * extent + reach,
            deviation=self._noise,
        )

    def _disturbed(self, exact: MeasuredSide, share: float) -> MeasuredSide:
        """The side as touches measure it, each of which is off as a whole."""
        rng = np.random.default_rng([self._seed, round(1e6 * share)])
        settings = self.settings
        width = settings.n_azimuths_per_touch
        touches = settings.n_azimuths // width
        shift = np.repeat(rng.normal(size=touches), width) * self._noise / settings.extent
        lean = np.repeat(rng.normal(size=touches), width) * settings.slope_noise
        bend = np.repeat(rng.normal(size=touches), width) * settings.curvature_noise
        bend = bend * settings.extent
        return MeasuredSide(exact.radii + shift, exact.slopes + lean, exact.curvatures + bend)


def measure_side(
    radius: Radius, heights: Floats, azimuths: Floats, step: float = 2e-4
) -> MeasuredSide:
    """Radii, slopes and curvatures of an object, by differences over a `step` of the height."""
    z, t = heights[:, None], azimuths[None, :]
    below, here, above = (np.asarray(radius(z + d, t)) for d in (-step, 0.0, step))
    slope = (above - below) / (2.0 * step)
    second = (above - 2.0 * here + below) / step**2
    return MeasuredSide(here, slope, -second / (1.0 + slope**2) ** 1.5)


def positions_only(heights: Floats, squares: Floats, wanted: Floats) -> Floats:
    """Squared radii between contours from their positions alone."""
    from scipy.interpolate import PchipInterpolator

    if len(heights) == 2:
        share = ((wanted - heights[0]) / (heights[1] - heights[0]))[:, None]
        return np.asarray((1.0 - share) * squares[0] + share * squares[1])
    return np.asarray(PchipInterpolator(heights, squares)(wanted))


def lost_slice(height: float) -> protocol.ObservedSlice:
    """A slice at a height [m] beyond the object's ends."""
    return protocol.slice_without_contour(height, protocol.SliceOutcome.LOST)


def run_planner(
    planner: protocol.Planner,
    trial: PlannerTrial,
    tolerance: float,
    most: int | None = None,
) -> tuple[tuple[protocol.ObservedSlice, ...], protocol.Stop | None]:
    """Let a planner work until it stops, or has `most` slices.

    `tolerance`: root mean square error asked for, over the object's height. `most`: if None, one
    less than `max_slices` of the trial. Raises ValueError if an
    answer is invalid; see `palpate.core.explore.planners.check_choice`.
    """
    slices: tuple[protocol.ObservedSlice, ...] = ()
    settings = trial.settings
    limit = settings.max_slices - 1 if most is None else most
    while True:
        choice = protocol.check_choice(planner, observation_of(slices, tolerance, settings))
        if isinstance(choice, protocol.Stop):
            return slices, choice
        if len(slices) >= limit or not isinstance(choice, protocol.Height):
            return slices, None
        slices = (*slices, trial.slice_at(choice.height))


def observation_of(
    slices: tuple[protocol.ObservedSlice, ...],
    tolerance: float,
    settings: TrialSettings = DEFAULT_TRIAL,
) -> protocol.Observation:
    """What a planner observes of a trial; `tolerance` over the object's height."""
    return protocol.Observation(
        low=0.0,
        high=settings.extent,
        tolerance=tolerance * settings.extent,
        resolution=settings.resolution,
        feature=settings.feature,
        slices=slices,
        slicing=settings.slicing,
    )


class MeasuredSide(NamedTuple):
    """A side at heights (m,) and azimuths (k,); lengths over the object's height."""

    radii: Floats  # (m, k)
    slopes: Floats  # (m, k) of the radius over the height
    curvatures: Floats  # (m, k) along the height, positive where it bulges


def _ball(z: Floats, power: float = 1.0) -> Floats:
    """Radius of a superellipse: 1 in the middle, 0 at both ends."""
    offset = np.abs(2.0 * z - 1.0)
    return np.asarray(np.maximum(1.0 - offset ** (2.0 / power), 1e-9) ** (power / 2.0))


def _rise(z: Floats, at: float, width: float) -> Floats:
    """A smooth step from 0 to 1 around a height."""
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
    offset = np.minimum(shift, 0.5 * base)
    return np.asarray(offset * np.cos(t) + np.sqrt(base**2 - (offset * np.sin(t)) ** 2))


# Plain convex objects, then objects with features.
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
