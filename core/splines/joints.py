"""Faces that two volumes share: whether they are one face before and after a deformation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.frame import Frame
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume

SAME = 1e-9
"""Of the size of all volumes: control points nearer than that are one."""


class Face(NamedTuple):
    """One side of a lattice."""

    lattice: int
    """Number of the lattice."""
    before: Floats
    """Undeformed control points, (p, q, 3), m."""
    after: Floats
    """Deformed ones."""
    weights: Floats
    """(p, q)."""
    knots: tuple[Floats, Floats]
    """Along both directions."""


class Joint(NamedTuple):
    """A face that two lattices share, or one lattice with itself."""

    first: int
    """Number of a lattice."""
    second: int
    """Number of the other."""
    gap: float
    """Largest distance of its deformed control points, m."""


def shared_faces(lattices: Sequence[Lattice]) -> tuple[Joint, ...]:
    """Faces whose undeformed control points are the same, in whichever direction they run.

    Raises
    ------
    ValueError
        If knots or weights differ on such a face: then it is not one surface.
    """
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
                joints.append(Joint(first.lattice, second.lattice, gap))
                break
    return tuple(joints)


def _before(lattice: Lattice) -> Volume:
    if isinstance(lattice.undeformed, Frame):
        bases = lattice.volume.bases
        return Volume(lattice.undeformed.greville_control(bases), bases)
    return lattice.undeformed


def _faces(number: int, lattice: Lattice) -> Iterator[Face]:
    before, volume = _before(lattice), lattice.volume
    weights = np.ones(volume.control.shape[:3]) if volume.weights is None else volume.weights
    for axis in range(3):
        first, second = (basis.knots for other, basis in enumerate(volume.bases) if other != axis)
        for end in (0, -1):
            yield Face(
                number,
                np.asarray(np.take(before.control, end, axis)),
                np.asarray(np.take(volume.control, end, axis)),
                np.asarray(np.take(weights, end, axis)),
                (first, second),
            )


def _turnings(face: Face) -> Iterator[Face]:
    """The same face with its directions swapped and turned round: eight ways."""
    for swapped in (False, True):
        turned = face
        if swapped:
            turned = Face(
                face.lattice,
                face.before.swapaxes(0, 1),
                face.after.swapaxes(0, 1),
                face.weights.T,
                face.knots[::-1],
            )
        for way in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
            rows, columns = (slice(None, None, step) for step in way)
            first, second = (
                knots if step == 1 else 1.0 - knots[::-1]
                for knots, step in zip(turned.knots, way, strict=True)
            )
            yield Face(
                face.lattice,
                turned.before[rows, columns],
                turned.after[rows, columns],
                turned.weights[rows, columns],
                (first, second),
            )


def _check_alike(first: Face, second: Face) -> None:
    names = f"lattices {first.lattice} and {second.lattice} share a face"
    for mine, yours in zip(first.knots, second.knots, strict=True):
        if mine.shape != yours.shape or not np.allclose(mine, yours, rtol=0.0, atol=SAME):
            raise ValueError(f"{names}, where their knots must be the same")
    ratio = first.weights / second.weights
    if not np.allclose(ratio, ratio[0, 0], rtol=SAME, atol=0.0):
        raise ValueError(f"{names}, where their weights must be in proportion")
