"""Closed curves through points that were measured around a contour.

The knots are periodic, so that a curve is closed, with two derivatives, by construction; the thesis
closes a clamped spline by constraints (see `palpate.core.thesis`). The curve does not depend on the
first point and the direction of the input, and its fit estimates the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, probable_error_sigma
from palpate.core.geometry import self_intersects
from palpate.core.splines import curve_fits
from palpate.core.splines.bases import CUBIC, periodic_knots
from palpate.reprs import readable

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedCurveSettings:
    """Estimate of the noise of points around a curve, and tests of the curve."""

    fit: curve_fits.CurveFitSettings = curve_fits.DEFAULT_CURVE_FIT
    # Fewer points count as free of noise: noise and shape look alike, as at the corners of a
    # square, each of which makes five points deviate.
    min_noise_points: int = 25
    # Median cosine between deviations of neighbours, above which they are shape. Noise has -0.8.
    max_noise_cosine: float = -0.5
    max_flat_spread: float = 1e-9  # width over length of a line; height over length of a plane
    n_chords: int = 4  # of each knot interval, in the polygon that is tested for crossings


DEFAULT_CLOSED_CURVE = ClosedCurveSettings()


class CurveFlags(NamedTuple):
    """Warnings about the points and the curve."""

    degenerate: bool  # all points lie in one place or on one line; the curve encloses nothing
    uneven: bool  # the longest gap between neighbours is over `max_gap_ratio` times the shortest
    self_intersecting: bool  # the curve meets itself, seen along its normal


@readable
@dataclass(frozen=True, slots=True, eq=False)
class ClosedCurve:
    """A closed cubic B-spline, counter-clockwise; its parameter runs from 0 to 1, in turns."""

    control: Floats  # control points (n, d) [m]; the first 3 are repeated at the end
    knots: Floats  # (n + 7,), the domain from 0 to 1
    parameters: Floats  # (m,): of the points used, in the order of `used`
    used: Ints  # (m,): rows of the input that were used, from the curve's beginning on
    dropped: int  # rows that were not finite
    residual: float  # [m] root mean square distance of the points from their places on the curve
    sigma: float  # [m] estimated noise: standard deviation of one coordinate
    condition: float  # condition number of the matrix from control points to points and bending
    effective: float  # degrees of freedom for each coordinate; number of points if interpolated
    smoothing: float  # weight of the bending against that of the points; 0: interpolated
    flags: CurveFlags

    def at(self, turn: ArrayLike, derivative: int = 0) -> Floats:
        """Points (k, d) [m], or derivatives by the turn, at parameters (k,) or a number, any turns.

        Raises ValueError if a parameter is not finite, or the derivative is negative.
        """
        turns = np.mod(np.atleast_1d(np.asarray(turn, np.float64)), 1.0)
        return curve_fits.closed_curve_points(self.control, self.knots, turns, derivative)

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        turns, weights = self._nodes()
        return float(weights @ np.linalg.norm(self.at(turns, 1), axis=1))

    @property
    def area(self) -> float | None:
        """Enclosed area [m^2], counted once for each turn; None if the curve is not plane."""
        turns, weights = self._nodes()
        middle = self.control.mean(axis=0)
        size = float(np.ptp(self.control, axis=0).max())
        if size == 0.0:
            return 0.0
        places, slopes = (self.at(turns) - middle) / size, self.at(turns, 1) / size
        if places.shape[1] == 2:
            twice = weights @ (places[:, 0] * slopes[:, 1] - places[:, 1] * slopes[:, 0])
            return 0.5 * float(twice) * size * size
        vector = 0.5 * weights @ np.cross(places, slopes)
        area = float(np.linalg.norm(vector))
        height = float(np.abs((self.control - middle) @ vector).max()) / size
        rounding = curve_fits.ROUNDING * float(np.abs(self.control).max()) / size
        return (
            area * size * size
            if height <= (DEFAULT_CLOSED_CURVE.max_flat_spread + rounding) * area
            else None
        )

    @property
    def closure_gap(self) -> float:
        """Distance between the curve's two ends [m]."""
        first, last = curve_fits.closed_curve_points(self.control, self.knots, np.array([0.0, 1.0]))
        return float(np.linalg.norm(last - first))

    def _nodes(self) -> tuple[Floats, Floats]:
        breaks = self.knots[CUBIC:-CUBIC]
        half = 0.5 * np.diff(breaks)
        turns = (breaks[:-1] + half)[:, None] + half[:, None] * GAUSS_NODES
        return turns.ravel(), (half[:, None] * GAUSS_WEIGHTS).ravel()


def fit_closed_curve(
    points: ArrayLike,
    *,
    count: int | None = None,
    parameters: curve_fits.Parametrisation = "auto",
    smoothing: curve_fits.Smoothing = "auto",
    settings: ClosedCurveSettings = DEFAULT_CLOSED_CURVE,
) -> ClosedCurve:
    """Closed cubic through or near points around a contour.

    `points` (m, 2) or (m, 3): around the contour [m], from any first point, in either direction,
    with the first repeated at the end or not. Rows that are not finite are dropped and counted;
    equal neighbours are one point. `count`: control points, at least 4, with even knots. None: as
    many as points, interpolating all of them, without smoothing; otherwise half as many, at most
    100. `parameters`: see `curve_parameters`. `smoothing`: weight of the bending against the mean
    weight of the points; "gcv" chooses it by cross-validation, None does not smooth (with a
    `count`: hardly). "auto" is "gcv" where there are 25 points or more, and neighbours deviate from
    a smooth curve in opposite directions; else None. Where the residuals of half as many control
    points exceed that noise, these cannot follow the shape, and all points are interpolated. The
    result does not depend on the first point and the direction. For points in one place it is that
    place, for points on a line it runs there and back; both are flagged. Raises ValueError if the
    shape of `points` is another, no row is finite, the count is below 4, the smoothing is negative
    or not finite, or a word is none of those above.
    """
    _check(count, parameters, smoothing)
    ring = curve_fits.order_closed_points(np.asarray(points, np.float64))
    if len(ring.points) < 2:
        return _point(ring)
    turns = curve_fits.curve_parameters(ring.points, parameters)
    noise = local_noise(ring.points, turns, settings)
    fit = curve_fits.choose_closed_fit(ring.points, turns, count, smoothing, noise, settings.fit)
    return closed_curve_of(ring, fit, noise, settings)


def _check(
    count: int | None, parameters: curve_fits.Parametrisation, smoothing: curve_fits.Smoothing
) -> None:
    if count is not None and count < curve_fits.MIN_CONTROL:
        raise ValueError(f"count must be at least {curve_fits.MIN_CONTROL}, got {count}")
    if parameters not in get_args(curve_fits.Parametrisation):
        words = ", ".join(get_args(curve_fits.Parametrisation))
        raise ValueError(f"parameters must be one of {words}, got {parameters!r}")
    if isinstance(smoothing, str):
        if smoothing not in ("auto", "gcv"):
            raise ValueError(f"smoothing must be auto, gcv, a number or None, got {smoothing!r}")
    elif smoothing is not None and not 0.0 <= smoothing < np.inf:
        raise ValueError(f"smoothing must be 0 or more and finite, got {smoothing}")


def _point(ring: curve_fits.ClosedPoints) -> ClosedCurve:
    return ClosedCurve(
        control=np.repeat(ring.middle[None], curve_fits.MIN_CONTROL, axis=0),
        knots=periodic_knots(curve_fits.MIN_CONTROL),
        parameters=np.zeros(1),
        used=ring.rows,
        dropped=ring.dropped,
        residual=0.0,
        sigma=0.0,
        condition=1.0,
        effective=1.0,
        smoothing=0.0,
        flags=CurveFlags(degenerate=True, uneven=False, self_intersecting=False),
    )


def local_noise(
    points: Floats, parameters: Floats, settings: ClosedCurveSettings = DEFAULT_CLOSED_CURVE
) -> float:
    """Standard deviation of the noise across the curve, in the points' unit; 0 where there is none.

    Each point is compared with the cubic through its two neighbours on either side. On a smooth
    curve, deviations of neighbours agree; with noise they are opposite. The median ignores corners.
    """
    count = len(points)
    if count < settings.min_noise_points:
        return 0.0
    index = (np.arange(count)[:, None] + np.array([-2, -1, 1, 2])) % count
    away = parameters[index] - parameters[:, None]
    away = away - np.round(away)
    weights = _cubic_weights(away)
    deviations = points - np.einsum("mk,mkd->md", weights, points[index])
    deviations /= np.sqrt(1.0 + (weights**2).sum(axis=1))[:, None]
    lengths = np.linalg.norm(deviations, axis=1)
    along = np.einsum("md,md->m", deviations, np.roll(deviations, -1, axis=0))
    if np.median(along - settings.max_noise_cosine * lengths * np.roll(lengths, -1)) >= 0.0:
        return 0.0
    # Noise shows in one coordinate only: the parameters follow the points along the curve.
    return probable_error_sigma(lengths)


def _cubic_weights(away: Floats) -> Floats:
    between = away[:, None, :] - away[:, :, None]
    np.einsum("mkk->mk", between)[:] = 1.0
    factors = np.where(np.eye(4, dtype=bool), 1.0, away[:, None, :])
    return np.asarray((factors / between).prod(axis=2))


def closed_curve_of(
    ring: curve_fits.ClosedPoints,
    fit: curve_fits.CurveFit,
    noise: float,
    settings: ClosedCurveSettings = DEFAULT_CLOSED_CURVE,
) -> ClosedCurve:
    """The fit in the points' own place and scale, with residual, noise and flags."""
    count = len(ring.points)
    offsets = ring.points - curve_fits.closed_curve_points(fit.control, fit.knots, fit.parameters)
    squares = float((offsets**2).sum())
    freedom = count - fit.effective
    spread, axes = np.linalg.svd(ring.points - ring.points.mean(axis=0), full_matrices=False)[1:]
    narrow = settings.max_flat_spread * spread[0]
    # Along the curve the parameters follow the points: noise shows across it.
    n_across = 1 if len(spread) < 3 or spread[2] <= narrow else 2
    sigma = np.sqrt(squares / (n_across * freedom)) if freedom > 0.5 else noise
    flat = count < 3 or spread[1] <= narrow
    breaks = fit.knots[CUBIC:-CUBIC]
    fine = np.linspace(breaks[:-1], breaks[1:], settings.n_chords, endpoint=False).T.ravel()
    polygon = curve_fits.closed_curve_points(fit.control, fit.knots, fine) @ axes[:2].T
    flags = CurveFlags(
        degenerate=bool(flat),
        uneven=bool(curve_fits.gap_ratio(ring.points) > settings.fit.max_gap_ratio),
        self_intersecting=bool(not flat and self_intersects(polygon)),
    )
    return ClosedCurve(
        control=ring.middle + ring.size * fit.control,
        knots=fit.knots,
        parameters=fit.parameters,
        used=ring.rows,
        dropped=ring.dropped,
        residual=ring.size * float(np.sqrt(squares / count)),
        sigma=ring.size * float(sigma),
        condition=fit.condition,
        effective=fit.effective,
        smoothing=fit.smoothing,
        flags=flags,
    )
