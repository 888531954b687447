"""Points spread evenly over a surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.measure.triangles import areas_and_normals


class Samples(NamedTuple):
    """Points on a surface."""

    points: Floats
    """(n, 3), m."""
    faces: NDArray[np.intp]
    """(n,): the face on which each lies, ascending."""


def sample_surface(corners: Floats, count: int, rng: np.random.Generator) -> Samples:
    """Points on triangles, uniform by area.

    Parameters
    ----------
    corners : (m, 3, 3) array
        Corners of the triangles, m.
    count : int
        Number of points.
    rng : Generator
        Source of the randomness.

    Raises
    ------
    ValueError
        If the triangles have no area.

    Notes
    -----
    Stratified: the faces are laid end to end by area, the line is cut into `count` equal
    pieces, and each piece gets one point. Every point of the surface is as likely as any
    other, so means stay unbiased, but their scatter is that of a much larger plain sample.
    Within a face: Osada et al., *Shape distributions*, 2002, (1).
    """
    line = np.cumsum(areas_and_normals(corners)[0])
    if not line[-1] > 0.0:
        raise ValueError("a surface must have an area to be sampled, got 0")
    places = (np.arange(count) + rng.random(count)) / count * line[-1]
    # To the right of all faces that end at or before the place: faces without area get none.
    faces = np.searchsorted(line, places, side="right")
    faces = np.minimum(faces, np.searchsorted(line, line[-1]))  # rounding of the last place
    root = np.sqrt(rng.random(count))[:, None]
    share = rng.random(count)[:, None]
    a, b, c = corners[faces, 0], corners[faces, 1], corners[faces, 2]
    return Samples(a + root * (b - a) + root * share * (c - b), faces)
