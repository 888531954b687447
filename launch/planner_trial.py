"""A planner at work on an object that answers exactly: no touch is simulated.

The answer to a height is the object's own contour with normals and curvature, and the band that
a pad feels around it. The side is rebuilt by one method for all planners.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.asking import ask
from palpate.core.explore.planners.choice import END_SHARE, Height, Planner, Stop
from palpate.core.explore.planners.intervals import hermite, stack_slices
from palpate.core.explore.planners.known import Known, Outcome, Slice
from palpate.launch.planner_objects import Measured, Radius, measure

EXTENT = 0.09
"""Height of every object, m."""
HALF_BAND = 7.0e-3
"""The pad feels as far above and below a slice, m, along the surface."""
RESOLUTION, FEATURE = 1e-5, 2.5e-3
"""Of the sensor; and what may stay unfelt, m."""
TURNS, TOUCH = 48, 3
"""Azimuths, and how many of them one touch feels."""
NOISY_SLOPE = 5e-3
"""Standard deviation of a slope where there is noise: 0.3 degrees."""
NOISY_BEND = 1.0
"""Standard deviation of a curvature, 1/m."""
ROWS = 401
"""Heights at which a side is compared with the truth."""
MOST = 21
"""A plan that does not get there counts as so many contours."""
AROUND = 2.0 * np.pi * np.arange(TURNS) / TURNS
HEIGHTS = np.linspace(END_SHARE, 1.0 - END_SHARE, ROWS)


class Trial:
    """One object, its truth and what was asked of it."""

    def __init__(self, radius: Radius, noise: float = 0.0, seed: int = 0) -> None:
        """Noise is the standard deviation of a pad's position, m."""
        self._radius = radius
        self._noise = noise
        self._seed = seed
        truth = measure(radius, HEIGHTS, AROUND)
        turning = np.gradient(truth.radii, AROUND, axis=1) / truth.radii
        self._truth = truth
        self._normal = 1.0 / np.sqrt(1.0 + truth.slopes**2 + turning**2)
        area = truth.radii / self._normal
        self._share = area / area.sum()
        self._kept: dict[float, Slice] = {}

    def slice_at(self, height: float) -> Slice:
        """What tracing at this height, m, brings."""
        share = height / EXTENT
        if not 0.0 < share < 1.0:
            return lost(height)
        if height not in self._kept:
            self._kept[height] = self._trace(share)
        return self._kept[height]

    def rms(self, slices: Sequence[Slice], *, slopes: bool = True) -> float:
        """Error of the side through these slices, over the object's height.

        Parameters
        ----------
        slices : sequence of Slice
            The contours.
        slopes : bool
            Use their normals; else positions alone, by monotone cubics.
        """
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

    def _trace(self, share: float) -> Slice:
        exact = measure(self._radius, np.array([share]), AROUND)
        found = self._disturbed(exact, share) if self._noise else exact
        reach = HALF_BAND / np.sqrt(1.0 + exact.slopes[0] ** 2)
        return Slice(
            height=share * EXTENT,
            outcome=Outcome.CLOSED,
            radii=np.maximum(found.radii[0], 1e-3) * EXTENT,
            slopes=found.slopes[0],
            curvatures=found.curvatures[0] / EXTENT,
            felt_low=share * EXTENT - reach,
            felt_high=share * EXTENT + reach,
            deviation=self._noise,
        )

    def _disturbed(self, exact: Measured, share: float) -> Measured:
        """Each touch is off as a whole."""
        rng = np.random.default_rng([self._seed, round(1e6 * share)])
        touches = TURNS // TOUCH
        shift = np.repeat(rng.normal(size=touches), TOUCH) * self._noise / EXTENT
        lean = np.repeat(rng.normal(size=touches), TOUCH) * NOISY_SLOPE
        bend = np.repeat(rng.normal(size=touches), TOUCH) * NOISY_BEND * EXTENT
        return Measured(exact.radii + shift, exact.slopes + lean, exact.curvatures + bend)


def lost(height: float) -> Slice:
    """A slice beside the object."""
    none = np.zeros(0)
    return Slice(
        height=height,
        outcome=Outcome.LOST,
        radii=none,
        slopes=none,
        curvatures=none,
        felt_low=none,
        felt_high=none,
    )


def positions_only(heights: Floats, squares: Floats, wanted: Floats) -> Floats:
    """Squared radii between contours from their positions alone."""
    from scipy.interpolate import PchipInterpolator

    if len(heights) == 2:
        share = ((wanted - heights[0]) / (heights[1] - heights[0]))[:, None]
        return np.asarray((1.0 - share) * squares[0] + share * squares[1])
    return np.asarray(PchipInterpolator(heights, squares)(wanted))


def run(
    planner: Planner, trial: Trial, tolerance: float, most: int = MOST - 1
) -> tuple[tuple[Slice, ...], Stop | None]:
    """Let a planner work until it stops, or has `most` slices.

    Parameters
    ----------
    planner : Planner
        Who chooses.
    trial : Trial
        Who answers.
    tolerance : float
        Root mean square error asked for, over the object's height.
    most : int
        Slices at most.

    Raises
    ------
    ValueError
        If its answer is none to act on; see `palpate.core.explore.planners.asking.ask`.
    """
    slices: tuple[Slice, ...] = ()
    while True:
        choice = ask(planner, known_of(slices, tolerance))
        if isinstance(choice, Stop):
            return slices, choice
        if len(slices) >= most or not isinstance(choice, Height):
            return slices, None
        slices = (*slices, trial.slice_at(choice.height))


def known_of(slices: tuple[Slice, ...], tolerance: float) -> Known:
    """What the planner is told."""
    return Known(
        low=0.0,
        high=EXTENT,
        tolerance=tolerance * EXTENT,
        resolution=RESOLUTION,
        feature=FEATURE,
        slices=slices,
    )
