"""The shape operator of a parametric surface, by which that of graphs and of solids is checked."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch.forms import ShapeOperator


def shape_operator(
    by_u: Floats, by_v: Floats, by_uu: Floats, by_uv: Floats, by_vv: Floats, outward: Floats
) -> ShapeOperator:
    """Shape operator of a parametric surface from its partial derivatives, (3,) each.

    `outward` (3,): any vector on the free side of the tangent plane. Raises ValueError if the
    tangents are parallel, or zero. It is L^-1 II L^-T, where L L^T is the first form. L comes from
    the tangents by Gram-Schmidt, and never from E, F and G, which hold their squares.
    """
    normal = outward_normal(by_u, by_v, outward)
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


def outward_normal(by_u: Floats, by_v: Floats, outward: Floats) -> Floats:
    """Unit normals of the tangents, on the side of `outward`."""
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
    """Length that neither overflows nor vanishes."""
    return math.hypot(*vector.tolist())
