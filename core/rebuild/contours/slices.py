"""Contours of any origin as a stack of closed curves, upwards, one at each height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import area_centroids, edge_distance, signed_area, winding_number
from palpate.core.rebuild.contours.curves import (
    ContourCurve,
    DroppedContour,
    DropReason,
    drop_reasons,
)
from palpate.core.splines import ClosedCurve

SAME_HEIGHT = 1e-3  # Of the mean spacing: contours at heights nearer to each other are one
NOT_APART = 1e-9  # Of a contour's perimeter: heights nearer to each other differ by rounding
CERTAIN = 3.0  # Standard errors of a mean height within which two contours may be at the same one
TILTED = 0.25  # Of the distance to the next slice: a contour that sways farther is not in one plane
TILTED_ALONE = 0.02  # Of the perimeter, where there is no other slice
# Arrays with a row for each slice.
EACH_SLICE = (
    *("heights", "middles", "perimeter", "fine", "star", "self_intersecting"),
    *("tilt", "tilted", "rows"),
)
ALIKE = 0.02  # Of the perimeter: curves that are apart by less, root mean square, are one curve
EACH = 8  # Every so many places of a fine curve are compared with the other one


@dataclass(frozen=True, slots=True, eq=False)
class Slices:
    """Closed curves at rising heights: M of them, at least one."""

    heights: Floats  # (M,), rising: the mean z of each contour's points, m
    middles: Floats  # (M, 2): centroids of their areas, m
    perimeter: Floats  # (M,), m
    fine: Floats  # (M, 512, 2): each curve at even steps of its turn, m
    star: Bools  # (M,): each ray from the middle meets the curve once
    self_intersecting: Bools  # (M,): the curve meets itself
    tilt: Floats  # (M,): root mean square rise and fall of z around the contour, noise apart, m
    tilted: Bools  # (M,): by more than a quarter of the distance to the next slice
    loops: tuple[ContourCurve, ...]  # What they are made of
    rows: Ints  # (M,): which of the given contours each one is
    dropped: tuple[DroppedContour, ...]  # The given contours that are not among them, and why

    @property
    def curves(self) -> tuple[ClosedCurve, ...]:
        """In the plane, counter-clockwise."""
        return tuple(loop.curve for loop in self.loops)

    @property
    def points(self) -> tuple[Floats, ...]:
        """(n, 2) each: what the curves were made from, in their order, m."""
        return tuple(loop.points for loop in self.loops)

    def without(
        self,
        bad: Bools,
        why: DropReason,
        off: Floats | None = None,
        may_be_feature: Bools | None = None,
    ) -> Slices:
        """The slices but those that are bad, (M,), for a reason.

        What they are off by and whether they may be right, (M,) each, are for `DroppedContour`.
        Raises ValueError if there are not as many as slices, or none stays.
        """
        if bad.shape != self.heights.shape or bad.all():
            raise ValueError(
                f"bad must leave at least one of {len(self.heights)} slices, got {bad.tolist()}"
            )
        stay = np.flatnonzero(~bad)
        off = np.zeros(len(bad)) if off is None else off
        may_be_feature = np.zeros(len(bad), np.bool_) if may_be_feature is None else may_be_feature
        out = (each[bad].tolist() for each in (self.rows, self.heights, off, may_be_feature))
        left = [
            DroppedContour(which, why, height, far, may)
            for which, height, far, may in zip(*out, strict=True)
        ]
        rows = {name: getattr(self, name)[stay] for name in EACH_SLICE}
        rows |= {"dropped": tuple(sorted([*self.dropped, *left]))}
        return replace(self, loops=tuple(self.loops[row] for row in stay), **rows)


def stack_curves(given: Sequence[ContourCurve | DroppedContour]) -> Slices:
    """Put curves in order.

    Of contours at one height one stays: the better of two that repeat each other or cross, the
    outer one of nested ones, the larger of two that lie side by side. Raises ValueError if there
    is none.
    """
    dropped = [one for one in given if isinstance(one, DroppedContour)]
    loops = [one for one in given if isinstance(one, ContourCurve)]
    if not loops:
        found = drop_reasons(dropped) or "none"
        raise ValueError(f"contours must hold at least one of 3 points around an area, got {found}")
    # Ties are decided by what the contours are like, for the order in which they came must not.
    loops.sort(key=lambda one: (one.height, one.perimeter, len(one.points), float(one.fine[0, 0])))
    loops, rivals = _one_at_each_height(loops)
    return restack(loops, tuple(sorted([*dropped, *rivals])))


def _one_at_each_height(
    loops: list[ContourCurve],
) -> tuple[list[ContourCurve], list[DroppedContour]]:
    """Those of rising curves that stay, no two at one height, and the others."""
    spacing = (loops[-1].height - loops[0].height) / max(len(loops) - 1, 1)
    kept, dropped = loops[:1], []
    for loop in loops[1:]:
        last = kept[-1]
        near = CERTAIN * float(np.hypot(last.error, loop.error)) + SAME_HEIGHT * spacing
        if loop.height - last.height > max(near, NOT_APART * loop.perimeter):
            kept.append(loop)
            continue
        worse, why = duplicate_of_two(last, loop)
        dropped.append(DroppedContour(worse.which, why, worse.height))
        if worse is last:
            kept[-1] = loop
    return kept, dropped


def duplicate_of_two(first: ContourCurve, second: ContourCurve) -> tuple[ContourCurve, DropReason]:
    """Which one of two curves at one height to drop, and why."""

    def worth(loop: ContourCurve) -> tuple[bool, bool, int]:
        flags = loop.curve.flags
        return not flags.self_intersecting, not flags.uneven, len(loop.points)

    smaller, larger = sorted((first, second), key=lambda loop: abs(signed_area(loop.fine)))
    worse = min((second, first), key=worth)
    off = edge_distance(larger.fine, smaller.fine[::EACH])
    if float(np.sqrt((off**2).mean())) <= ALIKE * larger.perimeter:
        return worse, "repeats another at its height"
    inside = winding_number(larger.fine, smaller.fine) != 0
    if inside.all():
        return smaller, "inside another at its height"
    if inside.any() or (winding_number(smaller.fine, larger.fine) != 0).any():
        return worse, "crosses another at its height"
    return smaller, "beside another at its height"


def restack(loops: Sequence[ContourCurve], dropped: tuple[DroppedContour, ...]) -> Slices:
    """The stack of curves at rising heights, and of what was dropped before."""
    fine = np.stack([loop.fine for loop in loops])
    middles = area_centroids(fine)
    heights = np.array([loop.height for loop in loops])
    perimeter = np.array([loop.perimeter for loop in loops])
    tilt = np.array([loop.tilt for loop in loops])
    allowed = TILTED_ALONE * perimeter
    if len(loops) > 1:
        gaps = np.diff(heights)
        allowed = TILTED * np.minimum(np.append(gaps, np.inf), np.append(np.inf, gaps))
    return Slices(
        heights=heights,
        middles=middles,
        perimeter=perimeter,
        fine=fine,
        star=np.array([loop.star for loop in loops]),
        self_intersecting=np.array([loop.curve.flags.self_intersecting for loop in loops]),
        tilt=tilt,
        tilted=tilt > allowed,
        loops=tuple(loops),
        rows=np.array([loop.which for loop in loops], np.int32),
        dropped=dropped,
    )
