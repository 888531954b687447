"""The solid that the thesis's way gives: a deformed lattice, and the model's surface in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.measure.solidity import solidity
from palpate.core.rebuild.surface.rings import close_rings
from palpate.core.shapes.protocol import Mesh
from palpate.core.splines.lattice import Lattice

LEAST_ROWS, LEAST_COLUMNS = 2, 3


class Triples(Protocol):
    """Parameters s, t, u all over the model's surface."""

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3)."""


class ThesisHealth(NamedTuple):
    """What should be known of a solid before it is used; one entry for each contour, upwards."""

    one_to_one: Bools
    """(m,): each ray from the contour's middle met it once. Always true of contours that are
    matched by number."""
    degenerate: Bools
    """(m,): the contour encloses nothing; of one that is matched by number: it is a point."""
    self_intersecting: Bools
    """(m,): the contour meets itself."""
    core_scales: Floats
    """(m,): sides of the layer's core over those of the box around its shell."""
    cores_moved: Bools
    """(m,): the core is not in the middle of that box."""
    cores_outside: Ints
    """(m,): control points of the core that lie outside their shell."""
    gaps: Floats
    """(m,): how far open the curve is that gave the shell, over its mean width."""


@dataclass(frozen=True, slots=True, eq=False)
class ThesisSolid:
    """A superquadric's surface, deformed by a control lattice.

    Its surface is given over eta, from 0 at the bottom to 1 at the top, and nu, from 0 to 1 once
    around.
    """

    lattice: Lattice
    """Over the box around the contours, m; a layer of control points for each contour."""
    parameters: Floats
    """s, t, u (m, n, 3) of the model's points that were matched with the contours': upwards,
    then around from azimuth -pi, the first again at the end."""
    triples: Triples
    """Parameters of the whole surface."""
    cap: float | None
    """How far beyond its first and last row the surface is closed by a point, m; None if it
    ends in points of its own."""
    order: Ints
    """(m,): which of the given contours each layer is."""
    health: ThesisHealth

    def surface(self, eta: Floats, nu: Floats) -> Floats:
        """Points of the surface on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3), m.

        Raises
        ------
        ValueError
            If a number is not finite or outside 0 to 1.
        """
        eta, nu = (_unit(name, places) for name, places in (("eta", eta), ("nu", nu)))
        triples = self.triples.at(eta, nu)
        return self.lattice.volume.at(triples.reshape(-1, 3)).reshape(triples.shape)

    def mesh(self, rows: int, columns: int) -> Mesh:
        """Closed mesh of so many rows and columns of points, with a point at either end.

        Raises
        ------
        ValueError
            If there are not at least 2 rows and 3 columns.

        Notes
        -----
        The triangles are turned round where the lattice mirrors. Where it folds, the mesh may
        meet itself.
        """
        if rows < LEAST_ROWS or columns < LEAST_COLUMNS:
            raise ValueError(
                f"a mesh must have at least {LEAST_ROWS} rows and {LEAST_COLUMNS} columns, "
                f"got {rows} and {columns}"
            )
        nu = np.arange(columns) / columns
        if self.cap is None:
            surface = self.surface(np.linspace(0.0, 1.0, rows + 2), nu)
            bottom, rings, top = surface[0, 0], surface[1:-1], surface[-1, 0]
        else:
            rings = self.surface(np.linspace(0.0, 1.0, rows), nu)
            beyond = np.array([0.0, 0.0, self.cap])
            bottom, top = rings[0].mean(axis=0) - beyond, rings[-1].mean(axis=0) + beyond
        vertices, faces = close_rings(bottom, rings, top)
        if solidity(vertices, faces).volume < 0.0:
            faces = faces[:, ::-1]
        return Mesh(vertices, faces)


def _unit(name: str, places: Floats) -> Floats:
    checked = finite_array(name, places, (None,))
    if len(checked) and not 0.0 <= checked.min() <= checked.max() <= 1.0:
        raise ValueError(
            f"{name} must lie between 0 and 1, got {checked.min():g} to {checked.max():g}"
        )
    return checked
