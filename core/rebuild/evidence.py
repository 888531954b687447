"""What a solid is rebuilt from: slices, which places of them correspond, and what was touched."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats
from palpate.core.geometry import signed_area
from palpate.core.rebuild.contours import (
    ContactPoints,
    ContourCurve,
    Correspondence,
    DroppedContour,
    FeatureCandidate,
    Slices,
    are_nearly_star_shaped,
    contour_curves,
    inconsistent_contours,
    interpolation_errors,
    may_be_features,
    match_slices,
    neighbour_misfits,
    point_outliers,
    refitted_curve,
    restack,
    slide_along_curves,
    stack_curves,
)
from palpate.reprs import readable

FEWEST, MOST = 24, 160  # Places around a contour that are matched: as many as its points
POINT = 0.03  # Of the widest contour: one at an end that is no wider, and meets itself, is a point
PASSES = 3  # Of looking for points that are wrong: contours are judged by those beside them
NO_AREA = 1e-6  # Of its squared perimeter: a contour that meets itself around less has no inside
# Of the way around, and of the usual step: a longer step between two points is a gap.
GAPING, GAPING_STEPS = 0.25, 6.0
# Contours from which on one that differs from its neighbours in size alone is left out: a wrong one
# costs more then than a groove that is missed. Of fewer, far apart, each says more.
MANY = 12
LEAST_SIZE, MOST_SIZE = 1e-50, 1e50  # Of what is rebuilt: its fifth power must be a number


@readable
class Evidence(NamedTuple):
    """Everything that is known of an object, seen from the slicing frame, in its contours' unit."""

    slices: Slices  # The contours that are used, and those that are not, and why
    correspondence: Correspondence  # Which places of them belong together
    bottom: float | None  # Height at which a touch found the lower end
    top: float | None  # Height at which a touch found the upper end
    contacts: ContactPoints | None  # All touched taxels
    noise: float | None  # Standard deviation of a coordinate, if it is known
    # Each contour by itself, as it was given: what more evidence is added to.
    given: tuple[ContourCurve | DroppedContour, ...] = ()
    tops: Floats | None = None  # (k, 3): where single touches found the ends
    feature_candidates: tuple[FeatureCandidate, ...] = ()  # Used, though unlike their neighbours
    frame: Floats | None = None  # Pose (7,) of the slicing frame; None: the world's own

    @property
    def outliers(self) -> int:
        """Single points of the contours that were found to be wrong, and left out."""
        return int(sum(loop.outlier.sum() for loop in self.slices.loops))

    def health(self) -> dict[str, float]:
        """Figures of what the contours are like, by name: see `LatticeSolid.health`."""
        slices = self.slices
        away = slices.fine - slices.middles[:, None]
        return {
            "contours": float(len(slices.heights)),
            "dropped": float(len(slices.dropped)),
            "perhaps_features": float(sum(one.may_be_feature for one in slices.dropped)),
            "suspicious": float(len(self.feature_candidates)),
            "outlying_points": float(self.outliers),
            "gaping": float(sum(_gapes(loop) for loop in slices.loops)),
            "tilted": float(slices.tilted.sum()),
            "not_starlike": float((~are_nearly_star_shaped(away)).sum()),
            "self_intersecting": float(slices.self_intersecting.sum()),
        }

    def more(self, contour: ArrayLike, height: float | None = None) -> Evidence:
        """The evidence with one contour of the world more: that of all of them at once."""
        level = None if height is None else [height]
        added = contour_curves([contour], level, len(self.given), self.frame)
        given = (*self.given, *added)
        return gather_curves(given, self.tops, self.contacts, self.noise, self.frame)


def _gapes(loop: ContourCurve) -> bool:
    """Whether much of the way around lies between two points, where others lie close together."""
    steps = np.linalg.norm(np.roll(loop.points, -1, axis=0) - loop.points, axis=1)
    return bool(steps.max() > max(GAPING * steps.sum(), GAPING_STEPS * np.median(steps)))


def gather_curves(
    given: tuple[ContourCurve | DroppedContour, ...],
    tops: Floats | None,
    contacts: ContactPoints | None,
    noise: float | None,
    frame: Floats | None = None,
) -> Evidence:
    """What is known, put in order: contours as curves and tops (k, 3), seen from the frame."""
    slices, bottom, top = _ends(stack_curves(given), tops)
    slices = _in_order(slices)
    reached = [*slices.heights[[0, -1]], *(end for end in (bottom, top) if end is not None)]
    size = max(float(slices.perimeter.max()), float(max(reached) - min(reached)))
    if not LEAST_SIZE <= size <= MOST_SIZE:
        raise ValueError(
            f"contours and tops must span from {LEAST_SIZE:g} to {MOST_SIZE:g}, got {size:g}"
        )
    areas = np.array([signed_area(one) for one in slices.fine])
    # Figures of eight whose halves cancel: nobody can say which way they run.
    none = slices.self_intersecting & (np.abs(areas) < NO_AREA * slices.perimeter**2)
    if none.all():
        raise ValueError("contours must run around an area, got none but figures of eight")
    slices = slices.without(none, "around no area") if none.any() else slices
    matched = _matched(slices)
    if contacts is None:  # else it is not the contours that the surface goes through
        slices, matched = _mended(slices, matched)
    slices, matched, kept = _without_bad(slices, matched)
    off = np.maximum(_misfits(slices, matched), kept)
    feature_candidates = tuple(
        FeatureCandidate(int(slices.rows[row]), float(slices.heights[row]), float(off[row]))
        for row in np.flatnonzero(off)
    )
    return Evidence(
        slices, matched, bottom, top, contacts, noise, given, tops, feature_candidates, frame
    )


def _in_order(slices: Slices) -> Slices:
    """Without contours whose points are in no order; ValueError, which names them, if none is."""
    disordered = np.array([loop.disordered for loop in slices.loops])
    if not disordered.any():
        return slices
    if disordered.all():
        raise ValueError(
            f"contours must hold their points in order around the object, and those of contour "
            f"{slices.rows[0]} are in none that can be told"
        )
    return slices.without(disordered, "its points are in no order")


def _without_bad(slices: Slices, matched: Correspondence) -> tuple[Slices, Correspondence, Floats]:
    """Without contours that neighbours contradict; by how much those are off that stay, (M,)."""
    grid = slide_along_curves(slices.heights, slices.fine, matched.places)
    found = inconsistent_contours(slices.heights, grid)
    if found.bad.any():  # how far curves may be off between points is looked at only then
        uncertain = interpolation_errors(slices.loops)
        found = inconsistent_contours(slices.heights, grid, uncertain)
    if not found.bad.any():
        return slices, matched, np.zeros(len(found.bad))
    perhaps = may_be_features(matched.grid, slices.star, found.bad)
    bad = found.bad if len(perhaps) >= MANY else found.bad & ~perhaps
    kept = np.where(found.bad & ~bad, found.offsets, 0.0)[~bad]
    if bad.any():
        slices = slices.without(bad, "unlike its neighbours", found.offsets, perhaps)
        matched = _matched(slices)
    return slices, matched, kept


def _misfits(slices: Slices, matched: Correspondence) -> Floats:
    """By how much contours (M,) are unlike their neighbours, m; 0 where that is not clear."""
    stack = slices.heights, slices.fine, matched.places
    off = np.zeros(len(slices.heights))
    candidates = [
        neighbour_misfits(slices.heights, one) for one in (matched.grid, slide_along_curves(*stack))
    ]
    for row in np.flatnonzero(np.any(candidates, axis=0)).tolist():
        off[row] = neighbour_misfits(slices.heights, slide_along_curves(*stack, passive=row))[row]
    if off.any():
        off[off <= interpolation_errors(slices.loops)] = 0.0
    return off


def _mended(slices: Slices, matched: Correspondence) -> tuple[Slices, Correspondence]:
    """Without single points that are wrong, which are looked for again once others are mended."""
    for _ in range(PASSES):
        outliers = point_outliers(slices.loops, matched.places)
        same = zip(slices.loops, outliers.masks, strict=True)
        if all(np.array_equal(loop.outlier, mask) for loop, mask in same):
            break
        loops = map(refitted_curve, slices.loops, outliers.mended, outliers.masks)
        slices = restack(tuple(loops), slices.dropped)
        matched = _matched(slices)
    return slices, matched


def _matched(slices: Slices) -> Correspondence:
    usual = int(np.median([len(points) for points in slices.points]))
    return match_slices(slices, min(max(usual, FEWEST), MOST))


def _ends(slices: Slices, tops: Floats | None) -> tuple[Slices, float | None, float | None]:
    """Heights of the touched ends, below and above; contours that are but points tell of them."""
    touched = np.zeros(0) if tops is None else tops[:, 2]
    for row in (0, -1):
        width = np.ptp(slices.fine, axis=1).max(axis=1)
        # A contour that is a point, drawn large by noise.
        if slices.self_intersecting[row] and width[row] < POINT * width.max():
            touched = np.append(touched, slices.heights[row])
            last = np.arange(len(slices.heights)) == np.arange(len(slices.heights))[row]
            slices = slices.without(last, "in one place: a touch of its end")
    low, high = float(slices.heights[0]), float(slices.heights[-1])
    middle = 0.5 * (low + high)
    told = []
    for one in slices.dropped:
        at_end = one.height is not None and not low <= one.height <= high
        if one.why == "in one place" and at_end and one.height is not None:
            touched = np.append(touched, one.height)
            one = one._replace(why="in one place: a touch of its end")
        told.append(one)
    below, above = touched[touched < middle], touched[touched >= middle]
    bottom = float(below.min()) if len(below) else None
    top = float(above.max()) if len(above) else None
    # An end may lie a little inside the last contour, by noise, but not within the contours.
    spacing = float(np.diff(slices.heights)[[0, -1]].min()) if len(slices.heights) > 1 else 0.0
    for end, rim, way in ((bottom, low, -1.0), (top, high, 1.0)):
        if end is not None and way * (end - rim) < -spacing:
            raise ValueError(
                f"tops must not lie within the contours, got {end:g} where the last is at {rim:g}"
            )
    return replace(slices, dropped=tuple(told)), bottom, top
