"""The shape operator of a parametric surface, by which that of graphs and of solids is checked."""

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch import ShapeOperator


def shape_operator(
    by_u: Floats, by_v: Floats, by_uu: Floats, by_uv: Floats, by_vv: Floats, outward: Floats
) -> ShapeOperator:
    """Shape operator of a parametric surface from its partial derivatives, (3,) each.

    `outward` (3,): any vector on the free side of the tangent plane. It is L^-1 II L^-T, where
    L L^T is the first form. L comes from the tangents by Gram-Schmidt, and not from E, F and G,
    which hold their squares.
    """
    a, c = np.linalg.norm(by_u), np.linalg.norm(by_v)
    along, rest = by_u / a, by_v / c
    normal = np.cross(along, rest)
    normal /= np.linalg.norm(normal)
    normal = normal if float(normal @ outward) >= 0.0 else -normal
    beside = np.cross(normal, along)
    beside = beside if float(beside @ rest) >= 0.0 else -beside
    b, d = float(rest @ along), float(beside @ rest)
    uu, uv, vv = (-float(normal @ v) for v in (by_uu / a / a, by_uv / a / c, by_vv / c / c))
    s12, s22 = (uv - b * uu) / d, (vv - 2.0 * b * uv + b * b * uu) / (d * d)
    return ShapeOperator(np.stack([along, beside]), normal, (uu, s12, s22))


def normal_curvature(shape: ShapeOperator, direction: Floats) -> float:
    """Curvature [1/m] along the tangential part of a direction (3,)."""
    u, v = shape.tangents @ direction / np.linalg.norm(shape.tangents @ direction)
    s11, s12, s22 = shape.parts
    return float(s11 * u * u + 2.0 * s12 * u * v + s22 * v * v)
