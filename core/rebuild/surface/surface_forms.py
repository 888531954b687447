"""Normals and principal curvatures of a parametric surface, at many points at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats


class Curvatures(NamedTuple):
    """Of a surface at points; convex positive."""

    normals: Floats
    """Outward unit normals, (n, 3)."""
    k1: Floats
    """Larger principal curvature, (n,), one over the surface's unit."""
    k2: Floats
    """Smaller one, (n,)."""
    directions: Floats
    """Unit tangents along which the curvature is k1, (n, 3)."""


def curvatures_of(
    by_v: Floats, by_t: Floats, by_vv: Floats, by_vt: Floats, by_tt: Floats
) -> Curvatures:
    """From the derivatives of a surface, (n, 3) each.

    Parameters
    ----------
    by_v, by_t, by_vv, by_vt, by_tt : (n, 3) arrays
        By v upwards and by t counter-clockwise; by_t and by_v neither parallel nor zero.

    Notes
    -----
    As `palpate.core.touch.forms.shape_operator` does it for one point: both forms in
    orthonormal tangents, by Gram-Schmidt, never from the squares E, F and G.
    """
    a = np.linalg.norm(by_v, axis=1)
    along = by_v / a[:, None]
    normals = unit_normals(by_v, by_t)
    beside = np.cross(along, normals)
    c = np.linalg.norm(by_t, axis=1)
    rest = by_t / c[:, None]
    b, d = _dot(rest, along), _dot(rest, beside)
    uu, uv, vv = (
        -_dot(normals, by_vv) / a**2,
        -_dot(normals, by_vt) / (a * c),
        -_dot(normals, by_tt) / c**2,
    )
    s12 = (uv - b * uu) / d
    s22 = (vv - 2.0 * b * uv + b * b * uu) / d**2
    mean, spread = 0.5 * (uu + s22), np.hypot(0.5 * (uu - s22), s12)
    turn = 0.5 * np.arctan2(2.0 * s12, uu - s22)[:, None]
    directions = np.cos(turn) * along + np.sin(turn) * beside
    return Curvatures(normals, mean + spread, mean - spread, directions)


def unit_normals(by_v: Floats, by_t: Floats) -> Floats:
    """Outward unit normals (n, 3) from tangents upwards and counter-clockwise.

    0 where the tangents are parallel or zero.
    """
    lengths = [np.linalg.norm(by, axis=1, keepdims=True) for by in (by_t, by_v)]
    one, other = (
        by / np.where(length > 0.0, length, 1.0)
        for by, length in zip((by_t, by_v), lengths, strict=True)
    )
    across = np.cross(one, other)
    sine = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(across / np.where(sine > 0.0, sine, 1.0))


def _dot(one: Floats, other: Floats) -> Floats:
    result: Floats = np.einsum("ni,ni->n", one, other)
    return result
