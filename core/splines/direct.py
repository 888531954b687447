"""Direct manipulation: points are pulled to targets, and the control points follow.

Of all the changes of the control points that bring the points there, or as near as they can
come, the least one is taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.lattice import Lattice

NEGLIGIBLE = 1e-10
"""Of the largest singular value: what moves the points less is left out."""


class Pulled(NamedTuple):
    """A lattice after its points were pulled."""

    lattice: Lattice
    """With its control points moved."""
    residual: Floats
    """How far each point stays from its target, (n,), m: more than rounding where targets
    contradict each other, as for one point pulled two ways."""
    rank: int
    """Independent points: fewer than there are where some follow from others."""
    condition: float
    """Of those: largest over smallest singular value used; 1 without points."""


def pull_points(lattice: Lattice, points: Floats, targets: Floats) -> Pulled:
    """Move points of a lattice to targets by the least change of its control points.

    Parameters
    ----------
    lattice : Lattice
        With or without weights, which stay.
    points : (n, 3) array
        Points of the undeformed lattice, m.
    targets : (n, 3) array
        Where they shall be after the deformation, m.

    Raises
    ------
    ValueError
        If shapes differ, something is not finite, or points lie outside the lattice.

    Notes
    -----
    Hsu, Hughes and Kaufman, *Direct manipulation of free-form deformations*, 1992: the
    pseudo-inverse of the shares that control points have in points, by singular values.
    """
    points = finite_array("points", points, (None, 3))
    targets = finite_array("targets", targets, (len(points), 3))
    if not len(points):
        return Pulled(lattice, np.zeros(0), 0, 1.0)
    local = lattice.local(points)
    shares = lattice.volume.shares(local)
    touched = np.unique(shares.indices)
    left, values, right = np.linalg.svd(shares[:, touched].toarray(), full_matrices=False)
    rank = int(np.count_nonzero(values > NEGLIGIBLE * values[0]))
    offset = targets - lattice.volume.at(local)
    change = right[:rank].T @ ((left[:, :rank].T @ offset) / values[:rank, None])
    control = lattice.control.reshape(-1, 3).copy()
    control[touched] += change
    pulled = lattice.with_control(control.reshape(lattice.control.shape))
    residual = np.linalg.norm(pulled.volume.at(local) - targets, axis=1)
    return Pulled(pulled, residual, rank, float(values[0] / values[rank - 1]))
