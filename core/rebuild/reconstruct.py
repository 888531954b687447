"""From touches to a closed solid, by one of four methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import positive
from palpate.core.rebuild.coarse import coarse_patch, fit_coarse
from palpate.core.rebuild.contour_solid import ContourSolid, close_contours
from palpate.core.rebuild.evidence import Evidence, gather
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.lattice.prism import PrismFit, fit_prism
from palpate.core.rebuild.solid import Method, Solid
from palpate.core.rebuild.surface.surface import closed_surface
from palpate.core.rebuild.thesis.rebuild import rebuild_thesis
from palpate.core.rebuild.thesis.surface import thesis_patches

LATTICE_ROWS, LATTICE_COLUMNS = 97, 160
"""Places of the side for which a control lattice is solved."""


def reconstruct(
    contours: Sequence[ArrayLike],
    normals: Sequence[ArrayLike] | None = None,
    patches: FeltPoints | None = None,
    tops: ArrayLike | None = None,
    method: Method = "lattice",
    *,
    heights: ArrayLike | None = None,
    noise: float | None = None,
    faithful: bool = False,
) -> Solid:
    """Rebuild a solid from what was felt of it.

    Parameters
    ----------
    contours : sequence of (n, 3) arrays, or of (n, 2) arrays with `heights`
        At least 2 closed curves around the z axis, in any order, each begun anywhere, in either
        direction, of any number of points and in any unit. Rows that are not finite are left
        out.
    normals : sequence of (n, 3) arrays, optional
        Outward normals at the contours' points, of any length.
    patches : FeltPoints, optional
        Everything that touched, as points with the numbers of their touches.
    tops : (k, 3) array, optional
        Where single touches found the ends: those above the middle of the contours the upper
        one, those below it the lower one. An end that nobody touched is closed where the
        contours say where, else level on the last contour; see `Solid.uncovered`.
    method : {"lattice", "skin", "thesis", "coarse"}
        "skin": a smooth surface through what was felt. "lattice": the same as a control lattice
        that deforms a prism, which can be edited and refined. "thesis": the shell and core of
        Fung, 1999, 4.4, to compare with. "coarse": a superquadric, tapered and bent.
    heights : (m,) array, optional
        Of plane contours.
    noise : float, optional
        Standard deviation of a coordinate; estimated if left out.
    faithful : bool
        With the method "thesis", as the program in its appendix has it, faults and all: see
        `rebuild_thesis`. The contours must then have as many points each.

    Returns
    -------
    Solid

    Raises
    ------
    ValueError
        If fewer than 2 contours can be used, or an argument has no use: the sentence says why.

    Notes
    -----
    Fung, 1999, 4.2 and 4.4, with a smoothed skin through the contours in place of the shell and
    core.
    """
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {', '.join(get_args(Method))}, got {method!r}")
    if noise is not None:
        positive("noise", noise, "in the unit of the contours")
    if faithful and method != "thesis":
        raise ValueError(f"faithful goes with the method 'thesis' alone, got {method!r}")
    evidence = gather(contours, tops, felt=patches, heights=heights, noise=noise)
    if method == "coarse":
        return _coarse(evidence)
    if method == "thesis":
        return _thesis(evidence, faithful)
    closed = _close(evidence)
    lattice = _lattice(closed, evidence) if method == "lattice" else None
    return Solid(
        surface=closed.surface, method=method, evidence=evidence, closed=closed, lattice=lattice
    )


def _coarse(evidence: Evidence) -> Solid:
    slices = evidence.slices
    points = [
        np.column_stack([points, np.full(len(points), height)])
        for points, height in zip(slices.points, slices.heights, strict=True)
    ]
    found = fit_coarse(np.concatenate(points), evidence.noise)
    if not found.fitted:
        raise ValueError(f"contours must determine a superquadric, got {found.doubts[0]}")
    surface = closed_surface((coarse_patch(found),))
    return Solid(surface=surface, method="coarse", evidence=evidence, model=found)


def _thesis(evidence: Evidence, faithful: bool) -> Solid:
    slices = evidence.slices
    count = evidence.correspondence.grid.shape[1]
    turns = np.arange(count) / count
    rings = slices.points if faithful else [curve.at(turns) for curve in slices.curves]
    contours = [
        np.column_stack([ring, np.full(len(ring), height)])
        for ring, height in zip(rings, slices.heights, strict=True)
    ]
    found = rebuild_thesis(contours, faithful=faithful)
    surface = closed_surface(thesis_patches(found))
    return Solid(surface=surface, method="thesis", evidence=evidence, model=found)


def _close(evidence: Evidence) -> ContourSolid:
    """The skin and its ends."""
    slices = evidence.slices
    if len(slices.heights) < 2:
        dropped = "; ".join(f"contour {one.which}: {one.why}" for one in slices.dropped)
        why = f" ({dropped})" if dropped else ""
        raise ValueError(f"contours must leave at least 2 to rebuild from, got 1{why}")
    return close_contours(
        slices.heights,
        evidence.correspondence.grid,
        bottom=evidence.bottom,
        top=evidence.top,
        noise=evidence.noise,
    )


def _lattice(closed: ContourSolid, evidence: Evidence) -> PrismFit:
    surface, levels = closed.skin.surface, evidence.slices.heights
    heights = np.linspace(levels[0], levels[-1], LATTICE_ROWS)
    turns = np.arange(LATTICE_COLUMNS) / LATTICE_COLUMNS
    return fit_prism(heights, turns, surface.at(heights[:, None], turns[None]))
