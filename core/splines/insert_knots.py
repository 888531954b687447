"""Knot insertion: more control points for the same spline."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.basis import Basis, clip_to_domain


def insert_knots(basis: Basis, control: Floats, new: Floats, axis: int = 0) -> tuple[Basis, Floats]:
    """The basis with further knots, and the coefficients that give the same spline on it.

    Parameters
    ----------
    basis : Basis
        Along the axis.
    control : array with `basis.count` entries along `axis`
        Coefficients.
    new : (k,) array
        Knots within the domain.
    axis : int
        Which axis of the coefficients the basis belongs to.

    Raises
    ------
    ValueError
        If a new knot lies outside the domain, or would occur more often than the degree allows;
        if there are not as many coefficients as the basis has functions, or one is not finite.

    Notes
    -----
    Boehm, *Inserting new knots into B-spline curves*, 1980: each new coefficient is a mean of
    two old ones.
    """
    degree = basis.degree
    control = np.moveaxis(finite_array("control", control, (None,) * np.ndim(control)), axis, 0)
    if len(control) != basis.count:
        raise ValueError(f"control must have {basis.count} coefficients, got {len(control)}")
    for knot in clip_to_domain(finite_array("new", new, (None,)), basis.domain):
        knots = basis.knots
        place = int(np.searchsorted(knots, knot, side="right"))
        basis = Basis(np.insert(knots, place, knot), degree)
        i = np.arange(basis.count)
        start, end = (
            knots[np.minimum(i, len(knots) - 1)],
            knots[np.minimum(i + degree, len(knots) - 1)],
        )
        with np.errstate(divide="ignore", invalid="ignore"):  # those are not taken
            share = (knot - start) / (end - start)
        share = np.where(i + degree < place, 1.0, np.where(i >= place, 0.0, share))
        share = share.reshape(-1, *(1,) * (control.ndim - 1))
        last = len(control) - 1
        control = (
            share * control[np.minimum(i, last)] + (1.0 - share) * control[np.maximum(i - 1, 0)]
        )
    return basis, np.moveaxis(control, 0, axis)
