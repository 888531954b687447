"""Several lattices side by side, of any shape: Coquillart's extended free-form deformation.

A point keeps the parameters that it has in the undeformed volume that holds it. Faces that two
lattices share must be one face before and after the deformation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.splines.inversion import EPSILON, invert_points
from palpate.core.splines.lattices import Lattice
from palpate.core.splines.spline_volumes import Parallelepiped, SplineVolume

NOWHERE = -1  # Number of the lattice of a point that lies in none
SAME = 1e-9  # Of the size of all volumes: control points nearer than that are one


class Embedding(NamedTuple):
    """Where points lie."""

    lattice: Ints  # Number of the lattice that holds each, (n,); `NOWHERE` where none does
    parameters: Floats  # s, t, u in it, (n, 3); 0 for those that lie in none


class Moved(NamedTuple):
    """Points after a deformation."""

    points: Floats  # (n, 3), m; those that lie in no lattice stay
    held: Bools  # (n,): whether a lattice holds the point


@dataclass(frozen=True, slots=True, eq=False)
class CompositeLattice:
    """Lattices that together deform one body.

    `lattices`: each with its own undeformed volume; where two of those share a face, the deformed
    ones must share it too. Raises ValueError if a shared face is torn, or knots or weights differ
    on it. Coquillart, *Extended free-form deformation*, 1990. Across a shared face the deformation
    is continuous; its slopes are where the control points next to the face are in line.
    """

    lattices: tuple[Lattice, ...]
    joints: tuple[SharedFace, ...] = field(init=False)  # The faces that they share

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

        A point on a shared face belongs to the first of its lattices. Raises ValueError if points
        are not finite (n, 3).
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

        Raises ValueError if points are not finite (n, 3).
        """
        embedding = self.embed(points)
        moved = np.array(points, dtype=np.float64)
        for number, lattice in enumerate(self.lattices):
            rows = embedding.lattice == number
            if rows.any():
                moved[rows] = lattice.volume.at(embedding.parameters[rows])
        return Moved(moved, embedding.lattice != NOWHERE)


def shared_faces(lattices: Sequence[Lattice]) -> tuple[SharedFace, ...]:
    """Faces with the same undeformed control points; ValueError if knots or weights differ."""
    if not lattices:
        return ()
    everything = np.concatenate([_before(one).control.reshape(-1, 3) for one in lattices])
    same = SAME * float(np.ptp(everything, axis=0).max())
    faces = [face for number, one in enumerate(lattices) for face in _faces(number, one)]
    joints = []
    for first, second in combinations(faces, 2):
        for turned in _turnings(second):
            if first.before.shape != turned.before.shape:
                continue
            if np.abs(first.before - turned.before).max() <= same:
                _check_alike(first, turned)
                gap = float(np.linalg.norm(first.after - turned.after, axis=-1).max())
                joints.append(SharedFace(first.lattice, second.lattice, gap))
                break
    return tuple(joints)


def _faces(number: int, lattice: Lattice) -> Iterator[LatticeFace]:
    before, volume = _before(lattice), lattice.volume
    weights = np.ones(volume.control.shape[:3]) if volume.weights is None else volume.weights
    for axis in range(3):
        first, second = (basis.knots for other, basis in enumerate(volume.bases) if other != axis)
        for end in (0, -1):
            arrays = (before.control, volume.control, weights)
            old, new, weight = (np.asarray(np.take(array, end, axis)) for array in arrays)
            yield LatticeFace(number, old, new, weight, (first, second))


def _before(lattice: Lattice) -> SplineVolume:
    if isinstance(lattice.undeformed, Parallelepiped):
        bases = lattice.volume.bases
        return SplineVolume(lattice.undeformed.greville_control(bases), bases)
    return lattice.undeformed


def _turnings(face: LatticeFace) -> Iterator[LatticeFace]:
    """The same face with its directions swapped and turned round: eight ways."""
    before, after, weights = (part.swapaxes(0, 1) for part in face[1:4])
    swapped = LatticeFace(face.lattice, before, after, weights, face.knots[::-1])
    for turned, second, first in product((face, swapped), (1, -1), (1, -1)):
        rows, columns = slice(None, None, first), slice(None, None, second)
        along, across = (
            knots if step == 1 else 1.0 - knots[::-1]
            for knots, step in zip(turned.knots, (first, second), strict=True)
        )
        before, after, weights = (part[rows, columns] for part in turned[1:4])
        yield LatticeFace(face.lattice, before, after, weights, (along, across))


def _check_alike(first: LatticeFace, second: LatticeFace) -> None:
    names = f"lattices {first.lattice} and {second.lattice} share a face"
    for mine, yours in zip(first.knots, second.knots, strict=True):
        if mine.shape != yours.shape or not np.allclose(mine, yours, rtol=0.0, atol=SAME):
            raise ValueError(f"{names}, where their knots must be the same")
    ratio = first.weights / second.weights
    if not np.allclose(ratio, ratio[0, 0], rtol=SAME, atol=0.0):
        raise ValueError(f"{names}, where their weights must be in proportion")


def _may_hold(lattice: Lattice, points: Floats) -> Bools:
    """Whether points lie in the box around a lattice's undeformed control points."""
    if isinstance(lattice.undeformed, Parallelepiped):
        corners = lattice.undeformed.points(np.array(np.meshgrid(*[[0.0, 1.0]] * 3)).T)
    else:
        corners = lattice.undeformed.control
    low, high = (end(corners.reshape(-1, 3), axis=0) for end in (np.min, np.max))
    rounding = SAME * (high - low).max() + 64 * EPSILON * np.abs(corners).max()
    near = (points >= low - rounding) & (points <= high + rounding)
    return np.asarray(near.all(axis=1))


def _parameters(lattice: Lattice, points: Floats) -> tuple[Bools, Floats]:
    """Which points lie in a lattice, and their parameters (n, 3)."""
    if isinstance(lattice.undeformed, Parallelepiped):
        local = lattice.undeformed.local(points)
        clipped = np.clip(local, 0.0, 1.0)
        beyond = np.abs(local - clipped).max(axis=1, initial=0.0)
        return beyond <= lattice.undeformed.rounding(points), clipped
    found = invert_points(lattice.undeformed, points)
    return found.converged, found.parameters


class LatticeFace(NamedTuple):
    """One side of a lattice."""

    lattice: int  # Number of the lattice
    before: Floats  # Undeformed control points, (p, q, 3), m
    after: Floats  # Deformed ones
    weights: Floats  # (p, q)
    knots: tuple[Floats, Floats]  # Along both directions


class SharedFace(NamedTuple):
    """A face that two lattices share, or one lattice with itself."""

    first: int  # Number of a lattice
    second: int  # Number of the other
    gap: float  # Largest distance of its deformed control points, m
