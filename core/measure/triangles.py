"""The triangles of a surface: their corners, areas and normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array


def corners_of(vertices: ArrayLike, faces: ArrayLike) -> Floats:
    """Corners of each face.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array of integers
        Rows of `vertices`.

    Returns
    -------
    (m, 3, 3) array
        Face, corner, coordinate.

    Raises
    ------
    ValueError
        If a vertex is not finite, there is no face, or a face names a vertex that is not there.
    """
    places = finite_array("vertices", vertices, (None, 3))
    return places[checked_faces(faces, len(places))]


def checked_faces(
    faces: ArrayLike, vertices: int
) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Faces (m, 3), all of whose corners are among this many vertices.

    Raises
    ------
    ValueError
        If there is no face, or a face names a vertex that is not there.
    """
    rows = np.asarray(faces)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows) or rows.dtype.kind not in "iu":
        raise ValueError(
            f"faces must be integers of shape (any, 3) with at least one row, "
            f"got {rows.dtype} of shape {rows.shape}"
        )
    low, high = int(rows.min()), int(rows.max())
    if low < 0 or high >= vertices:
        raise ValueError(
            f"faces must name vertices from 0 to {vertices - 1}, got {low if low < 0 else high}"
        )
    return rows.astype(np.intp)


def areas_and_normals(corners: Floats) -> tuple[Floats, Floats]:
    """Areas (m,) and unit normals (m, 3) of triangles; a triangle without area has normal 0."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.sqrt(np.einsum("ij,ij->i", cross, cross))
    return 0.5 * length, cross / np.where(length > 0.0, length, 1.0)[:, None]
