"""The fundamental forms of a surface, and the curvatures that they hold.

Everything is told in orthonormal tangents: there the shape operator is a symmetric 2 by 2
matrix, the principal curvatures are its eigenvalues, and neither umbilics nor walls that stand
along the viewing direction lose digits. Outward normal, convex positive: this flips the sign of
Fung, 1999, (3.14), by which a convex surface has negative curvature but (3.1) needs it positive.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

UMBILIC = 1e-13
"""Principal curvatures that differ by less than this share of their size are equal: rounding."""


class Forms(NamedTuple):
    """Coefficients of both fundamental forms, (3.10) and (3.14), for given parameters u, v."""

    first: tuple[float, float, float]
    """E, F, G: squared length of a step (du, dv)."""
    second: tuple[float, float, float]
    """L, M, N: twice how far that step leaves the tangent plane, inwards."""


class ShapeOperator(NamedTuple):
    """How the outward normal turns along the surface, in orthonormal tangents."""

    tangents: Floats
    """Two orthonormal tangents as rows, (2, 3)."""
    normal: Floats
    """Outward unit normal, (3,)."""
    parts: tuple[float, float, float]
    """Entries S11, S12, S22, 1/m."""


class Principal(NamedTuple):
    """Principal curvatures and where they point."""

    k1: float
    """The larger, 1/m."""
    k2: float
    """The smaller, 1/m."""
    direction: Floats
    """Unit tangent along which the curvature is k1, (3,)."""
    umbilic: bool
    """Equal to rounding: any direction would do."""


def forms_of(
    by_u: Floats, by_v: Floats, by_uu: Floats, by_uv: Floats, by_vv: Floats, outward: Floats
) -> Forms:
    """Fundamental forms of a parametric surface from its derivatives, (3,) each.

    Parameters
    ----------
    by_u, by_v, by_uu, by_uv, by_vv : (3,) arrays
        Partial derivatives of the surface.
    outward : (3,) array
        Any vector on the free side of the tangent plane: it says which way the normal goes.

    Raises
    ------
    ValueError
        If the tangents are parallel, or zero: the point is not regular.
    """
    normal = _normal(by_u, by_v, outward)
    second = tuple(-float(normal @ by) for by in (by_uu, by_uv, by_vv))
    first = (float(by_u @ by_u), float(by_u @ by_v), float(by_v @ by_v))
    return Forms(first, (second[0], second[1], second[2]))


def normal_curvature(forms: Forms, du: float, dv: float) -> float:
    """Curvature of the normal section along the step (du, dv), 1/m.

    (3.15), whose h = dv/du is infinite across the contour; a pair never is.

    Raises
    ------
    ValueError
        If the step is zero.
    """
    size = math.hypot(du, dv)
    if not size > 0.0:
        raise ValueError("(du, dv) must not be zero: a point has no curvature of its own")
    du, dv = du / size, dv / size
    (e, f, g), (ll, mm, nn) = forms
    return (ll * du * du + 2.0 * mm * du * dv + nn * dv * dv) / (
        e * du * du + 2.0 * f * du * dv + g * dv * dv
    )


def gaussian_curvature(forms: Forms) -> float:
    """Product of the principal curvatures, (3.21), 1/m^2."""
    (e, f, g), (ll, mm, nn) = forms
    return (ll * nn - mm * mm) / (e * g - f * f)


def mean_curvature(forms: Forms) -> float:
    """Mean of the principal curvatures, 1/m: (3.22) with the half that it lacks."""
    (e, f, g), (ll, mm, nn) = forms
    return 0.5 * (e * nn + g * ll - 2.0 * f * mm) / (e * g - f * f)


def shape_operator(
    by_u: Floats, by_v: Floats, by_uu: Floats, by_uv: Floats, by_vv: Floats, outward: Floats
) -> ShapeOperator:
    """Shape operator of a parametric surface; arguments and errors as for `forms_of`.

    Notes
    -----
    It is L^-1 II L^-T, where L L^T is the first form. L comes from the tangents by
    Gram-Schmidt, and never from E, F and G, which hold their squares.
    """
    normal = _normal(by_u, by_v, outward)
    a = _length(by_u)
    along = by_u / a
    rest = by_v / (c := _length(by_v))
    b = float(rest @ along)
    beside = np.cross(normal, along)
    if float(beside @ rest) < 0.0:
        beside = -beside
    d = float(beside @ rest)
    uu = -float(normal @ (by_uu / a / a))
    uv = -float(normal @ (by_uv / a / c))
    vv = -float(normal @ (by_vv / c / c))
    s12 = (uv - b * uu) / d
    s22 = (vv - 2.0 * b * uv + b * b * uu) / (d * d)
    return ShapeOperator(np.stack([along, beside]), normal, (uu, s12, s22))


def graph_shape(slopes: tuple[float, float], seconds: tuple[float, float, float]) -> ShapeOperator:
    """Shape operator of z(x, y), with the object on the side of larger z.

    Parameters
    ----------
    slopes : (2,) floats
        z_x, z_y.
    seconds : (3,) floats
        z_xx, z_xy, z_yy, 1/m.

    Notes
    -----
    In the directions of steepest slope and of none, the first form is diagonal: what is left
    of the Cholesky factor is a division by the steepness, w, which is finite on a wall.
    """
    steepest, slope = steepest_way(slopes)
    along_x, along_y = steepest
    w = math.hypot(1.0, slope)
    r, s, t = _turned(steepest, seconds)
    uphill = np.array([along_x / w, along_y / w, slope / w])
    level = np.array([-along_y, along_x, 0.0])
    normal = np.array([along_x * (slope / w), along_y * (slope / w), -1.0 / w])
    return ShapeOperator(np.stack([uphill, level]), normal, (r / w / w / w, s / w / w, t / w))


def principal(shape: ShapeOperator) -> Principal:
    """Principal curvatures and the direction of the larger one."""
    s11, s12, s22 = shape.parts
    mean, spread = 0.5 * (s11 + s22), math.hypot(0.5 * (s11 - s22), s12)
    turn = 0.5 * math.atan2(2.0 * s12, s11 - s22)
    direction = math.cos(turn) * shape.tangents[0] + math.sin(turn) * shape.tangents[1]
    umbilic = spread <= UMBILIC * abs(mean)
    return Principal(mean + spread, mean - spread, direction, umbilic)


def curvature_along(shape: ShapeOperator, direction: Floats) -> float:
    """Normal curvature along a direction (3,), by its part in the tangent plane; 1/m.

    0 for a direction without such a part.
    """
    step = tangent_part(shape, direction)
    if step is None:
        return 0.0
    u, v = step
    s11, s12, s22 = shape.parts
    return s11 * u * u + 2.0 * s12 * u * v + s22 * v * v


def angle_between(one: Floats, other: Floats) -> float:
    """Angle between two vectors (3,), rad; by atan2, so that 1e-9 is not rounded to nothing."""
    return math.atan2(_length(np.cross(one, other)), float(one @ other))


def steepest_way(slopes: tuple[float, float]) -> tuple[tuple[float, float], float]:
    """Unit direction of the steepest slope in the x-y plane, and that slope."""
    slope = math.hypot(*slopes)
    if slope == 0.0:
        return (1.0, 0.0), 0.0
    return (slopes[0] / slope, slopes[1] / slope), slope


def tangent_part(shape: ShapeOperator, direction: Floats) -> tuple[float, float] | None:
    """Unit components of a direction along the tangents; None if it has none."""
    u, v = (shape.tangents @ direction).tolist()
    size = math.hypot(u, v)
    # What rounding leaves of the normal itself is no direction.
    if size <= 4.0 * np.finfo(np.float64).eps * _length(direction):
        return None
    return u / size, v / size


def _normal(by_u: Floats, by_v: Floats, outward: Floats) -> Floats:
    sizes = _length(by_u), _length(by_v)
    if not (min(sizes) > 0.0 and math.isfinite(max(sizes))):
        raise ValueError(f"both tangents must be finite and not zero, got lengths {sizes}")
    across = np.cross(by_u / sizes[0], by_v / sizes[1])
    sine = _length(across)
    if not sine > np.finfo(np.float64).eps:
        raise ValueError("the tangents are parallel: the surface has no normal there")
    normal: Floats = across / sine
    return normal if float(normal @ outward) >= 0.0 else -normal


def _length(vector: Floats) -> float:
    """Length of a vector (3,), without overflow."""
    return math.hypot(*vector.tolist())


def _turned(
    steepest: tuple[float, float], seconds: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Second derivatives along and across the steepest slope."""
    (c, s), (xx, xy, yy) = steepest, seconds
    return (
        c * c * xx + 2.0 * c * s * xy + s * s * yy,
        c * s * (yy - xx) + (c * c - s * s) * xy,
        s * s * xx - 2.0 * c * s * xy + c * c * yy,
    )
