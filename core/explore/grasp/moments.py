"""Volume, centroid and principal axes of a closed mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints


class Body(NamedTuple):
    """A solid of density 1."""

    volume: float
    """m3."""
    centroid: Floats
    """(3,), m."""
    axes: Floats
    """Principal axes as columns, the longest last; a rotation."""
    spread: Floats
    """Variances of the volume along them, ascending, (3,), m2."""

    @property
    def sound(self) -> bool:
        """False for a surface that is turned inside out, or encloses nothing."""
        return self.volume > 0.0 and float(self.spread[0]) > 0.0


def body_of(vertices: Floats, faces: Ints) -> Body:
    """What a closed mesh bounds.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array
        Counter-clockwise seen from outside.

    Notes
    -----
    Sums over the tetrahedra between faces and a point: the integral of x x^T over one is its
    volume / 20 times the sum of x_i x_i^T over its corners and of their sum with itself.
    """
    start = vertices.mean(axis=0)
    corners = (vertices - start)[faces]
    a, b, c = corners.transpose(1, 0, 2)
    volumes = np.einsum("mi,mi->m", a, np.cross(b, c)) / 6.0
    volume = float(volumes.sum())
    total = corners.sum(axis=1)
    centroid = volumes @ total / (4.0 * volume)
    second = np.einsum("m,mki,mkj->ij", volumes, corners, corners)
    second += np.einsum("m,mi,mj->ij", volumes, total, total)
    covariance = second / (20.0 * volume) - np.outer(centroid, centroid)
    spread, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes = axes * [-1.0, 1.0, 1.0]
    return Body(volume, centroid + start, axes, spread)
