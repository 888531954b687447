"""A side with its ends, closed: through contours, through contact points, or of a control lattice.

Of contact points, rows of the radial spline take the place of contours, and are passed exactly.
A loft that would run through its own axis before it closes in a point ends at its last contour
instead. What a lattice makes of a loft keeps the loft's own ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.geometry import area_centroid, area_centroids
from palpate.core.rebuild.contours import ContactPoints, Slices, are_star_shaped
from palpate.core.rebuild.ends import (
    End,
    Shear,
    close_ends,
    end_from_contacts,
    on_end,
    only_given,
    shear_between,
    touched_end,
)
from palpate.core.rebuild.lattice import LatticeFit, LatticeSide, fit_lattice, refine_lattice
from palpate.core.rebuild.loft import (
    ContourLoft,
    ContourSurface,
    SidePatch,
    Uncertainty,
    fit_contour_loft,
    noise_of,
)
from palpate.core.rebuild.radial import (
    AxisCurve,
    Coverage,
    RadialFit,
    RadialSpline,
    coverage_of,
    fit_axis_curve,
    fit_radial_spline,
    fit_shifted_spline,
    looks_inward,
    pose_sigma,
    radial_fit,
    with_normals,
)
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.surface import Surface, close_surface, search_surface

POINT = 1e-9  # Of the widest contour: one that is narrower is a point
SECTIONS, SECTION_TURNS = 16, 64
LAST = 1e-3  # Of the way to the point: how near to it sections are looked at
ROWS, TURNS = 65, 160  # Rows taken of the skin, and points of each: closer together than its knots
NEAREST = 2e-3  # Of the height: rows come no nearer to an end, where the side may turn level
FEWEST = 200  # Points on the side: with fewer the contours alone say more
LEAST_SIDE = 0.05  # Least height of the side, as a share of the object's
MISFIT = 0.1  # Of the skin's own uncertainty: what a lattice may leave it by


@dataclass(frozen=True, slots=True, eq=False)
class ContourSolid:
    """A closed surface and how it came about."""

    surface: Surface
    skin: ContourLoft
    bottom: End
    top: End
    # How everything that was felt was fitted, where that took the place of the contours.
    felt: RadialFit | None = None
    # All this is seen from the space in which both ends are level, if they are not.
    shear: Shear | None = None

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Standard deviation of the side along its normal, m, on a grid (a, b).

        See `ContourLoft.deviation`; of what was felt, at each height the mean around.
        """
        if self.felt is None:
            return self.skin.deviation(heights, turns)
        levels = np.interp(heights, self.felt.band_heights, self.felt.band)
        deviation: Floats = np.repeat(levels[:, None], len(turns), axis=1)
        return deviation

    def uncertainty(self) -> Uncertainty:
        """What the error of the side stays below, and what is narrower than could be seen."""
        return self.skin.uncertainty() if self.felt is None else self.felt.uncertainty()


def close_contours(
    heights: Floats,
    grid: Floats,
    *,
    bottom: float | None = None,
    top: float | None = None,
    noise: float | None = None,
) -> ContourSolid:
    """The closed surface through contours.

    Parameters
    ----------
    heights : (m,) array
        Heights of the contours, ascending.
    grid : (m, k, 2) array
        Their points, counter-clockwise, corresponding. A first or last contour that is but a
        point counts as a touch of the end.
    bottom, top : float, optional
        Heights at which a touch found the ends; left out where nobody touched.
    noise : float, optional
        Standard deviation of a coordinate, in the same unit; estimated if left out.

    Raises
    ------
    ValueError
        As `close_ends` and `fit_contour_loft` do; or if there is but one contour, and both ends
        have not been touched.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    heights, grid, (bottom, top) = _points_as_touches(heights, grid, (bottom, top))
    if not len(heights) or (len(heights) == 1 and (bottom is None or top is None)):
        raise ValueError(
            f"heights must be at least 2 unless both ends were touched, got {len(heights)}"
        )
    seen = noise if noise is not None else _noise(heights, grid)
    ends = close_ends(heights, grid, bottom=bottom, top=top, noise=seen)
    return _between_ends(heights, grid, ends, noise)


def _points_as_touches(
    heights: Floats, grid: Floats, touched: tuple[float | None, float | None]
) -> tuple[Floats, Floats, tuple[float | None, float | None]]:
    """Contours without those at the ends that are points; these say where the ends are."""
    width = np.ptp(grid, axis=1).max(axis=1, initial=0.0) if grid.shape[1] else np.zeros(0)
    wide = np.flatnonzero(width > POINT * width.max(initial=0.0))
    if not len(wide):
        return heights[:0], grid[:0], touched
    first, last = int(wide[0]), int(wide[-1])
    bottom = float(heights[0]) if first > 0 and touched[0] is None else touched[0]
    top = float(heights[-1]) if last < len(heights) - 1 and touched[1] is None else touched[1]
    return heights[first : last + 1], grid[first : last + 1], (bottom, top)


def _noise(heights: Floats, grid: Floats) -> float:
    """Standard deviation of a coordinate: an end can be told from contours only so far."""
    if len(heights) == 1:
        return 0.0
    return noise_of(heights, grid)


def close_radial(rows: RadialRows) -> ContourSolid:
    """The closed surface through rows of a skin, which are passed exactly."""
    closed = _between_ends(rows.heights, rows.grid, rows.ends, 0.0)
    return replace(closed, felt=rows.fit, shear=rows.shear)


def _between_ends(
    heights: Floats, grid: Floats, ends: tuple[End, End], noise: float | None
) -> ContourSolid:
    skin = _loft_between(heights, grid, ends, noise)
    through = [end.round and runs_through_axis(skin.surface, end.rim, end.height) for end in ends]
    if any(through):
        bottom, top = (
            replace(end, apart=end.apart or one) for end, one in zip(ends, through, strict=True)
        )
        ends = bottom, top
        skin = _loft_between(heights, grid, ends, noise)
    below, above = (None if end.round else end for end in ends)
    side = SidePatch(skin.surface)
    return ContourSolid(close_surface(side, below, above), skin, *ends)


def _loft_between(
    heights: Floats, grid: Floats, ends: tuple[End, End], noise: float | None
) -> ContourLoft:
    """The skin, which runs on to a point where an end is round, else ends at its last contour."""
    low, high = (end.rim if end.apart else end.height for end in ends)
    return fit_contour_loft(
        heights,
        grid,
        low=low,
        high=high,
        pole=[end.middle if end.round else False for end in ends],
        noise=noise,
    )


def runs_through_axis(surface: ContourSurface, rim: float, end: float) -> bool:
    """Whether a section between the last contour and the point is turned inside out.

    Where the last contour is seen whole from its middle, so must be all sections. Otherwise a
    section must but lie on the whole on the side of the axis on which the contour lies.

    Parameters
    ----------
    surface : ContourSurface
        The skin.
    rim, end : float
        Heights of the last contour and of the point, m.
    """
    ways = 1.0 - np.geomspace(1.0, LAST, SECTIONS)
    turns = np.arange(SECTION_TURNS) / SECTION_TURNS
    sections: Floats = surface.at((rim + ways * (end - rim))[:, None], turns[None])
    away = sections - area_centroids(sections)[:, None]
    along = np.einsum("ski,ki->s", away, away[0])
    if not (along > 0.0).all():
        return True
    star = are_star_shaped(away)
    return bool(star[0] and not star.all())


class RadialRows(NamedTuple):
    """Rows of a skin through felt points, their ends, and how they came about."""

    heights: Floats  # (m,), ascending, m
    grid: Floats  # (m, k, 2), m
    ends: tuple[End, End]  # Below and above
    fit: RadialFit  # How the skin was fitted
    # All this is seen from the space in which both ends are level, if they are not.
    shear: Shear | None


def radial_rows(
    slices: Slices, felt: ContactPoints, bottom: float | None, top: float | None
) -> RadialRows | None:
    """Rows of the skin through all felt points, over the heights that were felt.

    Parameters
    ----------
    slices : Slices
        The contours; they say where the axis is.
    felt : ContactPoints
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
    axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    # Normals tell more surely than curves, which noise may turn back at an edge.
    starlike = slices.star.all() if felt.normals is None else not looks_inward(felt, axis_curve)
    if not starlike:
        return None
    if len(felt.points) < FEWEST:
        return None
    shear = None
    if felt.normals is not None:
        shear = shear_between(felt, levels[:, :2].mean(axis=0), (bottom, top))
    if shear is not None:
        # Other ends were felt by taxels, which say where they are in the straight space.
        bottom = bottom if only_given(felt, -1.0, bottom) else None
        top = top if only_given(felt, 1.0, top) else None
        felt, levels = shear.levelled_contacts(felt), shear.levelled(levels)
        axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    found = _rows_between(felt, axis_curve, levels[:, 2], bottom, top)
    return None if found is None else found._replace(shear=shear)


def _rows_between(
    felt: ContactPoints,
    axis_curve: AxisCurve,
    levels: Floats,
    bottom: float | None,
    top: float | None,
) -> RadialRows | None:
    """The rows about an axis, from the heights (n,) of the contours' middles."""
    low, high = _reach(felt, levels, bottom, top)
    felt = with_normals(felt, axis_curve, low, high)
    plain = fit_radial_spline(felt, axis_curve, low, high)
    seen = coverage_of(plain.rows.heights, plain.rows.places[:, 1])
    if len(plain.rows.heights) < FEWEST or seen is None:
        return None
    shifted = fit_shifted_spline(felt, plain)
    pose = pose_sigma(shifted)
    bottom = touched_end(felt, float(levels[0]), -1.0, pose, bottom)
    top = touched_end(felt, float(levels[-1]), 1.0, pose, top)
    return _rows(felt, shifted.spline, levels, (bottom, top), seen, pose)


def _reach(
    felt: ContactPoints, levels: Floats, bottom: float | None, top: float | None
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
    felt: ContactPoints,
    skin: RadialSpline,
    levels: Floats,
    ends: tuple[float | None, float | None],
    seen: Coverage,
    pose: float | None,
) -> RadialRows:
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
    below = _honest(end_from_contacts(felt, skin, turns, low, high - low, lower, noise), spacing)
    above = _honest(end_from_contacts(felt, skin, turns, high, low - high, upper, noise), spacing)
    fit = radial_fit(skin, seen, pose, (low, high), missing > 0.0)
    return RadialRows(heights, skin.rings(heights, turns), (below, above), fit, None)


def _honest(end: End, spacing: float) -> End:
    """An end that nobody touched, as far as the contours' distance says that it may go on."""
    return replace(end, uncovered=spacing) if end.kind == "fan" else end


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
