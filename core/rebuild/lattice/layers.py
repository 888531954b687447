"""Layers of a control lattice along the axis: those of a skin, carried over without loss.

The skin is a spline along its latitude with a closed curve for each coefficient. Its knots are
the lattice's; only the height, which is no spline in the latitude, is followed as closely as is
wished, with knots put in where it is not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.skin.contour_surface import ContourSurface
from palpate.core.splines.basis import Basis, clamped_basis
from palpate.core.splines.insert_knots import insert_knots
from palpate.core.splines.knots import CUBIC

ENOUGH = 1e-6
"""Of the height between the ends: how closely heights are followed."""
MOST_LAYERS = 400
STEPS = 4
"""Places between knots at which the height is compared."""
SAMPLES = 3
"""Places for each layer to which a given number of layers is fitted."""


class Layers(NamedTuple):
    """Layers of a skin, from its lowest to its highest."""

    basis: Basis
    """Along the axis, from 0 to 1; cubic."""
    curves: Floats
    """Coefficients of each layer's closed spline (l, k, 2) in the plane, m."""
    heights: Floats
    """Coefficients (l,) of the height, m."""
    pinned: tuple[bool, bool]
    """Whether the first and the last layer are points."""


def layers_of(surface: ContourSurface, count: int | None = None) -> Layers:
    """Layers of a skin.

    Parameters
    ----------
    surface : ContourSurface
        The skin.
    count : int, optional
        How many layers; as many as the skin has, and further ones for the height, if left out.

    Raises
    ------
    ValueError
        If the count is less than 4.
    """
    if count is not None and count <= CUBIC:
        raise ValueError(f"layers must be at least {CUBIC + 1}, got {count}")
    control = surface.control + surface.middle
    low, high = surface.along.domain
    own = Basis((surface.along.knots - low) / (high - low), surface.along.degree)
    pinned = _is_point(control[0], control), _is_point(control[-1], control)
    if count is None:
        basis, curves = _cubic(own, control)
        basis, curves = _for_heights(surface, basis, curves)
        heights = _interpolated(basis, _height(surface, basis.greville()))
    else:
        basis = clamped_basis(count)
        places = np.linspace(0.0, 1.0, SAMPLES * max(count, own.count))
        values = (own.matrix(places) @ control.reshape(own.count, -1)).reshape(len(places), -1)
        values = np.column_stack([values, _height(surface, places)])
        found = _fitted(basis, places, values)
        curves, heights = found[:, :-1].reshape(count, -1, 2), found[:, -1]
    return Layers(basis, curves, heights, pinned)


def _height(surface: ContourSurface, shares: Floats) -> Floats:
    low, high = surface.along.domain
    return surface.latitude.height(low + (high - low) * shares)


def _is_point(curve: Floats, control: Floats) -> bool:
    size = float(np.ptp(control, axis=(0, 1)).max())
    return float(np.ptp(curve, axis=0).max()) <= 1e-12 * size


def _cubic(basis: Basis, control: Floats) -> tuple[Basis, Floats]:
    """The same spline with cubic functions; lower degrees, of few contours, have no inner knots."""
    if basis.degree == CUBIC:
        return basis, control
    raised = clamped_basis(CUBIC + 1)
    values = basis.matrix(raised.greville()) @ control.reshape(basis.count, -1)
    return raised, _interpolated(raised, values).reshape(CUBIC + 1, -1, 2)


def _for_heights(surface: ContourSurface, basis: Basis, curves: Floats) -> tuple[Basis, Floats]:
    """With a knot in the middle of each interval in which the height is not yet followed."""
    extent = surface.latitude.high - surface.latitude.low
    while basis.count < MOST_LAYERS:
        heights = _interpolated(basis, _height(surface, basis.greville()))
        breaks = np.unique(basis.knots)
        shares = (np.arange(STEPS) + 0.5) / STEPS
        places = breaks[:-1, None] + np.diff(breaks)[:, None] * shares
        off = basis.matrix(places.ravel()) @ heights - _height(surface, places.ravel())
        wrong = np.abs(off).reshape(places.shape).max(axis=1) > ENOUGH * extent
        if not wrong.any():
            break
        new = 0.5 * (breaks[:-1] + breaks[1:])[wrong]
        basis, curves = insert_knots(basis, curves, new)
    return basis, curves


def _interpolated(basis: Basis, values: Floats) -> Floats:
    """Coefficients with values at the Greville abscissae."""
    matrix = basis.matrix(basis.greville()).toarray()
    found: Floats = np.linalg.solve(matrix, values)
    return found


def _fitted(basis: Basis, places: Floats, values: Floats) -> Floats:
    """Coefficients nearest to values (n, d), with the first and the last taken as they are."""
    matrix = basis.matrix(places).toarray()
    ends = matrix[:, [0, -1]] @ values[[0, -1]]
    inner = np.linalg.lstsq(matrix[:, 1:-1], values - ends, rcond=None)[0]
    return np.concatenate([values[:1], inner, values[-1:]])
