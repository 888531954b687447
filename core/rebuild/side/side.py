"""The radial spline as the side of a solid, exact at every place, and its uncertainty.

A place is the axis at a height plus the root of the squared distance from it on an azimuth:
derivatives follow by the chain rule. Heights are the sine of an angle, so that rows lie closer
together towards both ends, where a side may turn level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.side.equations import AxisCurve
from palpate.core.rebuild.side.radial import (
    DEFAULT_RADIAL,
    N_SPANS,
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

Orders = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorBoundSettings:
    """Bounds of the error of a side by its standard deviation.

    They hold on nine of ten objects without features narrower than the contours' spacing.
    """

    rms_factor: float = 1.5  # bound of the root mean square error over that of the deviation
    max_factor: float = 4.0  # bound of the largest error over the largest deviation
    # Fraction of the touches' pose error that is left where the side turns level, and in ends.
    min_pose_fraction: float = 0.4


DEFAULT_ERROR_BOUND = ErrorBoundSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class BandSettings:
    """Where the deviation of a radial side is evaluated."""

    n_heights: int = 25  # evenly spaced, at which it is kept
    n_turns: int = 12  # azimuths of its average; every other height has them half a step on
    n_gap_rows: int = 4  # rows about each height, in which gaps are searched


class Uncertainty(NamedTuple):
    """Error bounds of the side [m], valid if no feature is narrower than the spacing."""

    rms: float  # bound of the root mean square error of the side
    most: float  # bound of its largest error
    resolution: float  # half the largest spacing of the contours: narrower features may be missed


@readable
@dataclass(frozen=True, slots=True, eq=False)
class RadialPatch:
    """A radial spline between two heights: from 0 at the lower one to 1 at the upper one."""

    # Part of the half turn of the sine that the parameter covers, and the number of splines along
    # and around that follow a side closely, as those of a control lattice.
    sine_fraction: ClassVar[float] = 0.94
    n_along: ClassVar[int] = 65
    n_around: ClassVar[int] = 128

    axis_curve: AxisCurve  # axis from which distances are measured
    extent: tuple[float, float]  # heights between which the spline lies [m]
    coefficients: Floats  # of the squared distance, (along, around) [m^2]
    least: float  # least squared distance [m^2]
    reach: tuple[float, float]  # heights between which it is the side [m]

    @property
    def along(self) -> Basis:
        """Splines from 0 to 1 that follow it closely along."""
        return clamped_basis(self.n_along)

    @property
    def around(self) -> int:
        """Number of coefficients of a closed spline that follows it closely around."""
        return self.n_around

    def at(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """Points (n, 3) [m] at parameters v and turns (n,), or derivatives to order 2 in all."""
        heights = self._heights(v, by[0])
        places = np.stack([self._local(heights[0]), np.mod(turns, 1.0)], axis=-1)

        def squared(orders: list[Orders]) -> list[Floats]:
            values = evaluate_scattered(self._bases, self._wound, places, orders)
            return [value[:, 0] for value in values]

        return self._points(squared, heights, turns, by)

    def on_grid(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """The same at each pair of parameters v (a,) and turns (b,): (a, b, 3) [m]."""
        heights = self._heights(v, by[0])
        axes = [self._local(heights[0]), np.mod(turns, 1.0)]

        def squared(orders: list[Orders]) -> list[Floats]:
            return [
                evaluate_grid(self._bases, self._wound, axes, order)[..., 0] for order in orders
            ]

        return self._points(squared, [level[:, None] for level in heights], turns, by)

    def rings(self, heights: Floats, turns: Floats) -> Floats:
        """Places in the plane (a, b, 2) [m] at heights (a,) [m] and turns (b,)."""
        axes = [self._local(heights), np.mod(turns, 1.0)]
        squared = evaluate_grid(self._bases, self._wound, axes)[..., 0]
        radius, angle = np.sqrt(np.maximum(squared, self.least)), 2.0 * np.pi * turns
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.asarray(self.axis_curve.at(heights)[:, None] + radius[..., None] * rim)

    def _heights(self, v: Floats, order: int) -> list[Floats]:
        """Heights [m] of parameters v (n,), and their derivatives up to an order."""
        low, high = self.reach
        rate = np.pi * self.sine_fraction
        half = 0.5 * (high - low) / np.sin(0.5 * rate)
        angle = rate * (np.clip(v, 0.0, 1.0) - 0.5)
        sines = [half * rate**k * np.sin(angle + 0.5 * np.pi * k) for k in range(order + 1)]
        return [sines[0] + 0.5 * (low + high), *sines[1:]]

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
        radius = _roots({order: q / (high - low) ** order[0] for order, q in pairs}, self.least)
        direction, rate = np.exp(2j * np.pi * turns), 2j * np.pi
        binomials = [[1.0], [1.0, 1.0], [1.0, 2.0, 1.0]][by[1]]  # Leibniz's rule around

        def plane(order: int) -> Floats:
            """Derivative of this order by the height, and by turns, as x + iy."""
            terms = (
                binomial * radius[order, j] * rate ** (by[1] - j)
                for j, binomial in enumerate(binomials)
            )
            place = sum(terms) * direction
            if by[1] == 0:
                axis = self.axis_curve.at(heights[0].ravel(), order).reshape(*heights[0].shape, 2)
                place = place + axis[..., 0] + 1j * axis[..., 1]
            return np.asarray(place)

        if by[0] == 0:
            place = plane(0)
        elif by[0] == 1:
            place = heights[1] * plane(1)
        else:
            place = heights[1] ** 2 * plane(2) + heights[2] * plane(1)
        rise = np.broadcast_to(heights[by[0]] if by[1] == 0 else 0.0, place.shape)
        return np.stack([place.real, place.imag, rise], axis=-1)

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
    """Root of a function that is at least `least`, and its derivatives, by those of the square."""
    root = np.sqrt(np.maximum(squares[0, 0], least))
    half = np.where(squares[0, 0] > least, 0.5 / root, 0.0)
    roots = {(0, 0): root}
    for order, square in squares.items():
        if sum(order) == 1:
            roots[order] = half * square
    for order in (order for order in squares if sum(order) == 2):
        a, b = ((1, 0), (0, 1)) if order == (1, 1) else ((order[0] // 2, order[1] // 2),) * 2
        roots[order] = half * squares[order] - roots[a] * roots[b] / root
    return roots


@readable
@dataclass(frozen=True, slots=True, eq=False)
class RadialSide:
    """The side of contact points, how it was fitted, and its uncertainty; lengths in [m]."""

    patch: RadialPatch  # where it is
    points: int  # number of points on the side
    rms: float  # root mean square distance of the points from the spline along their normals
    sigma: float  # standard deviation of a point, from the median distance
    pose_blocks: bool  # whether a shift of each touch was estimated with the spline
    pose_sigma: float  # standard deviation of those shifts along the normals; 0 without
    freedom: float  # degrees of freedom spent
    condition: float | None  # estimate of the system's condition number; None for a draft
    seen: Coverage  # where it was touched
    stretched: bool  # whether the side is higher than the band that was touched
    band_heights: Floats  # (25,)
    deviations: Floats  # standard deviation of the surface at those heights, (25,)

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the fit, by name."""
        names = "points", "rms", "sigma", "pose_blocks", "pose_sigma", "stretched"
        figures = {f"radial_{name}": float(getattr(self, name)) for name in names}
        figures["radial_untouched_gap"] = self.seen.gap
        figures |= {"sigma": self.sigma, "degrees_of_freedom": self.freedom}
        if self.condition is not None:
            figures |= {"condition": self.condition, "radial_condition": self.condition}
        return figures

    @property
    def scatter(self) -> float:
        """Standard deviation of a contact, with its pose."""
        return float(np.hypot(self.sigma, self.pose_sigma))

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Standard deviation (a, b) across the rings at heights (a,), averaged around."""
        levels = np.interp(heights, self.band_heights, self.deviations)
        return np.repeat(levels[:, None], len(turns), axis=1)

    def normal_deviation(
        self,
        heights: Floats,
        turns: Floats,
        steep: Floats,
        settings: ErrorBoundSettings = DEFAULT_ERROR_BOUND,
    ) -> Floats:
        """Standard deviation along normals whose radial components are `steep`, all (a, b).

        A part of the pose error is left where the side turns level. Residuals of the taxels beyond
        their noise are errors of the surface.
        """
        least = settings.min_pose_fraction * self.pose_sigma
        left = np.maximum(steep * self.deviation(heights, turns), least)
        return np.asarray(np.sqrt(left**2 + max(self.rms**2 - self.sigma**2, 0.0)))

    def band(self) -> tuple[Floats, Floats]:
        """Heights (n,), and the root mean square of the deviation around at each."""
        return self.band_heights, self.deviations

    def reached(self, rim: float, upper: bool) -> Floats:
        """Heights (n,) up to which it was touched, at even turns; `rim` is its last height."""
        return self.seen.highs if upper else self.seen.lows

    def uncertainty(self, settings: ErrorBoundSettings = DEFAULT_ERROR_BOUND) -> Uncertainty:
        """Bounds of its error, and the width of features that may be missed."""
        extent = float(self.band_heights[-1] - self.band_heights[0])
        narrow = max(self.seen.gap, extent / N_SPANS)
        rms, most = float(np.sqrt(np.mean(self.deviations**2))), float(self.deviations.max())
        return Uncertainty(settings.rms_factor * rms, settings.max_factor * most, 0.5 * narrow)


def radial_side(
    spline: RadialSpline,
    seen: Coverage,
    pose: float | None,
    reach: tuple[float, float],
    stretched: bool,
    draft: bool = False,
    settings: BandSettings = BandSettings(),
) -> RadialSide:
    """The side that a spline is between two heights, the `reach` [m].

    `pose` is the standard deviation of the touches' shifts [m], None if there are none; of a
    `draft` the condition number is left out.
    """
    heights = np.linspace(*reach, settings.n_heights)
    return RadialSide(
        patch=RadialPatch(
            axis_curve=spline.axis_curve,
            extent=(spline.low, spline.high),
            coefficients=spline.coefficients,
            least=spline.min_square,
            reach=reach,
        ),
        points=len(spline.rows.touch),
        rms=float(np.sqrt(np.mean(spline.misfits**2))),
        sigma=spline.sigma,
        pose_blocks=pose is not None,
        pose_sigma=0.0 if pose is None else pose,
        freedom=spline.freedom,
        condition=None if draft else spline.system.condition(),
        seen=seen,
        stretched=stretched,
        band_heights=heights,
        deviations=_deviations(spline, heights, settings),
    )


def _deviations(spline: RadialSpline, heights: Floats, settings: BandSettings) -> Floats:
    """Root mean square deviation around (n,) at heights (n,), with the widths of gaps [m]."""
    n_turns, n_rows = settings.n_turns, settings.n_gap_rows
    deviation = np.empty((len(heights), n_turns))
    for first in range(2):
        turns = (np.arange(n_turns) + 0.5 * first) / n_turns
        deviation[first::2] = spline.deviation(heights[first::2], turns)
    # These places are closer together than a gap is wide: none is missed.
    beside = (heights[1] - heights[0]) * (np.arange(n_rows) + 0.5 - 0.5 * n_rows) / n_rows
    rows = np.clip((heights[:, None] + beside).ravel(), heights[0], heights[-1])
    around = np.arange(spline.around) / spline.around
    gaps = gap_widths(spline, rows, around).reshape(len(heights), -1)
    return np.asarray(np.sqrt(np.mean(deviation**2, axis=1) + np.mean(gaps**2, axis=1)))


class Coverage(NamedTuple):
    """Where a side was touched [m]."""

    low: float  # least height from which on all sectors were touched
    high: float  # largest height up to which they were
    gap: float  # largest untouched height between points of one sector
    lows: Floats  # lowest touched height in each fine sector, (360,), or infinity
    highs: Floats  # highest one, (360,), or -infinity


def coverage_of(
    heights: Floats,
    turns: Floats,
    n_sectors: int = DEFAULT_RADIAL.n_sectors,
    n_fine_sectors: int = 360,
) -> Coverage | None:
    """Coverage of points at heights (n,) [m] and turns (n,); None if a sector has no point.

    Sectors are even parts of a turn; in fine ones the outermost heights are measured.
    """
    turns = np.mod(turns, 1.0)
    sector = (turns * n_sectors).astype(np.int32) % n_sectors
    if len(np.unique(sector)) < n_sectors:
        return None
    order = np.lexsort((heights, sector))
    is_same = np.diff(sector[order]) == 0
    gap = float(np.diff(heights[order])[is_same].max(initial=0.0))
    low = float(_lowest(heights, sector, n_sectors).max())
    high = -float(_lowest(-heights, sector, n_sectors).max())
    fine = (turns * n_fine_sectors).astype(np.int32) % n_fine_sectors
    lows, highs = _lowest(heights, fine, n_fine_sectors), -_lowest(-heights, fine, n_fine_sectors)
    return Coverage(low, high, gap, lows, highs)


def _lowest(heights: Floats, sector: Ints, count: int) -> Floats:
    """Lowest height in each of `count` sectors, or infinity."""
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, sector, heights)
    return lowest
