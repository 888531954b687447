"""Curvature of a tactile image as in Fung, 1999, section 3.5: B-spline surface, fundamental forms.

Kept for comparison. An interpolating spline turns every taxel's noise into curvature, and a median
filter before it makes plateaus that it then differentiates; the jet does neither.
(scipy.interpolate: no node imports this.)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from palpate.core.arrays import Floats
from palpate.core.touch import Pad, ShapeOperator, graph_shape_operator

CUBIC = 3


class SplinePatch(NamedTuple):
    """A bicubic surface over the pad."""

    surface: RectBivariateSpline  # Height over y and x, m
    smoothed: bool  # It does not pass through every taxel


def fit_spline(pad: Pad, height: Floats, noise: float = 0.0) -> SplinePatch:
    """Bicubic B-spline surface (3.23) of a whole frame.

    Every taxel of `height` (rows, cols), m, counts, touched or not. `noise`: of one taxel, m: the
    sum of squared misfits is let grow to what it explains. FITPACK gives up where the wanted misfit
    is far below what the frame holds; the surface then passes through every taxel, and says so.
    """
    x, y = (axis / pad.pitch for axis in pad.grid())
    scaled = height / pad.pitch
    misfit = height.size * (noise / pad.pitch) ** 2
    if misfit > 0.0:
        try:
            return SplinePatch(_surface(x, y, scaled, misfit), True)
        except ValueError:  # "the maximal number of iterations ... has been reached"
            pass
    return SplinePatch(_surface(x, y, scaled, 0.0), False)


def _surface(x: Floats, y: Floats, scaled: Floats, misfit: float) -> RectBivariateSpline:
    return RectBivariateSpline(y[:, 0], x[0], scaled, kx=CUBIC, ky=CUBIC, s=misfit)


def spline_shape(pad: Pad, spline: SplinePatch, x: float, y: float) -> ShapeOperator:
    """Shape operator at a place of the pad, m: derivatives (3.24), then the forms."""
    u, v = np.array([y / pad.pitch]), np.array([x / pad.pitch])

    def derivative(by_x: int, by_y: int) -> float:
        return float(spline.surface(u, v, dx=by_y, dy=by_x)[0, 0])

    seconds = tuple(derivative(*by) / pad.pitch for by in ((2, 0), (1, 1), (0, 2)))
    slopes = derivative(1, 0), derivative(0, 1)
    return graph_shape_operator(slopes, (seconds[0], seconds[1], seconds[2]))
