"""The solid: side from the control lattice, ends from what was felt of them, closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.uniform import contour_middle
from palpate.core.rebuild.caps import (
    LEAST_SITES,
    PLATE_SMOOTHING,
    End,
    conic_rings,
    flat_rings,
    is_steep,
    plate_rings,
    slope_sites,
    thin_out,
)
from palpate.core.rebuild.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.prism import PrismFit, fit_prism
from palpate.core.rebuild.rings import close_rings
from palpate.core.rebuild.skin import Skin, fit_skin
from palpate.core.rebuild.spine import fit_spine

ROWS, COLUMNS = 97, 160
"""Rings of the side, and points of a ring."""
BANDS = 25
"""Heights at which the uncertainty is given."""
WALL = (0.5, 1.05)
"""A wall carried on beyond the last contour keeps its radius within these shares."""
RIM_SITES = 60
LEAST_SIDE = 0.05
"""Least height of the side, as a share of the object's."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """One closed contour."""

    height: float
    """m."""
    points: Floats
    """(n, 3), m."""
    normals: Floats
    """Outward unit normals, (n, 3)."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Everything from which a solid is rebuilt, world frame."""

    slices: tuple[Slice, ...]
    """At least one."""
    side: FeltPoints
    """All taxels of the touches along the contours."""
    cap: FeltPoints
    """All taxels of the touches from above; none if there were none."""
    platform: float
    """Height on which the object stands, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A closed surface and how it came about."""

    vertices: Floats
    """(n, 3), m."""
    faces: Ints
    """(m, 3), counter-clockwise seen from outside."""
    prism: PrismFit
    """Control lattice of the side."""
    band_heights: Floats
    """(BANDS,), m."""
    deviation: Floats
    """Standard deviation of the surface at those heights, m."""
    health: dict[str, float]
    """Figures of the fit."""


def rebuild(evidence: Evidence) -> Solid:
    """A closed solid from what was felt.

    The skin is fitted to all taxels; the lattice is solved for the skin on a grid, so that
    its own shape is free along the height as well; the ends are closed.

    Raises
    ------
    ValueError
        If there is no contour, or none of its taxels lies on the side.
    """
    if not evidence.slices:
        raise ValueError("a solid needs at least one contour, got none")
    slices = sorted(evidence.slices, key=lambda one: one.height)
    top = _top(evidence)
    spine = fit_spine(
        np.array([one.height for one in slices]),
        np.array([contour_middle(one.points) for one in slices]),
    )
    felt = stack_points([evidence.side, evidence.cap])
    skin = fit_skin(felt, spine, evidence.platform, top)
    bottom_end: End = "flat" if is_steep(slices[0].normals) else "conic"
    touched = len(evidence.cap.points) >= LEAST_SITES
    round_end: End = "plate" if touched else "conic"
    top_end: End = "flat" if is_steep(slices[-1].normals) else round_end
    low = evidence.platform if bottom_end == "flat" else slices[0].height
    high = top if top_end == "flat" else slices[-1].height
    missing = 0.5 * (LEAST_SIDE * (top - evidence.platform) - (high - low))
    if missing > 0.0:  # one contour, both ends round
        low, high = low - missing, high + missing
    prism = _fit_side(skin, low, high, slices[0].height, slices[-1].height)
    turns = np.arange(COLUMNS) / COLUMNS
    side = prism.side(np.linspace(low, high, ROWS), turns)
    below = _bottom_rings(skin, side[0], bottom_end, evidence.platform)
    above = _top_rings(skin, side[-1], top_end, top, evidence)
    rings = np.concatenate([below[-2::-1], side, above[:-1]])
    vertices, faces = close_rings(below[-1].mean(axis=0), rings, above[-1].mean(axis=0))
    heights = np.linspace(slices[0].height, slices[-1].height, BANDS)
    return Solid(
        vertices,
        faces,
        prism,
        heights,
        skin.deviation(heights, np.arange(8) / 8),
        _health(skin, prism, len(felt.points), top_end, bottom_end, touched),
    )


def _top(evidence: Evidence) -> float:
    """Height of the object: of the touches from above, or else of whatever was felt."""
    points = evidence.cap.points if len(evidence.cap.points) else evidence.side.points
    return max(float(points[:, 2].max()), max(one.height for one in evidence.slices) + 1e-4)


def _fit_side(skin: Skin, low: float, high: float, first: float, last: float) -> PrismFit:
    """Control lattice of the skin; beyond the outer contours its radius is held in bounds."""
    turns = np.arange(COLUMNS) / COLUMNS
    heights = np.linspace(low, high, ROWS)
    squared = skin.squared(heights, turns)
    ends = skin.squared(np.array([first, last]), turns)
    bounds = np.array(WALL) ** 2
    for beyond, end in ((heights < first, ends[0]), (heights > last, ends[1])):
        squared[beyond] = np.clip(squared[beyond], bounds[0] * end, bounds[1] * end)
    rim = np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=-1)
    places = skin.spine.at(heights)[:, None, :] + np.sqrt(squared)[:, :, None] * rim
    return fit_prism(heights, turns, places)


def _bottom_rings(skin: Skin, rim: Floats, end: End, platform: float) -> Floats:
    height = float(rim[0, 2])
    middle = skin.spine.at(np.array([height]))[0]
    if end == "flat":
        return flat_rings(middle, rim[:, :2], height)
    slope = -skin.slope(height, np.arange(COLUMNS) / COLUMNS)
    return conic_rings(middle, rim[:, :2], slope, height, platform)


def _top_rings(skin: Skin, rim: Floats, end: End, top: float, evidence: Evidence) -> Floats:
    height = float(rim[0, 2])
    middle = skin.spine.at(np.array([height]))[0]
    if end == "conic":
        slope = skin.slope(height, np.arange(COLUMNS) / COLUMNS)
        return conic_rings(middle, rim[:, :2], slope, height, top)
    if end == "flat":
        return flat_rings(middle, rim[:, :2], height)
    slope = skin.slope(height, np.arange(COLUMNS) / COLUMNS)
    edge = slope_sites(middle, rim[:, :2], height, slope, 0.9 * (top - height))
    over = evidence.side.points[evidence.side.points[:, 2] > height]
    sites = np.concatenate([thin_out(evidence.cap.points), thin_out(over, RIM_SITES)])
    every = max(1, COLUMNS // RIM_SITES)
    return plate_rings(middle, rim[:, :2], np.concatenate([sites, edge[::every]]), PLATE_SMOOTHING)


def _health(
    skin: Skin, prism: PrismFit, points: int, top: End, bottom: End, touched: bool
) -> dict[str, float]:
    return {
        "points": float(points),
        "skin_rms_m": skin.rms,
        "skin_condition": skin.condition,
        "lattice_rms_m": prism.rms,
        "folded_share": prism.folded_share(),
        "top_flat": float(top == "flat"),
        "bottom_flat": float(bottom == "flat"),
        "top_untouched": float(not touched),
    }
