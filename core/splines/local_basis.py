"""The B-splines that do not vanish at a place, by the triangular scheme of Cox and de Boor.

Between two knots there are ``degree + 1`` of them. The scheme divides by no distance but those
of knots on either side of the place, so that nothing is 0/0 however often knots repeat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints


class Local(NamedTuple):
    """The functions that do not vanish at some places."""

    first: Ints
    """Number of the first of them, (m,)."""
    values: Floats
    """(derivatives + 1, m, degree + 1): values, first derivatives and so on."""

    def columns(self) -> Ints:
        """Numbers of all of them, (m, degree + 1)."""
        steps = np.arange(self.values.shape[2], dtype=np.int32)
        columns: Ints = self.first[:, None] + steps
        return columns


def local_basis(knots: Floats, degree: int, x: Floats, derivatives: int) -> Local:
    """Values and derivatives at places in the domain.

    Parameters
    ----------
    knots : (count + degree + 1,) array
        Knot vector.
    degree : int
        Degree.
    x : (m,) array
        Places within the domain. At a knot the limit from the right is taken, at the last one
        that from the left.
    derivatives : int
        Highest derivative; those above the degree are 0.

    Notes
    -----
    De Boor, *A practical guide to splines*, 1978, chapter X. The derivative of order d raises
    functions of ``degree - d`` by differences, one degree at a time: Fung, 1999, (3.25) with
    its indices put right; (3.27) divides by zero at the highest order.
    """
    count = len(knots) - degree - 1
    last = int(np.searchsorted(knots, knots[count], side="left")) - 1
    span = np.minimum(np.searchsorted(knots, x, side="right") - 1, last)
    values = np.zeros((derivatives + 1, degree + 1, len(x)))
    # Knots around each place: row r is the knot number span + 1 - degree + r.
    near = knots[span + np.arange(1 - degree, degree + 1)[:, None]]
    lower = np.ones((1, len(x)))
    for raised in range(degree + 1):
        if raised:
            lower = _raise_value(lower, near, degree, x)
        order = degree - raised
        if order <= derivatives:
            values[order] = _differentiate(lower, near, degree)
    return Local((span - degree).astype(np.int32), values.transpose(0, 2, 1))


def _raise_value(lower: Floats, near: Floats, degree: int, x: Floats) -> Floats:
    """Values (q + 1, m) of degree q from those (q, m) of one degree less."""
    q = len(lower)
    left, right = near[degree - q : degree], near[degree : degree + q]
    share = lower / (right - left)
    raised = np.zeros((q + 1, len(x)))
    raised[:q] = share * (right - x)
    raised[1:] += share * (x - left)
    return raised


def _differentiate(lower: Floats, near: Floats, degree: int) -> Floats:
    """Derivatives (degree + 1, m) from values of a lower degree: one order for each degree."""
    for q in range(len(lower), degree + 1):
        share = q * lower / (near[degree : degree + q] - near[degree - q : degree])
        raised = np.zeros((q + 1, share.shape[1]))
        raised[:q] = -share
        raised[1:] += share
        lower = raised
    return lower
