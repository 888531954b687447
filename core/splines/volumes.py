"""Several lattices side by side, of any shape: Coquillart's extended free-form deformation.

A point keeps the parameters that it has in the undeformed volume that holds it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.splines.frame import Frame
from palpate.core.splines.inversion import EPSILON
from palpate.core.splines.invert import invert
from palpate.core.splines.joints import SAME, Joint, shared_faces
from palpate.core.splines.lattice import Lattice

NOWHERE = -1
"""Number of the lattice of a point that lies in none."""


class Embedding(NamedTuple):
    """Where points lie."""

    lattice: Ints
    """Number of the lattice that holds each, (n,); `NOWHERE` for those that lie in none."""
    parameters: Floats
    """s, t, u in it, (n, 3); 0 for those that lie in none."""


class Moved(NamedTuple):
    """Points after a deformation."""

    points: Floats
    """(n, 3), m; those that lie in no lattice stay."""
    held: Bools
    """(n,): whether a lattice holds the point."""


@dataclass(frozen=True, slots=True, eq=False)
class Volumes:
    """Lattices that together deform one body.

    Parameters
    ----------
    lattices : tuple of lattices
        Each with its own undeformed volume; where two of those share a face, the deformed ones
        must share it too.

    Raises
    ------
    ValueError
        If a shared face is torn, or knots or weights differ on it.

    Notes
    -----
    Coquillart, *Extended free-form deformation*, 1990. Across a shared face the deformation is
    continuous; its slopes are where the control points next to the face are in line.
    """

    lattices: tuple[Lattice, ...]
    joints: tuple[Joint, ...] = field(init=False)
    """The faces that they share."""

    def __post_init__(self) -> None:
        joints = shared_faces(self.lattices)
        points = [one.control.reshape(-1, 3) for one in self.lattices]
        size = float(np.ptp(np.concatenate(points), axis=0).max()) if points else 0.0
        for joint in joints:
            if joint.gap > SAME * size:
                raise ValueError(
                    f"lattices {joint.first} and {joint.second} share a face that the "
                    f"deformation must not tear, got a gap of {joint.gap:g} m"
                )
        object.__setattr__(self, "joints", joints)

    def embed(self, points: Floats) -> Embedding:
        """Which lattice holds each point (n, 3), and with which parameters.

        A point on a shared face belongs to the first of its lattices.

        Raises
        ------
        ValueError
            If points are not finite (n, 3).
        """
        points = finite_array("points", points, (None, 3))
        found = np.full(len(points), NOWHERE, np.int32)
        parameters = np.zeros((len(points), 3))
        for number, lattice in enumerate(self.lattices):
            rows = np.flatnonzero((found == NOWHERE) & _may_hold(lattice, points))
            inside, local = _parameters(lattice, points[rows])
            found[rows[inside]], parameters[rows[inside]] = number, local[inside]
        return Embedding(found, parameters)

    def deform(self, points: Floats) -> Moved:
        """Where points (n, 3) go, and which of them a lattice holds.

        Raises
        ------
        ValueError
            If points are not finite (n, 3).
        """
        embedding = self.embed(points)
        moved = np.array(points, dtype=np.float64)
        for number, lattice in enumerate(self.lattices):
            rows = embedding.lattice == number
            if rows.any():
                moved[rows] = lattice.volume.at(embedding.parameters[rows])
        return Moved(moved, embedding.lattice != NOWHERE)


def _may_hold(lattice: Lattice, points: Floats) -> Bools:
    """Whether points lie in the box around a lattice's undeformed control points."""
    if isinstance(lattice.undeformed, Frame):
        corners = lattice.undeformed.points(np.array(np.meshgrid(*[[0.0, 1.0]] * 3)).T)
    else:
        corners = lattice.undeformed.control
    low, high = (end(corners.reshape(-1, 3), axis=0) for end in (np.min, np.max))
    rounding = SAME * (high - low).max() + 64 * EPSILON * np.abs(corners).max()
    near = (points >= low - rounding) & (points <= high + rounding)
    held: Bools = near.all(axis=1)
    return held


def _parameters(lattice: Lattice, points: Floats) -> tuple[Bools, Floats]:
    """Which points lie in a lattice, and their parameters (n, 3)."""
    if isinstance(lattice.undeformed, Frame):
        local = lattice.undeformed.local(points)
        clipped = np.clip(local, 0.0, 1.0)
        beyond = np.abs(local - clipped).max(axis=1, initial=0.0)
        return beyond <= lattice.undeformed.rounding(points), clipped
    found = invert(lattice.undeformed, points)
    return found.converged, found.parameters
