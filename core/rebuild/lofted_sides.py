"""A side through contours alone, and its ends, where there are no contacts that can be used.

A loft that would run through its own axis before it closes in a point ends at its last contour.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import area_centroids
from palpate.core.rebuild.contours import are_star_shaped, drop_reasons
from palpate.core.rebuild.ends import End, close_ends
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.side import ContourLoft, LoftPatch, contour_noise, fit_contour_loft
from palpate.core.steps import Steps


def lofted_side(
    evidence: Evidence, step: Steps, point_width: float = 1e-9
) -> tuple[ContourLoft, tuple[End, End]]:
    """The loft of the contours, and its ends.

    A first or last contour narrower than `point_width`, a fraction of the widest one, is a point,
    and counts as a touch of the end. Raises ValueError as `close_ends` and `fit_contour_loft` do;
    or if there is only one contour, and not both ends were touched.
    """
    slices, bottom, top = evidence.slices, evidence.bottom, evidence.top
    heights, grid = slices.heights, evidence.correspondence.grid
    width = np.ptp(grid, axis=1).max(axis=1)
    wide = np.flatnonzero(width > point_width * width.max())
    first, last = (int(wide[0]), int(wide[-1])) if len(wide) else (0, len(heights) - 1)
    if first > 0 and bottom is None:
        bottom = float(heights[0])
    if last < len(heights) - 1 and top is None:
        top = float(heights[-1])
    heights, grid = heights[first : last + 1], grid[first : last + 1]
    if len(heights) < 2 and (bottom is None or top is None):
        why = f" ({drop_reasons(slices.dropped)})" if slices.dropped else ""
        raise ValueError(
            "contours must leave at least 2 to rebuild from, or 1 with tops that touched both "
            f"ends, got 1{why}"
        )
    with step("cross-validation"):  # of the noise, and of the smoothing of the loft
        noise = evidence.noise
        if noise is None:
            noise = contour_noise(heights, grid) if len(heights) > 1 else 0.0
        with step("ends"):
            ends = close_ends(heights, grid, bottom=bottom, top=top, noise=noise)
        return _between_ends(heights, grid, ends, evidence.noise)


def _between_ends(
    heights: Floats, grid: Floats, ends: tuple[End, End], noise: float | None
) -> tuple[ContourLoft, tuple[End, End]]:
    """The loft, which continues to a point at a round end, else ends at its last contour."""

    def lofted() -> ContourLoft:
        low, high = (end.rim if end.apart else end.height for end in ends)
        below, above = (end.middle if end.round else None for end in ends)
        return fit_contour_loft(heights, grid, low=low, high=high, pole=(below, above), noise=noise)

    loft = lofted()
    through = [end.round and runs_through_axis(loft.patch, end.rim, end.height) for end in ends]
    if any(through):
        below, above = (
            replace(end, apart=end.apart or crossed)
            for end, crossed in zip(ends, through, strict=True)
        )
        ends = below, above
        loft = lofted()
    return loft, ends


def runs_through_axis(
    patch: LoftPatch,
    rim: float,
    end: float,
    n_sections: int = 16,
    n_turns: int = 64,
    nearest: float = 1e-3,
) -> bool:
    """Whether a section between the last contour, at `rim`, and the point at `end` is inside out.

    The last of the sections is at `nearest` of the distance from the point.
    """
    shares = 1.0 - np.geomspace(1.0, nearest, n_sections)
    turns = np.arange(n_turns) / n_turns
    sections = patch.rings(rim + shares * (end - rim), turns)
    away = sections - area_centroids(sections)[:, None]
    along = np.einsum("ski,ki->s", away, away[0])
    if not (along > 0.0).all():
        return True
    star = are_star_shaped(away)
    return bool(star[0] and not star.all())
