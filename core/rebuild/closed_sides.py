"""A side with its ends, closed: through contours, through contact points, or of a control lattice.

Of contact points, rows of the radial spline take the place of contours, and are passed exactly.
A loft that would run through its own axis before it closes in a point ends at its last contour
instead. What a lattice makes of a loft keeps the loft's own ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.geometry import area_centroids
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
    with_relief,
)
from palpate.core.rebuild.lattice import LatticeFit, LatticeSide, fit_lattice, refine_lattice
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.side import (
    AxisCurve,
    ContourLoft,
    ContourSurface,
    Coverage,
    RadialFit,
    RadialSpline,
    SidePatch,
    Uncertainty,
    bridged,
    coverage_of,
    fit_axis_curve,
    fit_contour_loft,
    fit_draft,
    fit_radial_spline,
    fit_shifted_spline,
    looks_inward,
    noise_of,
    radial_fit,
    with_normals,
)
from palpate.core.rebuild.surface import Patch, Surface, close_surface, search_surface
from palpate.core.steps import Steps, no_steps
from palpate.reprs import readable

POINT = 1e-9  # Of the widest contour: one that is narrower is a point
SECTIONS, SECTION_TURNS = 16, 64
LAST = 1e-3  # Of the way to the point: how near to it sections are looked at
ROWS, TURNS = 65, 160  # Rows taken of the loft, and points of each: closer together than its knots
NEAREST = 2e-3  # Of the height: rows come no nearer to an end, where the side may turn level
FEWEST = 200  # Points on the side: with fewer the contours alone say more
LEAST_SIDE = 0.05  # Least height of the side, as a share of the object's
MISFIT = 0.1  # Of the loft's own uncertainty: what a lattice may leave it by


@readable
@dataclass(frozen=True, slots=True, eq=False)
class ContourSolid:
    """A closed surface and how it came about."""

    surface: Surface
    loft: ContourLoft
    bottom: End
    top: End
    radial: RadialFit | None = None  # How all that was touched was fitted, if it was
    shear: Shear | None = None  # All this is seen where both ends are level, if they are not

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """As `ContourLoft.deviation`; of a radial spline, at each height the mean around."""
        if self.radial is None:
            return self.loft.deviation(heights, turns)
        levels = np.interp(heights, self.radial.band_heights, self.radial.band)
        return np.repeat(levels[:, None], len(turns), axis=1)

    def uncertainty(self) -> Uncertainty:
        """What the error of the side stays below, and what is narrower than could be seen."""
        return self.loft.uncertainty() if self.radial is None else self.radial.uncertainty()


def close_contours(
    heights: Floats,
    grid: Floats,
    *,
    bottom: float | None = None,
    top: float | None = None,
    noise: float | None = None,
    step: Steps = no_steps,
) -> ContourSolid:
    """The closed surface through contours at ascending heights (m,), grid (m, k, 2).

    They run counter-clockwise and correspond; a first or last one that is but a point counts as a
    touch of the end. `bottom` and `top` are heights at which a touch found the ends, `noise` is the
    standard deviation of a coordinate, estimated if left out. Raises ValueError as `close_ends` and
    `fit_contour_loft` do; or if there is but one contour, and both ends have not been touched.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    width = np.ptp(grid, axis=1).max(axis=1, initial=0.0) if grid.shape[1] else np.zeros(0)
    wide = np.flatnonzero(width > POINT * width.max(initial=0.0))
    first, last = (int(wide[0]), int(wide[-1])) if len(wide) else (0, -1)
    if len(wide) and first > 0 and bottom is None:
        bottom = float(heights[0])
    if len(wide) and last < len(heights) - 1 and top is None:
        top = float(heights[-1])
    heights, grid = heights[first : last + 1], grid[first : last + 1]
    if not len(heights) or (len(heights) == 1 and (bottom is None or top is None)):
        raise ValueError(
            f"heights must be at least 2 unless both ends were touched, got {len(heights)}"
        )
    with step("cross-validation"):  # it smooths the loft, too
        known = noise  # An end can be told from contours only as far as their noise allows
        if known is None:
            known = noise_of(heights, grid) if len(heights) > 1 else 0.0
        with step("ends"):
            ends = close_ends(heights, grid, bottom=bottom, top=top, noise=known)
        return _between_ends(heights, grid, ends, noise)


def close_radial(rows: RadialRows) -> ContourSolid:
    """The closed surface through rows of a radial spline, which are passed exactly."""
    closed = _between_ends(rows.heights, rows.grid, rows.ends, 0.0)
    return replace(closed, radial=rows.fit, shear=rows.shear)


def _between_ends(
    heights: Floats, grid: Floats, ends: tuple[End, End], noise: float | None
) -> ContourSolid:
    """The loft runs on to a point where an end is round, else ends at its last contour."""

    def lofted() -> ContourLoft:
        low, high = (end.rim if end.apart else end.height for end in ends)
        pole = [end.middle if end.round else False for end in ends]
        return fit_contour_loft(heights, grid, low=low, high=high, pole=pole, noise=noise)

    loft = lofted()
    through = [end.round and runs_through_axis(loft.surface, end.rim, end.height) for end in ends]
    if any(through):
        below, above = (
            replace(end, apart=end.apart or crossed)
            for end, crossed in zip(ends, through, strict=True)
        )
        ends = below, above
        loft = lofted()
    return ContourSolid(_closed(SidePatch(loft.surface), ends), loft, *ends)


def runs_through_axis(surface: ContourSurface, rim: float, end: float) -> bool:
    """Whether a section between the last contour, at `rim`, and the point is inside out."""
    ways = 1.0 - np.geomspace(1.0, LAST, SECTIONS)
    turns = np.arange(SECTION_TURNS) / SECTION_TURNS
    sections = surface.rings(rim + ways * (end - rim), turns)
    away = sections - area_centroids(sections)[:, None]
    along = np.einsum("ski,ki->s", away, away[0])
    if not (along > 0.0).all():
        return True
    star = are_star_shaped(away)
    return bool(star[0] and not star.all())


class RadialRows(NamedTuple):
    """Rows of a radial spline through contact points, their ends, and how they came about."""

    heights: Floats  # (m,), ascending, m
    grid: Floats  # (m, k, 2), m
    ends: tuple[End, End]  # Below and above
    fit: RadialFit  # How the loft was fitted
    shear: Shear | None  # All this is seen where both ends are level, if they are not


def radial_rows(
    slices: Slices,
    contacts: ContactPoints,
    bottom: float | None,
    top: float | None,
    step: Steps = no_steps,
    draft: bool = False,
) -> RadialRows | None:
    """Rows of the radial spline through all contact points, over the heights that were touched.

    None where the contours tell more alone: where sections are not star-shaped about the axis, or
    hardly anything was touched, or not all around. `bottom` and `top` are touched ends' heights, m.
    A `draft` has fewer coefficients around, where these do about as well, and no condition number.
    """
    levels = np.column_stack([area_centroids(slices.fine), slices.heights])
    axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    normals = contacts.normals is not None  # Surer than curves, which noise may turn back
    starlike = not looks_inward(contacts, axis_curve) if normals else slices.star.all()
    if not starlike or len(contacts.points) < FEWEST:
        return None
    shear = None
    if normals:
        shear = shear_between(contacts, levels[:, :2].mean(axis=0), (bottom, top))
    if shear is not None:
        # Other ends were touched by taxels, which say where they are in the straight space.
        bottom = bottom if only_given(contacts, -1.0, bottom) else None
        top = top if only_given(contacts, 1.0, top) else None
        contacts, levels = shear.levelled_contacts(contacts), shear.levelled(levels)
        axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    found = _rows_between(contacts, axis_curve, levels[:, 2], (bottom, top), step, draft)
    return None if found is None else found._replace(shear=shear)


def _rows_between(
    contacts: ContactPoints,
    axis_curve: AxisCurve,
    levels: Floats,
    ends: tuple[float | None, float | None],
    step: Steps,
    draft: bool,
) -> RadialRows | None:
    """The rows about an axis, from the heights (n,) of the contours' middles."""
    # All contact points lie between them, but for what seems to lie beyond an end that is known
    # from elsewhere, as a platform is.
    low, high = (
        _reached(contacts, float(last), way, end)
        for end, last, way in zip(ends, levels[[0, -1]], (-1.0, 1.0), strict=True)
    )
    with step("radial spline"):
        contacts = with_normals(contacts, axis_curve, low, high)
        fitted = fit_draft if draft else fit_radial_spline
        plain = fitted(contacts, axis_curve, low, high)
        seen = coverage_of(plain.rows.heights, plain.rows.places[:, 1])
        if len(plain.rows.heights) < FEWEST or seen is None:
            return None
        plain = bridged(contacts, plain)
        spline, pose = fit_shifted_spline(contacts, plain, step)
    with step("ends"):
        bottom = touched_end(contacts, float(levels[0]), -1.0, pose, ends[0])
        top = touched_end(contacts, float(levels[-1]), 1.0, pose, ends[1])
        return _rows(contacts, spline, levels, (bottom, top), seen, pose, step, draft)


def _reached(contacts: ContactPoints, last: float, way: float, end: float | None) -> float:
    heights = [way * last] if end is None else [way * last, way * end]
    if end is None or on_end(contacts, last, way).any():
        heights.append(float((way * contacts.points[:, 2]).max()))
    return way * max(heights)


def _rows(
    contacts: ContactPoints,
    spline: RadialSpline,
    levels: Floats,
    ends: tuple[float | None, float | None],
    seen: Coverage,
    pose: float | None,
    step: Steps,
    draft: bool,
) -> RadialRows:
    lowest, highest = float(levels[0]), float(levels[-1])
    bottom = spline.low if ends[0] is None else min(ends[0], lowest)
    top = spline.high if ends[1] is None else max(ends[1], highest)
    low, high = min(seen.low, lowest), max(seen.high, highest)
    extent = top - bottom
    low, high = max(low, bottom + NEAREST * extent), min(high, top - NEAREST * extent)
    missing = max(0.5 * (LEAST_SIDE * extent - (high - low)), 0.0)
    low, high = max(low - missing, 0.5 * (low + bottom)), min(high + missing, 0.5 * (high + top))
    turns = np.arange(TURNS) / TURNS
    heights = np.linspace(low, high, ROWS)
    noise = float(np.hypot(spline.sigma, pose or 0.0))
    spacing = (highest - lowest) / max(len(levels) - 1, 1)

    def closing(rim: float, inwards: float, height: float | None) -> End:
        end = end_from_contacts(contacts, spline, turns, rim, inwards, height, noise)
        # Where nobody touched it, it may go on as far as contours are apart.
        if end.kind == "fan":
            return replace(end, uncovered=spacing)
        return with_relief(end, contacts, spline.rings(np.array([rim]), turns)[0], pose)

    below = closing(low, high - low, None if ends[0] is None else bottom)
    above = closing(high, low - high, None if ends[1] is None else top)
    with step("bound"):
        fit = radial_fit(spline, seen, pose, (low, high), missing > 0.0, draft)
    return RadialRows(heights, spline.rings(heights, turns), (below, above), fit, None)


def lattice_of(
    closed: ContourSolid, size: tuple[int, int] | None = None, grasp: Recovery | None = None
) -> tuple[Surface, LatticeFit]:
    """The closed surface of a lattice, as `fit_lattice` makes it, with the loft's own ends."""
    tolerance = MISFIT * closed.uncertainty().rms
    fit = fit_lattice(closed.loft.surface, tolerance, size=size, grasp=grasp)
    return _closed(fit.side, (closed.bottom, closed.top)), fit


def refine_solid(
    fit: LatticeFit,
    closed: ContourSolid,
    points: Floats,
    *,
    sigma: float | None = None,
    weights: bool = False,
) -> tuple[Surface, LatticeFit]:
    """Change a lattice so that its closed surface passes points: `LatticeSolid.refined`."""
    ends = closed.bottom, closed.top
    surface = _closed(fit.side, ends)
    if sigma is not None:
        positive("sigma", sigma, "m")
    nearest = search_surface(surface).nearest(points)
    number = next(i for i, piece in enumerate(surface.pieces) if isinstance(piece, LatticeSide))
    low, high = surface.seams[number : number + 2]
    on_side = (nearest.v >= low) & (nearest.v <= high)
    places = np.column_stack([(nearest.v - low) / (high - low), nearest.turns])[on_side]
    each = None if sigma is None else np.full(int(on_side.sum()), sigma)
    seen, places = points[on_side], np.clip(places, 0.0, 1.0)
    found = refine_lattice(fit, seen, places, sigma=each, weights=weights)
    assert found.refinement is not None
    beyond = int(np.count_nonzero(~on_side))
    found = replace(found, refinement=found.refinement._replace(beyond=beyond))
    return _closed(found.side, ends), found


def _closed(side: Patch, ends: tuple[End, End]) -> Surface:
    """A side with the ends in which it does not close by itself."""
    return close_surface(side, *(None if end.round else end for end in ends))
