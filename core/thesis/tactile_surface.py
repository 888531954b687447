"""Curvature of a tactile image as in Fung, 1999, section 3.5: B-spline surface, fundamental forms.

Kept for comparison. An interpolating spline turns every taxel's noise into curvature, and a
median filter before it makes plateaus that it then differentiates; the jet does neither.
(scipy.interpolate: no node imports this.)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from palpate.core.arrays import Floats
from palpate.core.touch import Pad, ShapeOperator, graph_shape_operator, outward_normal

CUBIC = 3


class SplinePatch(NamedTuple):
    """A bicubic surface over the pad."""

    surface: RectBivariateSpline  # Height over y and x, m
    # False if it passes through every taxel: as asked, or because no smooth one was found.
    smoothed: bool


def fit_spline(pad: Pad, height: Floats, noise: float = 0.0) -> SplinePatch:
    """Bicubic B-spline surface (3.23) of a whole frame.

    `pad`: the array. `height` (rows, cols): surface over the plane of the pad's face, m; every
    taxel counts, touched or not. `noise`: standard deviation of one taxel, m: the sum of squared
    misfits is let grow to what noise explains. With 0 the surface passes through every taxel.

    FITPACK gives up where the wanted misfit is far below what the frame holds. The surface
    then passes through every taxel, and says so.
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
    return graph_shape_operator(
        (derivative(1, 0), derivative(0, 1)), (seconds[0], seconds[1], seconds[2])
    )


class FundamentalForms(NamedTuple):
    """Coefficients of both fundamental forms, (3.10) and (3.14), for given parameters u, v."""

    first: tuple[float, float, float]  # E, F, G: squared length of a step (du, dv)
    # L, M, N: twice how far that step leaves the tangent plane, inwards.
    second: tuple[float, float, float]


def fundamental_forms(
    by_u: Floats, by_v: Floats, by_uu: Floats, by_uv: Floats, by_vv: Floats, outward: Floats
) -> FundamentalForms:
    """Fundamental forms of a parametric surface from its derivatives, (3,) each.

    `by_u`, `by_v`, `by_uu`, `by_uv`, `by_vv` (3,): partial derivatives of the surface. `outward`
    (3,): any vector on the free side of the tangent plane: it says which way the normal goes.
    Raises ValueError if the tangents are parallel, or zero: the point is not regular.
    """
    normal = outward_normal(by_u, by_v, outward)
    second = tuple(-float(normal @ by) for by in (by_uu, by_uv, by_vv))
    first = (float(by_u @ by_u), float(by_u @ by_v), float(by_v @ by_v))
    return FundamentalForms(first, (second[0], second[1], second[2]))


def normal_curvature(forms: FundamentalForms, du: float, dv: float) -> float:
    """Curvature of the normal section along the step (du, dv), 1/m.

    (3.15), whose h = dv/du is infinite across the contour; a pair never is.

    Raises ValueError if the step is zero.
    """
    size = math.hypot(du, dv)
    if not size > 0.0:
        raise ValueError("(du, dv) must not be zero: a point has no curvature of its own")
    du, dv = du / size, dv / size
    (e, f, g), (ll, mm, nn) = forms
    return (ll * du * du + 2.0 * mm * du * dv + nn * dv * dv) / (
        e * du * du + 2.0 * f * du * dv + g * dv * dv
    )


def gaussian_curvature(forms: FundamentalForms) -> float:
    """Product of the principal curvatures, (3.21), 1/m^2."""
    (e, f, g), (ll, mm, nn) = forms
    return (ll * nn - mm * mm) / (e * g - f * f)


def mean_curvature(forms: FundamentalForms) -> float:
    """Mean of the principal curvatures, 1/m: (3.22) with the half that it lacks."""
    (e, f, g), (ll, mm, nn) = forms
    return 0.5 * (e * nn + g * ll - 2.0 * f * mm) / (e * g - f * f)
