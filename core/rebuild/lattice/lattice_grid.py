"""A control lattice as plain arrays, for other tools."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.frame import Frame
from palpate.core.splines.lattice import Lattice


class LatticeGrid(NamedTuple):
    """Everything that a lattice is, as arrays."""

    control: Floats
    """Control points (l, m, n, 3) along s, t and u, in the unit of the contours."""
    undeformed: Floats
    """Where they were, (l, m, n, 3)."""
    weights: Floats
    """(l, m, n); all 1 without weights."""
    knots: tuple[Floats, Floats, Floats]
    """Along s, t and u."""
    degrees: tuple[int, int, int]
    """Along s, t and u."""


def lattice_grid(lattice: Lattice) -> LatticeGrid:
    """The arrays of a lattice."""
    bases, before = lattice.volume.bases, lattice.undeformed
    undeformed = before.greville_control(bases) if isinstance(before, Frame) else before.control
    weights = lattice.volume.weights
    s, t, u = bases
    return LatticeGrid(
        control=lattice.control,
        undeformed=undeformed,
        weights=np.ones(lattice.control.shape[:3]) if weights is None else weights,
        knots=(s.knots, t.knots, u.knots),
        degrees=(s.degree, t.degree, u.degree),
    )
