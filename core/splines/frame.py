"""The parallelepiped in which a lattice stands: a corner and three edges."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.basis import ROUNDING, Basis

FLAT = 1e-12
"""Volume over the product of the edges' lengths, below which a parallelepiped is flat."""

Bases = tuple[Basis, Basis, Basis]
"""Along s, t and u."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A corner and three edge vectors.

    Parameters
    ----------
    corner : (3,) array
        Where s = t = u = 0, m.
    edges : (3, 3) array
        A row for each of s, t and u: from the corner to where it is 1, m.

    Raises
    ------
    ValueError
        If an edge has no length, or the three lie in a plane.

    Notes
    -----
    Fung, 1999, (2.17) to (2.19), with the edges themselves: with unit vectors, as printed,
    the far end of an edge would be its length, not 1.
    """

    corner: Floats
    edges: Floats
    inverse: Floats = field(init=False, repr=False)
    """(3, 3), 1/m: what turns offsets from the corner into s, t and u."""

    def __post_init__(self) -> None:
        corner = finite_array("corner", self.corner, (3,)).copy()
        edges = finite_array("edges", self.edges, (3, 3)).copy()
        lengths = np.abs(edges).max(axis=1, keepdims=True)
        if not (lengths > 0.0).all():
            raise ValueError(f"edges must have a length, got {edges.tolist()} m")
        units = edges / lengths
        if not abs(np.linalg.det(units)) > FLAT:
            raise ValueError(f"edges must not lie in a plane, got {edges.tolist()} m")
        inverse = np.linalg.inv(units) / lengths.T
        for name, array in (("corner", corner), ("edges", edges), ("inverse", inverse)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def volume(self) -> float:
        """Of the parallelepiped, m^3; negative if its edges are left-handed."""
        return float(np.linalg.det(self.edges))

    def local(self, points: Floats) -> Floats:
        """s, t and u (n, 3) of points (n, 3): (2.18); the inside is between 0 and 1."""
        return _combine([points[..., axis] - self.corner[axis] for axis in range(3)], self.inverse)

    def points(self, local: Floats) -> Floats:
        """Points (..., 3) of s, t and u (..., 3): (2.17)."""
        offsets = _combine([local[..., axis] for axis in range(3)], self.edges)
        offsets += self.corner
        return offsets

    def rounding(self, points: Floats) -> float:
        """How far s, t and u of such points may be off by rounding alone."""
        size = max(float(np.abs(points).max(initial=0.0)), float(np.abs(self.corner).max()))
        return ROUNDING * (1.0 + size * float(np.abs(self.inverse).sum(axis=0).max()))

    def greville_control(self, bases: Bases) -> Floats:
        """Control points (l, m, n, 3) that deform nothing: at the Greville abscissae, m."""
        return self._grid([basis.greville() for basis in bases])

    def even_control(self, counts: tuple[int, int, int]) -> Floats:
        """Control points (l, m, n, 3) in even steps along each edge: (2.19), m.

        They deform nothing under Bernstein polynomials alone; under other bases the parameters
        of a point are to be found by inversion.

        Raises
        ------
        ValueError
            If there are fewer than two along an edge.
        """
        if min(counts) < 2:
            raise ValueError(f"counts must be at least 2 along each edge, got {counts}")
        return self._grid([np.linspace(0.0, 1.0, count) for count in counts])

    def _grid(self, places: list[Floats]) -> Floats:
        return self.points(np.stack(np.meshgrid(*places, indexing="ij"), axis=-1))


def upright_frame(low: Floats, extent: Floats) -> Frame:
    """Frame of an upright box: smallest coordinates (3,) and edge lengths (3,), m.

    Raises
    ------
    ValueError
        If a length is not positive.
    """
    extent = finite_array("extent", extent, (3,))
    if not (extent > 0.0).all():
        raise ValueError(f"extent must be positive, got {extent.tolist()} m")
    return Frame(finite_array("low", low, (3,)), np.diag(extent))


def _combine(columns: list[Floats], matrix: Floats) -> Floats:
    """Columns of three numbers times a matrix (3, 3), without the products by nothing."""
    result = np.zeros((*columns[0].shape, 3))
    for row, column in zip(matrix, columns, strict=True):
        for axis in np.flatnonzero(row):
            result[..., axis] += column * row[axis]
    return result
