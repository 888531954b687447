"""Volume, area, centroid and second moments of what a closed surface encloses.

Integrals over the solid are integrals over its surface, by the divergence theorem. They are taken
by Gauss's rule on cells that are halved until the result is stable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.surface.closed import Surface
from palpate.core.shapes import MassMoments
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureSettings:
    """Cells of the integrals over a surface, and when halving them ends."""

    n_nodes: int = 4  # of Gauss's rule in a cell, each way
    first_rows: int = 4  # cells of each piece at the start, along
    first_columns: int = 12  # cells of each piece at the start, around
    max_halvings: int = 4
    tolerance: float = 1e-8  # relative change of volume and area by a halving


@readable
class SurfaceMeasures(NamedTuple):
    """Mass properties of a solid of density 1, in the unit of its surface."""

    moments: MassMoments  # volume, centroid, and second moments about the frame's origin
    area: float
    # Larger relative change of the volume or the area by the last halving: a bound in practice, for
    # each halving removes more than half of the error.
    error: float

    def inertia(self) -> Floats:
        """Inertia (3, 3) about the centroid."""
        volume, centroid, second = self.moments
        about = second - volume * np.outer(centroid, centroid)
        return np.asarray(np.trace(about) * np.eye(3) - about)


def measure_surface(
    surface: Surface, settings: MeasureSettings = MeasureSettings()
) -> SurfaceMeasures:
    """Volume, area, centroid and second moments, integrated about the middle of the box."""
    sums, error = _sums(surface, 0, settings), np.inf
    for level in range(1, settings.max_halvings + 1):
        finer = _sums(surface, level, settings)
        error = float(np.max(np.abs(finer[:2] / sums[:2] - 1.0)))
        sums = finer
        if error <= settings.tolerance:
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
    return SurfaceMeasures(MassMoments(volume, centroid, second), area, error)


def _sums(surface: Surface, level: int, settings: MeasureSettings) -> Floats:
    """Volume, area, three first and six second moments about the middle, (11,)."""
    turns, across = _nodes(0.0, 1.0, settings.first_columns << level, settings.n_nodes)
    total = np.zeros(11)
    for piece, (low, high) in enumerate(zip(surface.seams[:-1], surface.seams[1:], strict=True)):
        v, along = _nodes(low, high, settings.first_rows << level, settings.n_nodes)
        weights = (along[:, None] * across).reshape(-1, 1)
        x, by_v, by_t = (
            surface.piece_on_grid(piece, v, turns, by).reshape(-1, 3)
            for by in ((0, 0), (1, 0), (0, 1))
        )
        total += _flux(x - surface.middle, np.cross(by_t, by_v) * weights)
    return total


def _nodes(low: float, high: float, cells: int, n_nodes: int) -> tuple[Floats, Floats]:
    """Places and weights of Gauss's rule on equal cells."""
    place, weight = np.polynomial.legendre.leggauss(n_nodes)
    width = (high - low) / cells
    begin = low + width * np.arange(cells)
    places = begin[:, None] + 0.5 * width * (1.0 + place)
    return places.ravel(), np.tile(0.5 * width * weight, cells)


def _flux(x: Floats, n: Floats) -> Floats:
    """Flux of fields whose divergences are 1, the coordinates, and products of two of these."""
    i, j = np.triu_indices(3)
    # x_i x_j is the divergence of x_i^2 x_j e_i / 2, or of x_i^3 e_i / 3 if i = j.
    share = np.where(i == j, 1.0 / 3.0, 0.5)
    return np.concatenate(
        [
            [np.sum(x * n) / 3.0, np.linalg.norm(n, axis=1).sum()],
            np.sum(x * x * n, axis=0) / 2.0,
            share * np.sum(x[:, i] ** 2 * x[:, j] * n[:, i], axis=0),
        ]
    )
