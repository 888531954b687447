"""A closed surface from all that was felt: rows of the felt skin take the place of contours."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.rebuild.ends.ends import End
from palpate.core.rebuild.felt.coverage import Coverage, coverage_of
from palpate.core.rebuild.felt.end_planes import only_given, slant_between
from palpate.core.rebuild.felt.felt_ends import felt_end, on_end, touched_end
from palpate.core.rebuild.felt.felt_fit import FeltFit, felt_fit
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_skin import FeltSkin, fit_skin, with_normals
from palpate.core.rebuild.felt.side_rows import looks_inward
from palpate.core.rebuild.felt.spine import Spine, fit_spine
from palpate.core.rebuild.felt.touch_offsets import fit_shifted_skin, pose_sigma
from palpate.core.rebuild.slant import Slant
from palpate.core.rebuild.slices.slices import Slices

ROWS, TURNS = 65, 160
"""Rows taken of the skin, and points of each: closer together than its knots."""
NEAREST = 2e-3
"""Of the height: rows come no nearer to an end, where the side may turn level."""
FEWEST = 200
"""Points on the side: with fewer the contours alone say more."""
LEAST_SIDE = 0.05
"""Least height of the side, as a share of the object's."""


class FeltRows(NamedTuple):
    """Rows of a skin through felt points, their ends, and how they came about."""

    heights: Floats
    """(m,), ascending, m."""
    grid: Floats
    """(m, k, 2), m."""
    ends: tuple[End, End]
    """Below and above."""
    fit: FeltFit
    """How the skin was fitted."""
    slant: Slant | None
    """All this is seen from the space in which both ends are level, if they are not."""


def felt_rows(
    slices: Slices, felt: FeltPoints, bottom: float | None, top: float | None
) -> FeltRows | None:
    """Rows of the skin through all felt points, over the heights that were felt.

    Parameters
    ----------
    slices : Slices
        The contours; they say where the axis is.
    felt : FeltPoints
        All touched taxels, checked.
    bottom, top : float or None
        Heights at which a touch found the ends, m.

    Returns
    -------
    FeltRows or None
        None where the contours alone say more: where sections are not star-shaped about the
        axis, or hardly anything was felt, or not all around.
    """
    levels = np.column_stack([[area_centroid(fine) for fine in slices.fine], slices.heights])
    spine = fit_spine(levels[:, 2], levels[:, :2])
    # Normals tell more surely than curves, which noise may turn back at an edge.
    starlike = slices.star.all() if felt.normals is None else not looks_inward(felt, spine)
    if not starlike:
        return None
    if len(felt.points) < FEWEST:
        return None
    slant = None
    if felt.normals is not None:
        slant = slant_between(felt, levels[:, :2].mean(axis=0), (bottom, top))
    if slant is not None:
        # Other ends were felt by taxels, which say where they are in the straight space.
        bottom = bottom if only_given(felt, -1.0, bottom) else None
        top = top if only_given(felt, 1.0, top) else None
        felt, levels = slant.straightened_felt(felt), slant.straightened(levels)
        spine = fit_spine(levels[:, 2], levels[:, :2])
    found = _rows_between(felt, spine, levels[:, 2], bottom, top)
    return None if found is None else found._replace(slant=slant)


def _rows_between(
    felt: FeltPoints, spine: Spine, levels: Floats, bottom: float | None, top: float | None
) -> FeltRows | None:
    """The rows about an axis, from the heights (n,) of the contours' middles."""
    low, high = _reach(felt, levels, bottom, top)
    felt = with_normals(felt, spine, low, high)
    plain = fit_skin(felt, spine, low, high)
    seen = coverage_of(plain.rows.heights, plain.rows.places[:, 1])
    if len(plain.rows.heights) < FEWEST or seen is None:
        return None
    shifted = fit_shifted_skin(felt, plain)
    pose = pose_sigma(shifted)
    bottom = touched_end(felt, float(levels[0]), -1.0, pose, bottom)
    top = touched_end(felt, float(levels[-1]), 1.0, pose, top)
    return _rows(felt, shifted.skin, levels, (bottom, top), seen, pose)


def _reach(
    felt: FeltPoints, levels: Floats, bottom: float | None, top: float | None
) -> tuple[float, float]:
    """Heights between which the skin is fitted.

    All that was felt is between them, but for what seems to lie beyond an end that is known from
    elsewhere, as a platform is.
    """
    reached = []
    for end, last, way in ((bottom, levels[0], -1.0), (top, levels[-1], 1.0)):
        heights = [way * float(last)]
        if end is not None:
            heights.append(way * end)
        if end is None or on_end(felt, float(last), way).any():
            heights.append(float((way * felt.points[:, 2]).max()))
        reached.append(way * max(heights))
    return reached[0], reached[1]


def _rows(
    felt: FeltPoints,
    skin: FeltSkin,
    levels: Floats,
    ends: tuple[float | None, float | None],
    seen: Coverage,
    pose: float | None,
) -> FeltRows:
    lowest, highest = float(levels[0]), float(levels[-1])
    bottom = skin.low if ends[0] is None else min(ends[0], lowest)
    top = skin.high if ends[1] is None else max(ends[1], highest)
    low, high = min(seen.low, lowest), max(seen.high, highest)
    extent = top - bottom
    low, high = max(low, bottom + NEAREST * extent), min(high, top - NEAREST * extent)
    missing = max(0.5 * (LEAST_SIDE * extent - (high - low)), 0.0)
    low, high = max(low - missing, 0.5 * (low + bottom)), min(high + missing, 0.5 * (high + top))
    turns = np.arange(TURNS) / TURNS
    heights = np.linspace(low, high, ROWS)
    noise = float(np.hypot(skin.sigma, pose or 0.0))
    spacing = (highest - lowest) / max(len(levels) - 1, 1)
    lower, upper = (
        None if end is None else told for end, told in zip(ends, (bottom, top), strict=True)
    )
    below = _honest(felt_end(felt, skin, turns, low, high - low, lower, noise), spacing)
    above = _honest(felt_end(felt, skin, turns, high, low - high, upper, noise), spacing)
    fit = felt_fit(skin, seen, pose, (low, high), missing > 0.0)
    return FeltRows(heights, skin.rings(heights, turns), (below, above), fit, None)


def _honest(end: End, spacing: float) -> End:
    """An end that nobody touched, as far as the contours' distance says that it may go on."""
    return replace(end, uncovered=spacing) if end.kind == "fan" else end
