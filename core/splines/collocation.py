"""Splines through given values: curves, surfaces and solids, one axis at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.basis import Basis


class Interpolant(NamedTuple):
    """A spline that takes given values."""

    control: Floats
    """Coefficients (count_1, ..., count_d, c), in the unit of the values."""
    condition: float
    """Condition number of the whole system: the product of those along the axes."""


def interpolable(basis: Basis, sites: Floats) -> bool:
    """Whether exactly one spline takes given values at given sites.

    Parameters
    ----------
    basis : Basis
        Basis.
    sites : (n,) array
        Parameters in its domain.

    Raises
    ------
    ValueError
        If a site lies outside the domain, or is not finite.

    Notes
    -----
    Schoenberg and Whitney, 1953: there are as many sites as functions, they increase, and each
    lies where its function does not vanish.
    """
    sites = finite_array("sites", sites, (None,))
    if len(sites) != basis.count or not (np.diff(sites) > 0.0).all():
        return False
    return bool((basis.matrix(sites).diagonal() > 0.0).all())


def interpolate(bases: Sequence[Basis], sites: Sequence[Floats], values: Floats) -> Interpolant:
    """The spline that takes given values on a grid.

    Parameters
    ----------
    bases : sequence of d bases
        One for each axis.
    sites : sequence of d arrays
        Parameters along each axis, as many as its basis has functions.
    values : (n_1, ..., n_d, c) array
        Values on the grid of sites.

    Raises
    ------
    ValueError
        If there are not sites for each basis, if the values do not fit them or are not finite,
        or if the sites of an axis determine no spline.
    """
    if len(sites) != len(bases):
        raise ValueError(f"sites must be given for {len(bases)} axes, got {len(sites)}")
    counts = tuple(len(places) for places in sites)
    control = finite_array("values", values, (*counts, None))
    condition = 1.0
    for axis, (basis, places) in enumerate(zip(bases, sites, strict=True)):
        if not interpolable(basis, places):
            raise ValueError(
                f"sites of axis {axis} must be {basis.count}, increase, and lie one by one where "
                f"the {basis.count} functions do not vanish, got {np.asarray(places).tolist()}"
            )
        matrix = basis.matrix(places).toarray()
        condition *= float(np.linalg.cond(matrix))
        along = np.moveaxis(control, axis, 0)
        solved = np.linalg.solve(matrix, along.reshape(len(places), -1)).reshape(along.shape)
        control = np.moveaxis(solved, 0, axis)
    return Interpolant(np.ascontiguousarray(control), condition)
