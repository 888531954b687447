"""Whether a triangle mesh is closed, and which way its faces are turned."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints


def is_closed(faces: Ints) -> bool:
    """Whether each edge is walked once each way: no holes, and all faces turned alike.

    Parameters
    ----------
    faces : (m, 3) array
        Corners, by number. Corners that only lie in the same place are not the same.
    """
    begin = faces.ravel().astype(np.int64)
    end = faces[:, [1, 2, 0]].ravel().astype(np.int64)
    count = int(faces.max(initial=-1)) + 1
    there, back = np.sort(begin * count + end), np.sort(end * count + begin)
    return len(there) > 0 and bool((np.diff(there) > 0).all()) and np.array_equal(there, back)


def is_inside_out(vertices: Floats, faces: Ints) -> bool:
    """Whether the faces, seen from the mesh's middle, look inwards more than outwards.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array
        Corners, by number.
    """
    a, b, c = (vertices - vertices.mean(axis=0))[faces].transpose(1, 0, 2)
    return float(np.einsum("ni,ni->", a, np.cross(b, c))) < 0.0
