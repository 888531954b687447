"""Large triangles cut up, so that the box about each piece lies close to it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.measure.triangles import areas_and_normals

EXTRA_PIECES = 50_000
"""Pieces that may be cut beyond twice the number of faces."""
COMPACT = 2.0
"""Longest edge over the root of the mean area, at which a piece is left whole: 1.5 for
equilateral triangles."""
NEXT_LIMIT = 0.7
"""Each round cuts what is longer than this share of the round before."""


def cut(corners: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Cut triangles across their longest edges until all are short, or there are too many.

    Parameters
    ----------
    corners : (m, 3, 3) array
        Corners of the triangles, m.

    Returns
    -------
    pieces : (p, 3, 3) array
        Corners of the pieces, m; together they are the same surface.
    faces : (p,) array
        The triangle that each was cut from.
    """
    pieces, faces = corners, np.arange(len(corners))
    most = 2 * len(corners) + EXTRA_PIECES
    area = float(areas_and_normals(corners)[0].sum())
    length = _longest(pieces)[0]
    limit = float(length.max())
    while limit > COMPACT * math.sqrt(area / len(pieces)):
        long = length > limit
        if len(pieces) + np.count_nonzero(long) > most:
            break
        if long.any():
            pieces = np.concatenate([pieces[~long], _halves(pieces[long])])
            faces = np.concatenate([faces[~long], np.tile(faces[long], 2)])
            length = _longest(pieces)[0]
        else:
            limit *= NEXT_LIMIT
    return pieces, faces


def _longest(corners: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Length (m,) of each triangle's longest edge, and the corner (m,) at which it begins."""
    edges = np.roll(corners, -1, axis=1) - corners
    square = np.einsum("ijk,ijk->ij", edges, edges)
    return np.sqrt(square.max(axis=1)), square.argmax(axis=1)


def _halves(corners: Floats) -> Floats:
    """Both halves of triangles (m, 3, 3), cut from the longest edge to the corner opposite."""
    order = (_longest(corners)[1][:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
