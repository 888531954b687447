"""The shape operator of a surface, the curvatures that it holds, and their standard errors.

All are in orthonormal tangents: there the shape operator is a symmetric 2 by 2 matrix, the
principal curvatures are its eigenvalues, and neither umbilics nor walls along the viewing direction
lose digits. Outward normal, convex positive: this flips the sign of Fung, 1999, (3.14), by which a
convex surface has negative curvature but (3.1) needs it positive.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

# Covariance of S11, S12, S22 if curvature changes equally in all directions.
ISOTROPIC: Floats = np.diag([1.0, 0.5, 1.0])
ISOTROPIC.setflags(write=False)


class ShapeOperator(NamedTuple):
    """Rate of turn of the outward normal along the surface, in orthonormal tangents."""

    tangents: Floats  # two orthonormal tangents as rows, (2, 3)
    normal: Floats  # outward unit normal, (3,)
    parts: tuple[float, float, float]  # [1/m] entries S11, S12, S22


class PrincipalCurvatures(NamedTuple):
    """Principal curvatures and the direction of the larger one."""

    k1: float  # [1/m] the larger
    k2: float  # [1/m] the smaller
    direction: Floats  # unit tangent along which the curvature is k1, (3,)
    umbilic: bool  # whether both are equal but for rounding: any direction is principal


def graph_shape_operator(
    slopes: tuple[float, float], seconds: tuple[float, float, float]
) -> ShapeOperator:
    """Shape operator of z(x, y), with the object on the side of larger z.

    `seconds`: z_xx, z_xy, z_yy [1/m]. In the directions of steepest slope and of none, the first
    form is diagonal: Cholesky's factor is a division by the steepness, finite on a wall.
    """
    steepest, slope = steepest_direction(slopes)
    along_x, along_y = steepest
    w = math.hypot(1.0, slope)
    r, s, t = _turned(steepest, seconds)
    uphill = np.array([along_x / w, along_y / w, slope / w])
    level = np.array([-along_y, along_x, 0.0])
    normal = np.array([along_x * (slope / w), along_y * (slope / w), -1.0 / w])
    return ShapeOperator(np.stack([uphill, level]), normal, (r / w / w / w, s / w / w, t / w))


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


def principal_curvatures(shape: ShapeOperator, rtol: float = 1e-13) -> PrincipalCurvatures:
    """Principal curvatures and the direction of the larger one.

    `rtol`: curvatures that differ from their mean by this fraction of it, or less, are equal.
    """
    s11, s12, s22 = shape.parts
    mean, spread = 0.5 * (s11 + s22), math.hypot(0.5 * (s11 - s22), s12)
    turn = 0.5 * math.atan2(2.0 * s12, s11 - s22)
    direction = math.cos(turn) * shape.tangents[0] + math.sin(turn) * shape.tangents[1]
    umbilic = spread <= rtol * abs(mean)
    return PrincipalCurvatures(mean + spread, mean - spread, direction, umbilic)


def curvature_along(shape: ShapeOperator, direction: Floats) -> float:
    """Normal curvature [1/m] along the tangential part of a direction (3,); 0 without one."""
    step = tangent_components(shape, direction)
    if step is None:
        return 0.0
    u, v = step
    s11, s12, s22 = shape.parts
    return s11 * u * u + 2.0 * s12 * u * v + s22 * v * v


class GeometryErrors(NamedTuple):
    """Errors of normal and curvatures at one place: standard deviations."""

    normal: float  # [rad] of the normal's angle
    principal: tuple[float, float]  # [1/m] of k1 and k2
    across: float  # [1/m] of the normal curvature along a direction
    parts: Floats  # [1/m^2] covariance of the shape operator's S11, S12, S22, (3, 3)
    difference: float  # [1/m] of half of k1 - k2, if these were equal


def graph_errors(
    derivatives: Floats, factor: Floats, deviation: float, shape: ShapeOperator, direction: Floats
) -> GeometryErrors:
    """Errors of the result of `graph_shape_operator`.

    `derivatives` (5,): z_x, z_y, z_xx, z_xy, z_yy. `factor` (5, m): square root of their covariance
    for unit noise. `deviation`: noise of one taxel [m]. `direction` (3,): of the normal curvature.
    First order (delta method) for all but the principal curvatures where they are nearly equal:
    there their difference is the length of a vector that noise may turn, and the part of the noise
    across it counts by its second order, at most by its full size.
    """
    (c, s), p = steepest_direction((float(derivatives[0]), float(derivatives[1])))
    turned = _turn(c, s) @ factor
    jacobian = _parts_jacobian(p, shape.parts)
    root = deviation * (jacobian @ turned)
    parts = root @ root.T
    w = math.hypot(1.0, p)
    up, level = (deviation * math.sqrt(float(row @ row)) for row in turned[:2])
    along = deviation * (_curvature_gradient(shape, direction, w, jacobian) @ turned)
    first, second, difference = _principal_errors(shape, parts)
    return GeometryErrors(
        normal=math.hypot(up / w / w, level / w),
        principal=(first, second),
        across=math.sqrt(float(along @ along)),
        parts=parts,
        difference=difference,
    )


def steepest_direction(slopes: tuple[float, float]) -> tuple[tuple[float, float], float]:
    """Unit direction of the steepest slope in the x-y plane, and that slope."""
    slope = math.hypot(*slopes)
    if slope == 0.0:
        return (1.0, 0.0), 0.0
    return (slopes[0] / slope, slopes[1] / slope), slope


def _turn(c: float, s: float) -> Floats:
    """Matrix (5, 5) from derivatives to those along and across the direction (c, s)."""
    turn = np.zeros((5, 5))
    turn[:2, :2] = (c, s), (-s, c)
    turn[2:, 2:] = (
        (c * c, 2.0 * c * s, s * s),
        (-c * s, c * c - s * s, c * s),
        (s * s, -2.0 * c * s, c * c),
    )
    return turn


def _parts_jacobian(p: float, parts: tuple[float, float, float]) -> Floats:
    """Derivatives of S11, S12, S22 by the turned derivatives of the graph, (3, 5).

    ``parts`` are r / w^3, s / w^2 and t / w with w^2 = 1 + p^2.
    """
    w = math.hypot(1.0, p)
    share = p / w / w
    s11, s12, s22 = parts
    return np.array(
        [
            [-3.0 * share * s11, 0.0, 1.0 / w / w / w, 0.0, 0.0],
            [-2.0 * share * s12, -share * w * s11, 0.0, 1.0 / w / w, 0.0],
            [-share * s22, -2.0 * share * w * s12, 0.0, 0.0, 1.0 / w],
        ]
    )


def _curvature_gradient(
    shape: ShapeOperator, direction: Floats, w: float, jacobian: Floats
) -> Floats:
    """Derivatives of the curvature along a direction by the turned derivatives, (5,).

    The shape operator changes, and the direction's part in the leaning tangent plane does.
    """
    part = tangent_components(shape, direction)
    if part is None:
        return np.zeros(5)
    u, v = part
    s11, s12, s22 = shape.parts
    curvature = s11 * u * u + 2.0 * s12 * u * v + s22 * v * v
    gradient: Floats = np.array([u * u, 2.0 * u * v, v * v]) @ jacobian
    normal_part = float(direction @ shape.normal)
    tangent_part = math.sqrt(max(float(direction @ direction) - normal_part * normal_part, 0.0))
    if tangent_part > 0.0:
        lean = 2.0 * normal_part / tangent_part
        gradient[0] -= lean * (s11 * u + s12 * v - curvature * u) / w / w
        gradient[1] -= lean * (s12 * u + s22 * v - curvature * v) / w
    return gradient


def tangent_components(shape: ShapeOperator, direction: Floats) -> tuple[float, float] | None:
    """Unit components of a direction along the tangents; None if it has none."""
    u, v = (shape.tangents @ direction).tolist()
    size = math.hypot(u, v)
    # The rounding error of the normal itself is no direction.
    if size <= 4.0 * np.finfo(np.float64).eps * _length(direction):
        return None
    return u / size, v / size


def _length(vector: Floats) -> float:
    """Length of a vector (3,), without overflow."""
    return math.hypot(*vector.tolist())


def _principal_errors(shape: ShapeOperator, parts: Floats) -> tuple[float, float, float]:
    """Errors of k1 and k2, and that of half their difference at an umbilic."""
    s11, s12, s22 = shape.parts
    half, spread = 0.5 * (s11 - s22), math.hypot(0.5 * (s11 - s22), s12)
    c, s = (half / spread, s12 / spread) if spread > 0.0 else (1.0, 0.0)
    (v11, v12, v13), (_, v22, v23), (_, _, v33) = parts.tolist()
    of_mean = 0.25 * (v11 + v33) + 0.5 * v13
    of_half = 0.25 * (v11 + v33) - 0.5 * v13
    half_and_twist = 0.5 * (v12 - v23)
    ahead = c * c * of_half + 2.0 * c * s * half_and_twist + s * s * v22
    aside = s * s * of_half - 2.0 * c * s * half_and_twist + c * c * v22
    with_mean = c * 0.25 * (v11 - v33) + s * 0.5 * (v12 + v23)
    # Half the square of a small step aside over the spread; at most the whole step.
    bent = aside * min(1.0, 0.75 * aside / spread**2) if spread > 0.0 else aside
    first, second = of_mean + ahead + 2.0 * with_mean, of_mean + ahead - 2.0 * with_mean
    return (
        math.sqrt(max(first, 0.0) + bent),
        math.sqrt(max(second, 0.0) + bent),
        math.sqrt(0.5 * (of_half + v22)),
    )
