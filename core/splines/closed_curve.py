"""Closed curves through points that were felt around a contour.

The thesis closes a clamped spline by constraints (see `closed_curve_thesis`); here the knots go
round the circle, so that a curve is closed, with two derivatives, by construction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints
from palpate.core.plane.crossings import crosses_itself
from palpate.core.splines.closed_curve_thesis import fit_closed_thesis
from palpate.core.splines.curve_choice import LEAST_CONTROL, UNEVEN, Smoothing, choose_fit
from palpate.core.splines.curve_fit import CurveFit, closed_places
from palpate.core.splines.curve_noise import local_noise
from palpate.core.splines.curve_parameters import Parameters, curve_parameters, gap_ratio
from palpate.core.splines.curve_points import ROUNDING, Ring, order_points
from palpate.core.splines.knots import CUBIC, periodic_knots

Method = Literal["periodic", "thesis"]

THESIS_CONTROL = 16
"""Vertices around a layer of 5 by 5."""
FLAT = 1e-9
"""Width of the points over their length from which on they are not on a line."""
FINE = 4
"""Chords for each knot interval in which a curve is tested for meeting itself."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(5)


class CurveFlags(NamedTuple):
    """What should be known of the points before the curve is used."""

    degenerate: bool
    """They lie in one place or on one line; the curve encloses nothing."""
    uneven: bool
    """The longest gap between neighbours is more than 20 times the shortest."""
    self_intersecting: bool
    """The curve meets itself, seen along its normal."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosedCurve:
    """A closed cubic B-spline, counter-clockwise; its parameter runs from 0 to 1, in turns."""

    control: Floats
    """Control points (n, d), m; the first 3 come again at the end."""
    knots: Floats
    """(n + 7,), the domain from 0 to 1."""
    parameters: Floats
    """(m,): those of the points that were used, in the order of `used`."""
    used: Ints
    """(m,): rows of the given points that were used, from the curve's beginning on."""
    dropped: int
    """Rows that were not finite."""
    residual: float
    """Root mean square distance of the points from their places on the curve, m."""
    sigma: float
    """Estimate of the noise, the standard deviation of one coordinate, m."""
    condition: float
    """Condition number of the matrix from control points to points and bending."""
    effective: float
    """Degrees of freedom spent on each coordinate; as many as points if it passes them all."""
    smoothing: float
    """Weight of the bending against the mean weight of the points; 0: the points are passed."""
    flags: CurveFlags
    """Warnings."""

    def at(self, turn: ArrayLike, derivative: int = 0) -> Floats:
        """Points (k, d), m, or derivatives by the turn, at parameters (k,) or a number: any turns.

        Raises
        ------
        ValueError
            If a parameter is not finite, or the derivative is negative.
        """
        turns = np.mod(np.atleast_1d(np.asarray(turn, np.float64)), 1.0)
        return closed_places(self.control, self.knots, turns, derivative)

    @property
    def length(self) -> float:
        """Of the curve, m."""
        turns, weights = self._nodes()
        return float(weights @ np.linalg.norm(self.at(turns, 1), axis=1))

    @property
    def area(self) -> float | None:
        """What it encloses, m^2, as often as it is gone round; None if the curve is not plane."""
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
        off = float(np.abs((self.control - middle) @ vector).max()) / size
        rounding = ROUNDING * float(np.abs(self.control).max()) / size
        return area * size * size if off <= (FLAT + rounding) * area else None

    @property
    def closure_gap(self) -> float:
        """Distance between the curve's two ends, m."""
        first, last = closed_places(self.control, self.knots, np.array([0.0, 1.0]))
        return float(np.linalg.norm(last - first))

    def _nodes(self) -> tuple[Floats, Floats]:
        """Places and weights of Gauss's rule in each knot interval; exact to degree 9."""
        breaks = self.knots[CUBIC:-CUBIC]
        half = 0.5 * np.diff(breaks)
        turns = (breaks[:-1] + half)[:, None] + half[:, None] * NODES
        return turns.ravel(), (half[:, None] * WEIGHTS).ravel()


def fit_closed_curve(
    points: ArrayLike,
    *,
    count: int | None = None,
    parameters: Parameters = "auto",
    smoothing: Smoothing = "auto",
    method: Method = "periodic",
) -> ClosedCurve:
    """Closed cubic through or near points around a contour.

    Parameters
    ----------
    points : (m, 2) or (m, 3) array
        Around the contour, m: begun anywhere, in either direction, the first again at the end
        or not. Rows that are not finite are dropped and counted; neighbours in one place are
        one point.
    count : int or None
        Control points, at least 4, with even knots. None: as many as points, through all of
        them, if nothing is smoothed; otherwise half as many, at most 100.
    parameters : {"auto", "chord", "centripetal", "even"}
        How parameters are set; see `curve_parameters`.
    smoothing : {"auto", "gcv"}, float or None
        Weight of the bending against the mean weight of the points; "gcv" chooses it by
        cross-validation, None smooths nothing (with a `count`: next to nothing). "auto" does
        as "gcv" does where there are 25 points or more, and neighbours deviate from a smooth
        course in opposite directions; as None does otherwise. Where half as many control
        points turn out to leave residuals larger than that noise, they cannot follow the
        shape, and all points are passed.
    method : {"periodic", "thesis"}
        The latter for comparison: `fit_closed_thesis`, with 16 vertices unless told.

    Returns
    -------
    ClosedCurve
        The same one however the points were begun or directed. Of points in one place it is
        that place, of points on a line it goes there and back; both are flagged.

    Raises
    ------
    ValueError
        If the shape of `points` is another, no row is finite, the count is below 4, the
        smoothing is negative or not finite, or a word is none of those above.
    """
    _check(count, parameters, smoothing, method)
    given = np.asarray(points, np.float64)
    if given.ndim != 2 or given.shape[1] not in (2, 3):
        raise ValueError(f"points must have shape (any, 2) or (any, 3), got {given.shape}")
    ring = order_points(given)
    if len(ring.points) < 2:
        return _point(ring)
    turns = curve_parameters(ring.points, parameters)
    noise = local_noise(ring.points, turns)
    if method == "thesis":
        fit = fit_closed_thesis(ring.points, turns, count or THESIS_CONTROL)
    else:
        fit = choose_fit(ring.points, turns, count, smoothing, noise)
    return _curve(ring, fit, noise)


def _check(count: int | None, parameters: Parameters, smoothing: Smoothing, method: Method) -> None:
    if count is not None and count < LEAST_CONTROL:
        raise ValueError(f"count must be at least {LEAST_CONTROL}, got {count}")
    if parameters not in get_args(Parameters):
        words = ", ".join(get_args(Parameters))
        raise ValueError(f"parameters must be one of {words}, got {parameters!r}")
    if method not in get_args(Method):
        raise ValueError(f"method must be periodic or thesis, got {method!r}")
    if isinstance(smoothing, str):
        if smoothing not in ("auto", "gcv"):
            raise ValueError(f"smoothing must be auto, gcv, a number or None, got {smoothing!r}")
    elif smoothing is not None and not 0.0 <= smoothing < np.inf:
        raise ValueError(f"smoothing must be 0 or more and finite, got {smoothing}")


def _curve(ring: Ring, fit: CurveFit, noise: float) -> ClosedCurve:
    """The fit in the points' own place and scale, with all that is reported of it."""
    count = len(ring.points)
    off = ring.points - closed_places(fit.control, fit.knots, fit.parameters)
    squares = float((off**2).sum())
    spare = count - fit.effective
    spread, axes = np.linalg.svd(ring.points - ring.points.mean(axis=0), full_matrices=False)[1:]
    # Along the curve the parameters follow the points: noise shows across it.
    across = 1 if len(spread) < 3 or spread[2] <= FLAT * spread[0] else 2
    sigma = np.sqrt(squares / (across * spare)) if spare > 0.5 else noise
    flat = count < 3 or spread[1] <= FLAT * spread[0]
    breaks = fit.knots[CUBIC:-CUBIC]
    fine = np.linspace(breaks[:-1], breaks[1:], FINE, endpoint=False).T.ravel()
    polygon = closed_places(fit.control, fit.knots, fine) @ axes[:2].T
    flags = CurveFlags(
        degenerate=bool(flat),
        uneven=bool(gap_ratio(ring.points) > UNEVEN),
        self_intersecting=bool(not flat and crosses_itself(polygon)),
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


def _point(ring: Ring) -> ClosedCurve:
    """The curve that stays in one place."""
    return ClosedCurve(
        control=np.repeat(ring.middle[None], LEAST_CONTROL, axis=0),
        knots=periodic_knots(LEAST_CONTROL),
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
