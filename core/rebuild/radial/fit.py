"""The radial spline with a shift of each touch where poses err, and what is kept of the fit.

A pose that is believed a tenth of a millimetre off moves a whole patch. Neighbouring patches
overlap, so that the surface and one small shift of each touch can be found in one system: least
squares with a block of correlated errors for each touch. Sharp edges look like shifts to a
smooth surface; so the shifts are only believed if they explain most of what the surface alone
leaves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.loft import SAFE_MOST, SAFE_RMS, Uncertainty
from palpate.core.rebuild.radial.spline import (
    MEDIAN,
    SPANS,
    RadialSpline,
    fit_radial_spline,
    stiffened,
)

SWEEPS = 2  # Fits, each about the points as the shifts before have moved them
# How many taxels weigh as much as the belief that a touch is not shifted. The taxels' own noise
# over the poses' would be a hundredth; but a smooth surface errs by more than the taxels do.
STRICTNESS = 0.3
EXPLAINED = 0.7  # Of the median misfit: shifts are believed if they leave no more of it
# Of the height: what is less noise is neither looked into nor smoothed. Edges leave half as much
# without any noise, and shifts ten times as large seem to explain it.
WORTHWHILE = 1e-4
# With fewer touches, or fewer taxels in half of them, shifts cannot be told from the surface.
FEWEST_TOUCHES, FEWEST_TAXELS = 8, 12
ITERATIONS, ENOUGH = 60, 1e-6  # Of the conjugate gradients, and the residual at which they end
# Heights at which the deviation is given, and turns over which it is averaged.
BANDS, BAND_TURNS = 25, 4
# Of the touches' pose error: what it leaves in the surface, for shifts are known against each other
# alone. Measured on shipped scenes with 5 and 9 contours, where it makes the 95 % band true.
POSE_LEFT = 0.4
SECTORS = 24  # Parts of a turn, each of which is looked at by itself
TINY = 0.02  # Of the height that was touched: a stretch without a point that is lower is none


class ShiftedSpline(NamedTuple):
    """A radial spline, and by how much each touch was shifted."""

    spline: RadialSpline  # The better one of both
    shifts: Floats | None  # (touches, 3), m; None if they were not believed


def fit_shifted_spline(contacts: ContactPoints, plain: RadialSpline) -> ShiftedSpline:
    """Fit a spline once more, with a shift of each touch, if that explains its misfits.

    `contacts` are those that the plain one was fitted to, with normals.
    """
    used = np.bincount(plain.rows.touch)
    used = used[used > 0]
    before = plain.sigma
    if not before > WORTHWHILE * (plain.high - plain.low):
        return ShiftedSpline(plain, None)
    if len(used) < FEWEST_TOUCHES or np.median(used) < FEWEST_TAXELS:
        return ShiftedSpline(stiffened(contacts, plain), None)
    shifts = np.zeros((int(contacts.touch.max()) + 1, 3))
    spline = plain
    for _ in range(SWEEPS):
        shifts += _more_shifts(spline, shifts)
        moved = contacts._replace(points=contacts.points - shifts[contacts.touch])
        spline = fit_radial_spline(moved, plain.axis_curve, plain.low, plain.high)
    if spline.sigma < EXPLAINED * before:
        return ShiftedSpline(stiffened(moved, spline), shifts)
    return ShiftedSpline(stiffened(contacts, plain), None)


def _more_shifts(spline: RadialSpline, believed: Floats) -> Floats:
    """Shifts (k, 3) on top of those believed, whose points have been moved back by them.

    The surface is eliminated: what remains is a system of the shifts, solved by conjugate
    gradients with each touch's own block as preconditioner.
    """
    rows, count = spline.rows, len(believed)
    blocks = _blocks(rows.normals, rows.touch, count)
    own = _own(rows.normals, rows.touch, count)
    inverse = np.linalg.inv(own)

    def system(shifts: Floats) -> Floats:
        moved = blocks @ shifts.ravel()
        smooth = rows.matrix @ spline.system.solve(rows.matrix.T @ moved)
        found: Floats = (blocks.T @ (moved - smooth)).reshape(-1, 3) + STRICTNESS * shifts
        return found

    right = (blocks.T @ spline.misfits()).reshape(-1, 3) - STRICTNESS * believed
    found = np.zeros_like(right)
    rest = right
    ahead = direction = np.einsum("kij,kj->ki", inverse, rest)
    size = start = float(np.vdot(rest, ahead))
    for _ in range(ITERATIONS):
        if not size > ENOUGH**2 * start:
            break
        image = system(direction)
        step = size / float(np.vdot(direction, image))
        found, rest = found + step * direction, rest - step * image
        ahead = np.einsum("kij,kj->ki", inverse, rest)
        size, before = float(np.vdot(rest, ahead)), size
        direction = ahead + size / before * direction
    return found


def _blocks(normals: Floats, touch: Ints, count: int) -> csr_array:
    """From shifts (3 count,) to distances along the normals (n,)."""
    n = len(normals)
    columns = (3 * touch[:, None] + np.arange(3)).ravel()
    return csr_array((normals.ravel(), columns, 3 * np.arange(n + 1)), shape=(n, 3 * count))


def _own(normals: Floats, touch: Ints, count: int) -> Floats:
    """Each touch's block of the system, (count, 3, 3)."""
    own = np.zeros((count, 3, 3))
    np.add.at(own, touch, normals[:, :, None] * normals[:, None, :])
    return own + STRICTNESS * np.eye(3)


def pose_sigma(shifted: ShiftedSpline) -> float | None:
    """Standard deviation of a pose along the normals, from the median shift, m."""
    if shifted.shifts is None:
        return None
    return _along_normals(shifted.spline, shifted.shifts)


def _along_normals(spline: RadialSpline, shifts: Floats) -> float:
    """Standard deviation of shifts (k, 3) along the normals, from their median, m."""
    along = np.einsum("ni,ni->n", spline.rows.normals, shifts[spline.rows.touch])
    return float(np.median(np.abs(along))) / MEDIAN


class RadialFit(NamedTuple):
    """A fit of the side to contact points; lengths in m."""

    points: int  # Points on the side
    rms: float  # Root mean square distance of the points from the spline along their normals
    sigma: float  # Standard deviation of a point, from the median distance
    pose_blocks: bool  # Whether a shift of each touch was estimated with the spline
    pose_sigma: float  # Standard deviation of those shifts along the normals; 0 without
    condition: float  # Estimate of the system's condition number, to 2 digits
    unfelt_gap: float  # The highest stretch of the side that was not touched on some azimuth
    stretched: bool  # Whether the side had to be drawn higher than it was touched
    lows: Floats  # Lowest height that was touched in each of 24 even sectors, (24,)
    highs: Floats  # Highest one, (24,)
    gaps: Floats  # Heights of the stretches that were not touched, in any of the sectors, (n,)
    band_heights: Floats  # (25,)
    band: Floats  # Standard deviation of the surface at those heights, (25,)

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the fit, by name."""
        numbers = self._asdict().items()
        single = {name: value for name, value in numbers if not isinstance(value, np.ndarray)}
        return {f"felt_{name}": float(value) for name, value in single.items()}

    def uncertainty(self) -> Uncertainty:
        """The whole side in three numbers."""
        extent = float(self.band_heights[-1] - self.band_heights[0])
        narrow = max(self.unfelt_gap, extent / SPANS)
        rms = float(np.sqrt(np.mean(self.band**2)))
        return Uncertainty(SAFE_RMS * rms, SAFE_MOST * float(self.band.max()), 0.5 * narrow)


def radial_fit(
    spline: RadialSpline,
    seen: Coverage,
    pose: float | None,
    reach: tuple[float, float],
    stretched: bool,
) -> RadialFit:
    """What is kept of a spline that is used between two heights, the `reach`, m.

    `pose` is the standard deviation of the touches' shifts, m, None if they were not estimated;
    `stretched` says that the reach is more than was touched.
    """
    heights = np.linspace(*reach, BANDS)
    deviation = spline.deviation(heights, np.arange(BAND_TURNS) / BAND_TURNS)
    return RadialFit(
        points=len(spline.rows.touch),
        rms=float(np.sqrt(np.mean(spline.misfits() ** 2))),
        sigma=spline.sigma,
        pose_blocks=pose is not None,
        pose_sigma=0.0 if pose is None else pose,
        condition=spline.system.condition,
        unfelt_gap=seen.gap,
        stretched=stretched,
        lows=seen.lows,
        highs=seen.highs,
        gaps=seen.gaps,
        band_heights=heights,
        band=np.sqrt(np.mean(deviation**2, axis=1) + (POSE_LEFT * (pose or 0.0)) ** 2),
    )


class Coverage(NamedTuple):
    """Of the side, m."""

    low: float  # Height from which on it was touched all around
    high: float  # Height up to which it was
    gap: float  # The highest stretch between them in which nothing was touched on some azimuth
    lows: Floats  # Lowest height that was touched in each sector, (24,)
    highs: Floats  # Highest one, (24,)
    gaps: Floats  # Heights of stretches not touched, in any sector, (n,); tiny ones are left out


def coverage_of(heights: Floats, turns: Floats) -> Coverage | None:
    """Coverage of points at heights (n,) and turns (n,); None if a sector has no point."""
    sector = (np.mod(turns, 1.0) * SECTORS).astype(np.int32) % SECTORS
    if len(np.unique(sector)) < SECTORS:
        return None
    lows, highs = np.full(SECTORS, np.inf), np.full(SECTORS, -np.inf)
    np.minimum.at(lows, sector, heights)
    np.maximum.at(highs, sector, heights)
    order = np.lexsort((heights, sector))
    step = np.diff(heights[order])
    same = np.diff(sector[order]) == 0
    step = step[same]
    gaps = step[step > TINY * float(np.ptp(heights))]
    gap = float(step.max(initial=0.0))
    return Coverage(float(lows.max()), float(highs.min()), gap, lows, highs, gaps)
