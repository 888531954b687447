"""The radial spline as the side of a solid, exact at every place, and how far to trust it.

The place is the axis at a height and the root of the squared distance from it on an azimuth:
derivatives follow by the chain rule. Heights are walked by the sine of an angle, so that rows lie
closer together towards both ends, where a side may turn level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.side.equations import AxisCurve
from palpate.core.rebuild.side.radial import (
    LEAST,
    POSE_LEFT,
    SECTORS,
    SPANS,
    RadialSpline,
    along_basis,
    gap_widths,
)
from palpate.core.splines import (
    CUBIC,
    Basis,
    clamped_basis,
    evaluate_grid,
    evaluate_scattered,
    wound_basis,
)
from palpate.reprs import readable

# Times the deviation: what root mean square and largest error stay below on nine of ten objects
# without features narrower than the contours' spacing.
SAFE_RMS, SAFE_MOST = 1.5, 4.0
# Heights at which the deviation is given, and turns of its average: half a step on at every other.
BANDS, BAND_TURNS = 25, 12
GAP_ROWS = 4  # Rows about each of those heights in which gaps are looked for
FINE_SECTORS = 360  # Those in which the outermost heights are told
WALKED = 0.94  # Fraction of the half turn of the sine by which heights are walked
# Splines along and around that follow a radial side closely: what a control lattice has.
ROWS, AROUND = 65, 128
Orders = tuple[int, int]


class Uncertainty(NamedTuple):
    """The whole object in three numbers, m, if nothing on it is narrower than the spacing."""

    rms: float  # What the root mean square error of the side stays below
    most: float  # What the largest error stays below
    resolution: float  # Half the largest spacing of the contours: narrower things may be missed


@readable
@dataclass(frozen=True, slots=True, eq=False)
class RadialPatch:
    """A radial spline between two heights: from 0 at the lower one to 1 at the upper one."""

    axis_curve: AxisCurve  # Axis from which distances are taken
    extent: tuple[float, float]  # Heights between which the spline lies, m
    coefficients: Floats  # Of the squared distance, (along, around), m^2
    least: float  # The smallest squared distance ever given, m^2
    reach: tuple[float, float]  # Heights between which it is the side, m

    @property
    def along(self) -> Basis:
        """Splines from 0 to 1 that follow it closely along."""
        return clamped_basis(ROWS)

    @property
    def around(self) -> int:
        """Number of coefficients of a closed spline that follows it closely around."""
        return AROUND

    def at(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """Points (n, 3), m, at shares v and turns (n,), or derivatives by them, together to 2."""
        heights = self._heights(v, by[0])
        places = np.stack([self._local(heights[0]), np.mod(turns, 1.0)], axis=-1)

        def squared(orders: list[Orders]) -> list[Floats]:
            found = evaluate_scattered(self._bases, self._wound, places, orders)
            return [one[:, 0] for one in found]

        return self._points(squared, heights, turns, by)

    def on_grid(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """The same at each pair of shares v (a,) and turns (b,): (a, b, 3), m."""
        heights = self._heights(v, by[0])
        axes = [self._local(heights[0]), np.mod(turns, 1.0)]

        def squared(orders: list[Orders]) -> list[Floats]:
            return [evaluate_grid(self._bases, self._wound, axes, one)[..., 0] for one in orders]

        return self._points(squared, [one[:, None] for one in heights], turns, by)

    def rings(self, heights: Floats, turns: Floats) -> Floats:
        """Places in the plane at heights (a,), m, and turns (b,), (a, b, 2), m."""
        axes = [self._local(heights), np.mod(turns, 1.0)]
        squared = evaluate_grid(self._bases, self._wound, axes)[..., 0]
        radius, angle = np.sqrt(np.maximum(squared, self.least)), 2.0 * np.pi * turns
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.asarray(self.axis_curve.at(heights)[:, None] + radius[..., None] * rim)

    def _heights(self, v: Floats, order: int) -> list[Floats]:
        """Heights of shares v (n,), m, and their derivatives up to an order."""
        low, high = self.reach
        rate = np.pi * WALKED
        half = 0.5 * (high - low) / np.sin(0.5 * rate)
        angle = rate * (np.clip(v, 0.0, 1.0) - 0.5)
        found = [half * rate**k * np.sin(angle + 0.5 * np.pi * k) for k in range(order + 1)]
        return [found[0] + 0.5 * (low + high), *found[1:]]

    def _points(
        self,
        squared: Callable[[list[Orders]], list[Floats]],
        heights: list[Floats],
        turns: Floats,
        by: Orders,
    ) -> Floats:
        """Points or derivatives, by those of the squared distance and of the heights by v."""
        low, high = self.extent
        orders = [(i, j) for i in range(by[0] + 1) for j in range(by[1] + 1)]
        pairs = zip(orders, squared(orders), strict=True)
        radius = _roots({one: q / (high - low) ** one[0] for one, q in pairs}, self.least)
        way, rate = np.exp(2j * np.pi * turns), 2j * np.pi
        shares = [[1.0], [1.0, 1.0], [1.0, 2.0, 1.0]][by[1]]  # Leibniz's rule around

        def plane(order: int) -> Floats:
            """Derivative by the height, of this order, and by turns, as x + iy."""
            terms = (
                share * radius[order, j] * rate ** (by[1] - j) for j, share in enumerate(shares)
            )
            found = sum(terms) * way
            if by[1] == 0:
                axis = self.axis_curve.at(heights[0].ravel(), order).reshape(*heights[0].shape, 2)
                found = found + axis[..., 0] + 1j * axis[..., 1]
            return np.asarray(found)

        if by[0] == 0:
            found = plane(0)
        elif by[0] == 1:
            found = heights[1] * plane(1)
        else:
            found = heights[1] ** 2 * plane(2) + heights[2] * plane(1)
        rise = np.broadcast_to(heights[by[0]] if by[1] == 0 else 0.0, found.shape)
        return np.stack([found.real, found.imag, rise], axis=-1)

    def _local(self, heights: Floats) -> Floats:
        low, high = self.extent
        return np.clip((heights - low) / (high - low), 0.0, 1.0)

    @property
    def _bases(self) -> tuple[Basis, Basis]:
        return along_basis(), wound_basis(self.coefficients.shape[1])

    @property
    def _wound(self) -> Floats:
        return np.concatenate([self.coefficients, self.coefficients[:, :CUBIC]], axis=1)[..., None]


def _roots(squares: dict[Orders, Floats], least: float) -> dict[Orders, Floats]:
    """The root of a function that is at least `least`, and derivatives, by those of its square."""
    root = np.sqrt(np.maximum(squares[0, 0], least))
    half = np.where(squares[0, 0] > least, 0.5 / root, 0.0)
    found = {(0, 0): root}
    for order, square in squares.items():
        if sum(order) == 1:
            found[order] = half * square
    for order in (one for one in squares if sum(one) == 2):
        one, other = ((1, 0), (0, 1)) if order == (1, 1) else ((order[0] // 2, order[1] // 2),) * 2
        found[order] = half * squares[order] - found[one] * found[other] / root
    return found


@readable
@dataclass(frozen=True, slots=True, eq=False)
class RadialSide:
    """The side of contact points, how it was fitted, and how far to trust it; lengths in m."""

    patch: RadialPatch  # Where it is
    points: int  # Points on the side
    rms: float  # Root mean square distance of the points from the spline along their normals
    sigma: float  # Standard deviation of a point, from the median distance
    pose_blocks: bool  # Whether a shift of each touch was estimated with the spline
    pose_sigma: float  # Standard deviation of those shifts along the normals; 0 without
    freedom: float  # Degrees of freedom spent
    condition: float | None  # Estimate of the system's condition number; of a draft none
    seen: Coverage  # Where it was touched
    stretched: bool  # Whether the side had to be drawn higher than it was touched
    band_heights: Floats  # (25,)
    deviations: Floats  # Standard deviation of the surface at those heights, (25,)

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the fit, by name."""
        names = "points", "rms", "sigma", "pose_blocks", "pose_sigma", "stretched"
        found = {f"radial_{name}": float(getattr(self, name)) for name in names}
        found["radial_untouched_gap"] = self.seen.gap
        found |= {"sigma": self.sigma, "degrees_of_freedom": self.freedom}
        if self.condition is not None:
            found |= {"condition": self.condition, "radial_condition": self.condition}
        return found

    @property
    def scatter(self) -> float:
        """Standard deviation of what touched, poses included."""
        return float(np.hypot(self.sigma, self.pose_sigma))

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Standard deviation across the rings at heights (a,), the mean around: (a, b)."""
        levels = np.interp(heights, self.band_heights, self.deviations)
        return np.repeat(levels[:, None], len(turns), axis=1)

    def normal_deviation(self, heights: Floats, turns: Floats, steep: Floats) -> Floats:
        """That along normals whose part across the axis is `steep`, all (a, b).

        Where the side turns level, the poses are left. Taxels that lie farther off than their noise
        lets them say how far the surface is wrong.
        """
        left = np.maximum(steep * self.deviation(heights, turns), POSE_LEFT * self.pose_sigma)
        return np.asarray(np.sqrt(left**2 + max(self.rms**2 - self.sigma**2, 0.0)))

    def band(self) -> tuple[Floats, Floats]:
        """Heights (n,), and the root mean square of the deviation around at each."""
        return self.band_heights, self.deviations

    def reached(self, rim: float, upper: bool) -> Floats:
        """Heights (n,) up to which it was touched, at even turns; `rim` is its last height."""
        return self.seen.highs if upper else self.seen.lows

    def uncertainty(self) -> Uncertainty:
        """What its error stays below, and what is narrower than could be seen."""
        extent = float(self.band_heights[-1] - self.band_heights[0])
        narrow = max(self.seen.gap, extent / SPANS)
        rms, most = float(np.sqrt(np.mean(self.deviations**2))), float(self.deviations.max())
        return Uncertainty(SAFE_RMS * rms, SAFE_MOST * most, 0.5 * narrow)


def radial_side(
    spline: RadialSpline,
    seen: Coverage,
    pose: float | None,
    reach: tuple[float, float],
    stretched: bool,
    draft: bool = False,
) -> RadialSide:
    """What is kept of a spline between two heights, the `reach`, m."""
    heights = np.linspace(*reach, BANDS)
    deviation = np.empty((BANDS, BAND_TURNS))
    for first in range(2):
        turns = (np.arange(BAND_TURNS) + 0.5 * first) / BAND_TURNS
        deviation[first::2] = spline.deviation(heights[first::2], turns)
    # No gap may lie between places: those of the gaps are closer together than a gap is wide.
    beside = (heights[1] - heights[0]) * (np.arange(GAP_ROWS) + 0.5 - 0.5 * GAP_ROWS) / GAP_ROWS
    rows = np.clip((heights[:, None] + beside).ravel(), *reach)
    gaps = gap_widths(spline, rows, np.arange(spline.around) / spline.around).reshape(BANDS, -1)
    extent, least = (spline.low, spline.high), LEAST * spline.middle**2
    return RadialSide(
        patch=RadialPatch(spline.axis_curve, extent, spline.coefficients, least, reach),
        points=len(spline.rows.touch),
        rms=float(np.sqrt(np.mean(spline.misfits**2))),
        sigma=spline.sigma,
        pose_blocks=pose is not None,
        pose_sigma=0.0 if pose is None else pose,
        freedom=spline.freedom,
        condition=None if draft else spline.system.condition,
        seen=seen,
        stretched=stretched,
        band_heights=heights,
        deviations=np.sqrt(np.mean(deviation**2, axis=1) + np.mean(gaps**2, axis=1)),
    )


class Coverage(NamedTuple):
    """Of the side, m."""

    low: float  # Height from which on it was touched all around
    high: float  # Height up to which it was
    gap: float  # The highest stretch between them in which nothing was touched on some azimuth
    lows: Floats  # Lowest height that was touched in each fine sector, (360,), or infinity
    highs: Floats  # Highest one, (360,), or -infinity


def coverage_of(heights: Floats, turns: Floats) -> Coverage | None:
    """Coverage of points at heights (n,) and turns (n,); None if a sector has no point."""
    turns = np.mod(turns, 1.0)
    sector = (turns * SECTORS).astype(np.int32) % SECTORS
    if len(np.unique(sector)) < SECTORS:
        return None
    order = np.lexsort((heights, sector))
    same = np.diff(sector[order]) == 0
    gap = float(np.diff(heights[order])[same].max(initial=0.0))
    low, high = (float(one.max()) for one in (_lowest(heights, sector), _lowest(-heights, sector)))
    fine = (turns * FINE_SECTORS).astype(np.int32) % FINE_SECTORS
    lows, highs = _lowest(heights, fine, FINE_SECTORS), -_lowest(-heights, fine, FINE_SECTORS)
    return Coverage(low, -high, gap, lows, highs)


def _lowest(heights: Floats, sector: Ints, count: int = SECTORS) -> Floats:
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, sector, heights)
    return lowest
