"""Evidence that a solid is rebuilt from: slices, their corresponding places, and contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    match_slices,
    may_be_features,
    neighbour_misfits,
    point_outliers,
    refitted_curve,
    restack,
    slide_along_curves,
    stack_curves,
)
from palpate.reprs import readable

MIN_SIZE, MAX_SIZE = 1e-50, 1e50  # of an object: its fifth power must be a finite number


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSettings:
    """How contours are matched and searched for outliers, and which ones are left out."""

    min_places: int = 24  # that are matched around each contour; as many as its points, at least
    max_places: int = 160  # that are matched around each contour
    n_passes: int = 3  # of search for outliers: contours are judged by adjacent ones
    point_width: float = 0.03  # fraction of the widest: a narrower, tangled end contour is a point
    min_area: float = 1e-6  # of a self-intersecting contour, fraction of its squared perimeter
    # Contours from which on one that differs from its neighbours in size alone is left out: then a
    # wrong contour costs more than a missed groove. Among fewer contours it is kept.
    min_contours_to_drop: int = 12


@readable
class Evidence(NamedTuple):
    """All evidence of an object, in the slicing frame and in the unit of its contours."""

    slices: Slices  # contours that are used, and those that are not, and why
    correspondence: Correspondence  # of places around the slices
    bottom: float | None  # height at which a touch found the lower end
    top: float | None  # height at which a touch found the upper end
    contacts: ContactPoints | None  # all touched taxels
    noise: float | None  # standard deviation of a coordinate, if it is known
    given: tuple[ContourCurve | DroppedContour, ...] = ()  # all contours, each by itself
    tops: Floats | None = None  # (k, 3): where single touches found the ends
    feature_candidates: tuple[FeatureCandidate, ...] = ()  # used, though unlike their neighbours
    frame: Floats | None = None  # pose (7,) of the slicing frame; None for the world frame

    @property
    def outliers(self) -> int:
        """Number of single points of the contours that are outliers and not used."""
        return int(sum(loop.outlier.sum() for loop in self.slices.loops))

    def health(self) -> dict[str, float]:
        """Figures of the contours by name, which `LatticeSolid.health` explains."""
        slices = self.slices
        away = slices.fine - slices.middles[:, None]
        return {
            "contours": float(len(slices.heights)),
            "dropped": float(len(slices.dropped)),
            "perhaps_features": float(sum(contour.may_be_feature for contour in slices.dropped)),
            "suspicious": float(len(self.feature_candidates)),
            "outlying_points": float(self.outliers),
            "gaping": float(sum(_has_gap(loop) for loop in slices.loops)),
            "tilted": float(slices.tilted.sum()),
            "not_starlike": float((~are_nearly_star_shaped(away)).sum()),
            "self_intersecting": float(slices.self_intersecting.sum()),
        }

    def more(self, contour: ArrayLike, height: float | None = None) -> Evidence:
        """The evidence with one more contour, in the world frame; the same as of all at once."""
        level = None if height is None else [height]
        added = contour_curves([contour], level, len(self.given), self.frame)
        contours = (*self.given, *added)
        return gather_curves(contours, self.tops, self.contacts, self.noise, self.frame)


def _has_gap(loop: ContourCurve, max_share: float = 0.25, max_ratio: float = 6.0) -> bool:
    """Whether a step between two points is a large share of the perimeter, and of other steps."""
    steps = np.linalg.norm(np.roll(loop.points, -1, axis=0) - loop.points, axis=1)
    return bool(steps.max() > max(max_share * steps.sum(), max_ratio * np.median(steps)))


def gather_curves(
    contours: tuple[ContourCurve | DroppedContour, ...],
    tops: Floats | None,
    contacts: ContactPoints | None,
    noise: float | None,
    frame: Floats | None = None,
    settings: EvidenceSettings = EvidenceSettings(),
) -> Evidence:
    """Evidence from contours as curves, tops (k, 3) and contacts in the frame.

    Outliers of contours are searched only without contacts, for with them the surface is not fitted
    to the contours. Raises ValueError if no contour can be used, or the object is too large or
    small.
    """
    slices, bottom, top = _ends(stack_curves(contours), tops, settings.point_width)
    slices = _with_area(_in_order(slices), bottom, top, settings.min_area)
    matched = _matched(slices, settings)
    if contacts is None:
        slices, matched = _mended(slices, matched, settings)
    slices, matched, kept = _without_bad(slices, matched, settings)
    off = np.maximum(_misfits(slices, matched), kept)
    feature_candidates = tuple(
        FeatureCandidate(int(slices.rows[row]), float(slices.heights[row]), float(off[row]))
        for row in np.flatnonzero(off)
    )
    return Evidence(
        slices, matched, bottom, top, contacts, noise, contours, tops, feature_candidates, frame
    )


def _with_area(slices: Slices, bottom: float | None, top: float | None, min_area: float) -> Slices:
    """The slices without figures of eight whose halves cancel: these have no direction.

    Raises ValueError if none is left, or the object is too large or small.
    """
    reached = [*slices.heights[[0, -1]], *(end for end in (bottom, top) if end is not None)]
    size = max(float(slices.perimeter.max()), float(max(reached) - min(reached)))
    if not MIN_SIZE <= size <= MAX_SIZE:
        raise ValueError(
            f"contours and tops must span from {MIN_SIZE:g} to {MAX_SIZE:g}, got {size:g}"
        )
    areas = np.array([signed_area(fine) for fine in slices.fine])
    empty = slices.self_intersecting & (np.abs(areas) < min_area * slices.perimeter**2)
    if empty.all():
        raise ValueError("contours must run around an area, got none but figures of eight")
    return slices.without(empty, "around no area") if empty.any() else slices


def _in_order(slices: Slices) -> Slices:
    """The slices whose points are in order; ValueError if there are none."""
    disordered = np.array([loop.disordered for loop in slices.loops])
    if not disordered.any():
        return slices
    if disordered.all():
        raise ValueError(
            f"contours must hold their points in order around the object, and those of contour "
            f"{slices.rows[0]} have no certain order"
        )
    return slices.without(disordered, "its points are in no order")


def _without_bad(
    slices: Slices, matched: Correspondence, settings: EvidenceSettings
) -> tuple[Slices, Correspondence, Floats]:
    """Slices without those that contradict their neighbours, and offsets (M,) of those kept."""
    grid = slide_along_curves(slices.heights, slices.fine, matched.places)
    test = inconsistent_contours(slices.heights, grid)
    if test.bad.any():
        uncertain = interpolation_errors(slices.loops)  # which takes long
        test = inconsistent_contours(slices.heights, grid, uncertain)
    if not test.bad.any():
        return slices, matched, np.zeros(len(test.bad))
    may_be_feature = may_be_features(matched.grid, slices.star, test.bad)
    many = len(test.bad) >= settings.min_contours_to_drop
    bad = test.bad if many else test.bad & ~may_be_feature
    kept = np.where(test.bad & ~bad, test.offsets, 0.0)[~bad]
    if bad.any():
        slices = slices.without(bad, "unlike its neighbours", test.offsets, may_be_feature)
        matched = _matched(slices, settings)
    return slices, matched, kept


def _misfits(slices: Slices, matched: Correspondence) -> Floats:
    """How much contours (M,) are unlike their neighbours [m]; 0 where that is not clear."""
    stack = slices.heights, slices.fine, matched.places
    off = np.zeros(len(slices.heights))
    candidates = [
        neighbour_misfits(slices.heights, grid)
        for grid in (matched.grid, slide_along_curves(*stack))
    ]
    for row in np.flatnonzero(np.any(candidates, axis=0)).tolist():
        off[row] = neighbour_misfits(slices.heights, slide_along_curves(*stack, passive=row))[row]
    if off.any():
        off[off <= interpolation_errors(slices.loops)] = 0.0
    return off


def _mended(
    slices: Slices, matched: Correspondence, settings: EvidenceSettings
) -> tuple[Slices, Correspondence]:
    """The slices with outliers moved to predicted places, searched up to `n_passes` times."""
    for _ in range(settings.n_passes):
        outliers = point_outliers(slices.loops, matched.places)
        same = zip(slices.loops, outliers.masks, strict=True)
        if all(np.array_equal(loop.outlier, mask) for loop, mask in same):
            break
        loops = map(refitted_curve, slices.loops, outliers.mended, outliers.masks)
        slices = restack(tuple(loops), slices.dropped)
        matched = _matched(slices, settings)
    return slices, matched


def _matched(slices: Slices, settings: EvidenceSettings) -> Correspondence:
    usual = int(np.median([len(points) for points in slices.points]))
    return match_slices(slices, min(max(usual, settings.min_places), settings.max_places))


def _ends(
    slices: Slices, tops: Floats | None, point_width: float
) -> tuple[Slices, float | None, float | None]:
    """The slices, and the heights of touched ends; an end contour in one place touches its end."""
    touched = np.zeros(0) if tops is None else tops[:, 2]
    for row in (0, -1):
        width = np.ptp(slices.fine, axis=1).max(axis=1)
        # The contour is a point with noise.
        if slices.self_intersecting[row] and width[row] < point_width * width.max():
            touched = np.append(touched, slices.heights[row])
            last = np.arange(len(slices.heights)) == np.arange(len(slices.heights))[row]
            slices = slices.without(last, "in one place: a touch of its end")
    low, high = float(slices.heights[0]), float(slices.heights[-1])
    middle = 0.5 * (low + high)
    dropped = []
    for contour in slices.dropped:
        at_end = contour.height is not None and not low <= contour.height <= high
        if contour.why == "in one place" and at_end and contour.height is not None:
            touched = np.append(touched, contour.height)
            contour = contour._replace(why="in one place: a touch of its end")
        dropped.append(contour)
    below, above = touched[touched < middle], touched[touched >= middle]
    bottom = float(below.min()) if len(below) else None
    top = float(above.max()) if len(above) else None
    # By noise, an end may lie a little within the last contour, but not beyond the one before.
    spacing = float(np.diff(slices.heights)[[0, -1]].min()) if len(slices.heights) > 1 else 0.0
    for end, rim, direction in ((bottom, low, -1.0), (top, high, 1.0)):
        if end is not None and direction * (end - rim) < -spacing:
            raise ValueError(
                f"tops must not lie within the contours, got {end:g} where the last is at {rim:g}"
            )
    return replace(slices, dropped=tuple(dropped)), bottom, top
