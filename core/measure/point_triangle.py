"""The nearest point of a triangle to a point, for many pairs at once."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats

SLIVER = 1e-8
"""Height over length below which a triangle counts as its edges alone: it is off by no more
than this share of its length, which is what rounding would cost its inside."""


class Triangles(NamedTuple):
    """Triangles, with what every question about them needs."""

    corner: Floats
    """(m, 3): the first corner, m."""
    edges: Floats
    """(m, 2, 3): from the first corner to the second and to the third, m."""
    dual: Floats
    """(m, 2, 3): what gives the two coordinates along the edges, 1/m; 0 for a sliver."""

    @classmethod
    def of(cls, corners: Floats) -> Self:
        """From the corners (m, 3, 3)."""
        u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(u, v)
        square = np.einsum("ij,ij->i", normal, normal)
        longest = np.maximum(np.einsum("ij,ij->i", u, u), np.einsum("ij,ij->i", v, v))
        flat = square <= (SLIVER * longest) ** 2
        scale = np.where(flat, 0.0, 1.0 / np.where(flat, 1.0, square))[:, None]
        # Rows dual to u and v: p = s u + t v has s = p.(v x n)/n.n and t = p.(n x u)/n.n.
        dual = np.stack([np.cross(v, normal) * scale, np.cross(normal, u) * scale], axis=1)
        return cls(corners[:, 0].copy(), np.stack([u, v], axis=1), dual)


def nearest_on(triangles: Triangles, faces: NDArray[np.intp], points: Floats) -> Floats:
    """Nearest point of one triangle to each point.

    Parameters
    ----------
    triangles : Triangles
        The surface.
    faces : (n,) array
        The triangle that each point is asked about.
    points : (n, 3) array
        m.

    Returns
    -------
    (n, 3) array
        m.
    """
    start = triangles.corner[faces]
    edges = triangles.edges[faces]
    offset = points - start
    s, t = np.einsum("nij,nj->in", triangles.dual[faces], offset)
    # A sliver has s = t = 0 everywhere, which is no interior.
    inside = (s > 0.0) & (t > 0.0) & (s + t < 1.0)
    along = np.stack([s, t], axis=1)
    outside = np.flatnonzero(~inside)
    along[outside] = _along_edges(edges[outside], offset[outside])
    result: Floats = start + along[:, :1] * edges[:, 0] + along[:, 1:] * edges[:, 1]
    return result


def _along_edges(edges: Floats, offset: Floats) -> Floats:
    """Coordinates (n, 2) along u and v of the nearest point of the triangle's outline."""
    u, v = edges[:, 0], edges[:, 1]
    w = v - u
    on_u = _share(_dot(offset, u), _dot(u, u))
    on_v = _share(_dot(offset, v), _dot(v, v))
    on_w = _share(_dot(offset - u, w), _dot(w, w))
    # Distances from differences of points: from products they would be right to 1e-8 only.
    to_u = offset - on_u[:, None] * u
    to_v = offset - on_v[:, None] * v
    to_w = offset - u - on_w[:, None] * w
    best = np.stack([_dot(to_u, to_u), _dot(to_v, to_v), _dot(to_w, to_w)]).argmin(axis=0)
    s = np.choose(best, [on_u, 0.0, 1.0 - on_w])
    t = np.choose(best, [0.0, on_v, on_w])
    return np.stack([s, t], axis=1)


def _share(numerator: Floats, square: Floats) -> Floats:
    """Where along an edge, from 0 to 1; 0 on an edge without length."""
    long = square > 0.0
    return np.where(long, np.clip(numerator / np.where(long, square, 1.0), 0.0, 1.0), 0.0)


def _dot(one: Floats, other: Floats) -> Floats:
    result: Floats = np.einsum("ij,ij->i", one, other)
    return result
