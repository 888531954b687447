"""The closed curve through the points of one slice."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.plane.crossings import crosses_itself
from palpate.core.rebuild.slices.even_steps import same_steps, slice_parameters
from palpate.core.rebuild.slices.star_shaped import are_star_shaped
from palpate.core.splines.closed_curve import FLAT, ClosedCurve, CurveFlags, fit_closed_curve
from palpate.core.splines.curve_choice import UNEVEN, choose_fit
from palpate.core.splines.curve_fit import CurveFit, closed_places
from palpate.core.splines.curve_interpolation import closed_knots, interpolate_closed
from palpate.core.splines.curve_parameters import gap_ratio
from palpate.core.splines.curve_points import Ring, order_points

FINE = 512
"""Places along each curve at which it is compared with others."""
LEAST_POINTS = 3
EVEN_CONDITION = 3.0
"""Of the system for even steps: its eigenvalues lie between 1/3 and 1."""


class SliceCurve(NamedTuple):
    """A curve, and what it looks like."""

    curve: ClosedCurve
    """Through the points."""
    fine: Floats
    """(FINE, 2), at even steps of its turn."""
    star: bool
    """Each ray from the middle of its area meets it once."""


def slice_curve(points: Floats) -> SliceCurve:
    """Closed cubic through points (m, 2) around a contour, in any order and direction.

    It passes all points. Only where it would then meet itself, because points are nearer to
    each other than their noise, it is smoothed, if that helps.
    """
    ring = order_points(points)
    if len(ring.points) < LEAST_POINTS:
        curve = fit_closed_curve(points, parameters="even", smoothing=None)
        return SliceCurve(curve, np.repeat(ring.middle[None], FINE, axis=0), False)
    turns = slice_parameters(ring.points)
    through = _seen(ring, _through(ring.points, turns))
    if not through.curve.flags.self_intersecting:
        return through
    smooth = _seen(ring, choose_fit(ring.points, turns, None, "gcv", 0.0))
    return through if smooth.curve.flags.self_intersecting else smooth


def _through(points: Floats, turns: Floats) -> CurveFit:
    """The curve through all points; at even steps its system is solved by waves."""
    count = len(points)
    if not same_steps(turns):
        return interpolate_closed(points, turns)
    waves = np.fft.rfft(points, axis=0)
    gain = (2.0 + np.cos(2.0 * np.pi * np.arange(len(waves)) / count)) / 3.0
    control = np.fft.irfft(waves / gain[:, None], count, axis=0)
    return CurveFit(
        control=np.roll(control, 1, axis=0),
        knots=closed_knots(turns),
        parameters=turns,
        condition=EVEN_CONDITION,
        effective=float(count),
        smoothing=0.0,
    )


def _seen(ring: Ring, fit: CurveFit) -> SliceCurve:
    """The fit in the points' own place and scale, with what should be known of it."""
    spread = np.linalg.svd(ring.points - ring.points.mean(axis=0), compute_uv=False)
    flat = bool(spread[1] <= FLAT * spread[0])
    if fit.smoothing == 0.0 and same_steps(fit.parameters):
        fine = _even_matrix(len(ring.points)) @ fit.control
    else:
        fine = closed_places(fit.control, fit.knots, np.arange(FINE) / FINE)
    star = not flat and bool(are_star_shaped((fine - area_centroid(fine))[None])[0])
    residual = 0.0
    if fit.smoothing > 0.0:
        off = ring.points - closed_places(fit.control, fit.knots, fit.parameters)
        residual = float(np.sqrt((off**2).sum(axis=1).mean()))
    curve = ClosedCurve(
        control=ring.middle + ring.size * fit.control,
        knots=fit.knots,
        parameters=fit.parameters,
        used=ring.rows,
        dropped=ring.dropped,
        residual=ring.size * residual,
        sigma=ring.size * residual,
        condition=fit.condition,
        effective=fit.effective,
        smoothing=fit.smoothing,
        flags=CurveFlags(
            degenerate=flat,
            uneven=bool(gap_ratio(ring.points) > UNEVEN),
            self_intersecting=not flat and not star and crosses_itself(fine),
        ),
    )
    return SliceCurve(curve, ring.middle + ring.size * fine, star)


@lru_cache(maxsize=64)
def _even_matrix(count: int) -> Floats:
    """From the control points of even steps to the fine curve, (FINE, count)."""
    knots = closed_knots(np.arange(count) / count)
    matrix = closed_places(np.eye(count), knots, np.arange(FINE) / FINE)
    matrix.setflags(write=False)
    return matrix
