"""The solid: side from the control lattice, ends from what was felt of them, closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.rebuild.felt.caps import LEAST_SITES, Profile, cap_rings, fit_profile, thin_out
from palpate.core.rebuild.felt.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.felt.felt_skin import Skin, fit_skin
from palpate.core.rebuild.felt.spine import fit_spine
from palpate.core.rebuild.lattice.prism import PrismFit, fit_prism
from palpate.core.rebuild.surface.rings import close_rings

ROWS, COLUMNS = 97, 160
"""Rings of the side, and points of a ring."""
BANDS = 25
"""Heights at which the uncertainty is given."""
STRETCH = 0.15
"""Share of the object's height over which the side tells how it narrows towards an end."""
STRETCH_ROWS = 40
RIM_SITES = 60
"""Points of the touches along the side that help to close the top."""
LEAST_SIDE = 0.05
"""Least height of the side, as a share of the object's."""
LEAST_TOP = 2e-3
"""Least height of the object over its last contour, as a share of that one's."""


@dataclass(frozen=True, slots=True, eq=False)
class FeltContour:
    """One closed contour."""

    height: float
    """m."""
    points: Floats
    """(n, 3), m."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Everything from which a solid is rebuilt, world frame."""

    contours: tuple[FeltContour, ...]
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
    """Figures of the fit: worst condition number; fallbacks taken (a top closed without touches
    on it, a side stretched because the contours lie too close); points, misfits in m, and the
    share of folds."""


def rebuild(evidence: Evidence) -> Solid:
    """A closed solid from what was felt.

    The skin is fitted to all taxels; the lattice is solved for the skin on a grid, so that
    its own shape is free along the height as well; the ends are closed.

    Raises
    ------
    ValueError
        If there is no contour, or none of its taxels lies on the side.
    """
    if not evidence.contours:
        raise ValueError("a solid needs at least one contour, got none")
    contours = sorted(evidence.contours, key=lambda one: one.height)
    top = _top(evidence)
    spine = fit_spine(
        np.array([one.height for one in contours]),
        np.array([area_centroid(one.points) for one in contours]),
    )
    felt = stack_points([evidence.side, evidence.cap])
    skin = fit_skin(felt, spine, evidence.platform, top)
    low, high = _side_range(contours, evidence.platform, top)
    between = contours[-1].height - contours[0].height
    prism = _fit_side(skin, low, high)
    side = prism.side(np.linspace(low, high, ROWS), np.arange(COLUMNS) / COLUMNS)
    below_profile = _profile(skin, low, evidence.platform)
    above_profile = _profile(skin, high, top)
    on_top = evidence.cap.points[evidence.cap.points[:, 2] > high]
    over = evidence.side.points[evidence.side.points[:, 2] > high]
    under = evidence.side.points[evidence.side.points[:, 2] < low]
    foot = spine.at(side[0, :1, 2])[0]
    under = np.concatenate([under, [[*foot, evidence.platform]]])  # it stands there
    below = cap_rings(below_profile, foot, side[0], under)
    sites = np.concatenate([thin_out(on_top), thin_out(over, RIM_SITES)])
    above = cap_rings(above_profile, spine.at(side[-1, :1, 2])[0], side[-1], sites)
    rings = np.concatenate([below[-2::-1], side, above[:-1]])
    vertices, faces = close_rings(below[-1].mean(axis=0), rings, above[-1].mean(axis=0))
    heights = np.linspace(contours[0].height, contours[-1].height, BANDS)
    health = {
        "worst_condition": max(skin.condition, prism.condition),
        "fallbacks": float((len(on_top) < LEAST_SITES) + (high - low > between)),
        "points": float(len(felt.points)),
        "skin_rms_m": skin.rms,
        "lattice_rms_m": prism.rms,
        "folded_share": prism.folded_share(),
        "bottom_misfit_m": below_profile.misfit,
        "top_misfit_m": above_profile.misfit,
    }
    deviation = skin.deviation(heights, np.arange(8) / 8)
    return Solid(vertices, faces, prism, heights, deviation, health)


def _side_range(contours: list[FeltContour], platform: float, top: float) -> tuple[float, float]:
    """Heights between which the side is taken from the skin, m."""
    low, high = contours[0].height, contours[-1].height
    missing = max(0.5 * (LEAST_SIDE * (top - platform) - (high - low)), 0.0)
    return max(low - missing, 0.5 * (low + platform)), min(high + missing, 0.5 * (high + top))


def _profile(skin: Skin, rim: float, end: float) -> Profile:
    """How the side narrows from a rim to an end."""
    inwards = np.copysign(STRETCH * (skin.high - skin.low), rim - end)
    heights = np.linspace(rim + inwards, rim, STRETCH_ROWS)
    squared = skin.squared(heights, np.arange(COLUMNS) / COLUMNS)
    return fit_profile(heights, np.sqrt(squared).mean(axis=1), end)


def _top(evidence: Evidence) -> float:
    """Height of the object: of the touches from above, or else of whatever was felt."""
    points = evidence.cap.points if len(evidence.cap.points) else evidence.side.points
    last = max(one.height for one in evidence.contours)
    return max(float(points[:, 2].max()), last + LEAST_TOP * (last - evidence.platform))


def _fit_side(skin: Skin, low: float, high: float) -> PrismFit:
    """Control lattice that takes the shape of the skin between two heights."""
    turns = np.arange(COLUMNS) / COLUMNS
    heights = np.linspace(low, high, ROWS)
    rim = np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=-1)
    radius = np.sqrt(skin.squared(heights, turns))
    return fit_prism(heights, turns, skin.spine.at(heights)[:, None, :] + radius[:, :, None] * rim)
