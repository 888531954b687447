"""What becomes of surfaces when space is deformed."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints

LEAST_STRETCH = 1e-9
"""Of the largest: where the deformation squeezes more than that, a normal is taken as if it
squeezed by that much."""


def deformed_normals(slopes: Floats, normals: Floats) -> Floats:
    """Unit normals (n, 3) after a deformation with derivatives (n, 3, 3).

    A normal follows the cofactors of the derivative, which need no inverse, with the sign of
    the determinant, so that what pointed outwards still does after a reflection. Where the
    derivative squeezes it to nothing, the limit of squeezing a little less is given.
    """
    size = np.abs(slopes).max(axis=(1, 2), keepdims=True)
    slopes = slopes / np.where(size > 0.0, size, 1.0)
    x, y, z = slopes.transpose(2, 0, 1)
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
    volume = np.einsum("ni,ni->n", cofactors[:, :, 0], x)
    turned = np.where(volume < 0.0, -1.0, 1.0)[:, None] * (cofactors @ normals[:, :, None])[:, :, 0]
    length = np.linalg.norm(turned, axis=1)
    lost = ~(length > LEAST_STRETCH * np.linalg.norm(normals, axis=1))
    if lost.any():
        turned[lost] = _squeezed(slopes[lost], normals[lost])
        length[lost] = np.linalg.norm(turned[lost], axis=1)
    unit: Floats = turned / length[:, None]
    return unit


def _squeezed(slopes: Floats, normals: Floats) -> Floats:
    left, stretch, right = np.linalg.svd(slopes)
    least = np.maximum(LEAST_STRETCH * stretch[:, :1], np.finfo(float).tiny)
    along = (right @ normals[:, :, None])[:, :, 0] * (least / np.maximum(stretch, least))
    squeezed: Floats = (left @ along[:, :, None])[:, :, 0]
    squeezed /= np.abs(squeezed).max(axis=1, keepdims=True)
    return squeezed


def same_winding(before: Floats, after: Floats, faces: Ints) -> Ints:
    """Triangles (m, 3) turned round if vertices (n, 3) were mirrored on the way.

    A closed surface that enclosed its volume counter-clockwise still does.
    """
    mirrored = _handedness(before, faces) * _handedness(after, faces) < 0.0
    return faces[:, ::-1] if mirrored else faces


def _handedness(vertices: Floats, faces: Ints) -> float:
    """1, or -1 where faces enclose their volume clockwise; 0 where they enclose none."""
    if not len(faces):
        return 0.0
    size = float(np.ptp(vertices, axis=0).max())
    near = (vertices - vertices.mean(axis=0)) / (size if size > 0.0 else 1.0)
    a, b, c = near[faces].transpose(1, 0, 2)
    return float(np.sign(np.einsum("ni,ni->", a, np.cross(b, c))))
