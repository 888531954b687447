"""Volume, area, centroid and inertia of what a surface encloses, from the surface alone.

By the divergence theorem an integral over the solid is one over its surface; that is taken by
Gauss's rule on cells of each piece, which are halved until the result stands still.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.surface.surface import Surface
from palpate.core.shapes.superquadric_measures import Moments

NODES = 4
"""Of Gauss's rule in a cell, each way."""
FIRST_ROWS, FIRST_COLUMNS = 4, 12
"""Cells of each piece to begin with."""
HALVINGS = 4
"""Most halvings of the cells."""
ENOUGH = 1e-8
"""Change of the volume and of the area, as a share, at which they stand still."""


class Measures(NamedTuple):
    """Of a solid of density 1, in the unit of its surface."""

    moments: Moments
    """Volume, centroid, and second moments from the frame's origin."""
    area: float
    error: float
    """By how much the last halving changed the volume or the area, the larger share: a bound
    in practice, for each halving takes away more than half of what is left."""

    def inertia(self) -> Floats:
        """Inertia (3, 3) about the centroid."""
        volume, centroid, second = self.moments
        about = second - volume * np.outer(centroid, centroid)
        return np.asarray(np.trace(about) * np.eye(3) - about)


def measure_surface(surface: Surface) -> Measures:
    """Volume, area, centroid and second moments.

    Notes
    -----
    Taken about the middle of the surface's box, so that a solid far from the origin keeps its
    digits; moved there afterwards.
    """
    sums = _sums(surface, 0)
    error = np.inf
    for level in range(1, HALVINGS + 1):
        finer = _sums(surface, level)
        error = float(np.max(np.abs(finer[:2] / sums[:2] - 1.0)))
        sums = finer
        if error <= ENOUGH:
            break
    volume, area = float(sums[0]), float(sums[1])
    offset = sums[2:5] / volume
    second = np.empty((3, 3))
    upper = np.triu_indices(3)
    second[upper] = sums[5:]
    second.T[upper] = sums[5:]
    middle, centroid = surface.middle, surface.middle + offset
    moved = np.outer(offset, middle)
    second = second + volume * (moved + moved.T + np.outer(middle, middle))
    return Measures(Moments(volume, centroid, second), area, error)


def _sums(surface: Surface, level: int) -> Floats:
    """Volume, area, three first and six second moments about the middle, (11,)."""
    turns, across = _nodes(0.0, 1.0, FIRST_COLUMNS << level)
    total = np.zeros(11)
    for piece, (low, high) in enumerate(zip(surface.seams[:-1], surface.seams[1:], strict=True)):
        v, along = _nodes(low, high, FIRST_ROWS << level)
        rows, columns = np.repeat(v, len(turns)), np.tile(turns, len(v))
        weights = np.repeat(along, len(turns)) * np.tile(across, len(v))
        x = surface.piece_at(piece, rows, columns) - surface.middle
        by_v = surface.piece_at(piece, rows, columns, (1, 0))
        by_t = surface.piece_at(piece, rows, columns, (0, 1))
        total += _flux(x, np.cross(by_t, by_v) * weights[:, None])
    return total


def _flux(x: Floats, n: Floats) -> Floats:
    """What fields whose divergences are 1, coordinates, and products of them send out."""
    i, j = np.triu_indices(3)
    # x_i x_j is the divergence of x_i^2 x_j e_i / 2, or of x_i^3 e_i / 3 where they are one.
    share = np.where(i == j, 1.0 / 3.0, 0.5)
    return np.concatenate(
        [
            [np.sum(x * n) / 3.0, np.linalg.norm(n, axis=1).sum()],
            np.sum(x * x * n, axis=0) / 2.0,
            share * np.sum(x[:, i] ** 2 * x[:, j] * n[:, i], axis=0),
        ]
    )


def _nodes(low: float, high: float, cells: int) -> tuple[Floats, Floats]:
    """Places and weights of Gauss's rule on equal cells."""
    place, weight = np.polynomial.legendre.leggauss(NODES)
    width = (high - low) / cells
    begin = low + width * np.arange(cells)
    places = begin[:, None] + 0.5 * width * (1.0 + place)
    return places.ravel(), np.tile(0.5 * width * weight, cells)
