"""The closed surface whose side a control lattice makes, and what further points make of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import finite_array, positive
from palpate.core.rebuild.contour_solid import ContourSolid
from palpate.core.rebuild.lattice.lattice_fit import LatticeFit, fit_lattice
from palpate.core.rebuild.lattice.lattice_side import LatticeSide
from palpate.core.rebuild.lattice.refine import refine_lattice
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.surface.surface import Surface, close_surface
from palpate.core.rebuild.surface.surface_nearest import search_surface

MISFIT = 0.1
"""Of the skin's own uncertainty: what a lattice may leave it by."""


def lattice_of(
    closed: ContourSolid, size: tuple[int, int] | None = None, grasp: Recovery | None = None
) -> tuple[Surface, LatticeFit]:
    """The closed surface of a control lattice for a skin, with the skin's own ends.

    Parameters
    ----------
    closed : ContourSolid
        Skin and ends.
    size, grasp
        As for `fit_lattice`.
    """
    tolerance = MISFIT * closed.uncertainty().rms
    fit = fit_lattice(closed.skin.surface, tolerance, size=size, grasp=grasp)
    return _closed(fit, closed), fit


def refine_solid(
    fit: LatticeFit,
    closed: ContourSolid,
    points: ArrayLike,
    *,
    sigma: float | None = None,
    weights: bool = False,
) -> tuple[Surface, LatticeFit]:
    """Change a lattice so that the side of its closed surface passes points (n, 3), m.

    Raises
    ------
    ValueError
        If a point is not finite, or the standard deviation `sigma` is not positive.
    """
    points = finite_array("points", points, (None, 3))
    surface = _closed(fit, closed)
    if sigma is not None:
        positive("sigma", sigma, "m")
    foot = search_surface(surface).nearest(points)
    number = next(i for i, piece in enumerate(surface.pieces) if isinstance(piece, LatticeSide))
    low, high = surface.seams[number : number + 2]
    on_side = (foot.v >= low) & (foot.v <= high)
    places = np.column_stack([(foot.v - low) / (high - low), foot.turns])[on_side]
    found = refine_lattice(
        fit,
        points[on_side],
        np.clip(places, 0.0, 1.0),
        sigma=None if sigma is None else np.full(int(on_side.sum()), sigma),
        weights=weights,
    )
    assert found.refinement is not None
    beyond = int(np.count_nonzero(~on_side))
    found = replace(found, refinement=found.refinement._replace(beyond=beyond))
    return _closed(found, closed), found


def _closed(fit: LatticeFit, closed: ContourSolid) -> Surface:
    below, above = (None if end.round else end for end in (closed.bottom, closed.top))
    return close_surface(fit.side, below, above)
