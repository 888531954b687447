"""Contours of any origin as a stack of closed curves, from the lowest to the highest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.plane.angle_between import turn_between
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.rebuild.slices.height_sway import height_sway
from palpate.core.rebuild.slices.same_height import Loop, Reason, rivalry
from palpate.core.splines.closed_curve import ClosedCurve, fit_closed_curve

FINE = 512
"""Places along each curve at which it is compared with others."""
LEAST_POINTS = 3
SAME_HEIGHT = 1e-3
"""Of the mean spacing: contours at heights nearer to each other are one."""
NOT_APART = 1e-9
"""Of a contour's perimeter: heights nearer to each other differ by rounding."""
CERTAIN = 3.0
"""Standard errors of a mean height within which two contours may be at the same one."""
TILTED = 0.25
"""Of the distance to the next slice: a contour that sways farther is not in one plane."""
TILTED_ALONE = 0.02
"""Of the perimeter, where there is no other slice."""


EACH_SLICE = (
    *("heights", "middles", "perimeter", "fine", "star", "self_intersecting"),
    *("tilt", "tilted", "rows"),
)
"""Arrays with a row for each slice."""


class Dropped(NamedTuple):
    """A contour that is not used."""

    which: int
    """Of the given contours."""
    why: Reason


@dataclass(frozen=True, slots=True, eq=False)
class Slices:
    """Closed curves at rising heights: M of them, at least one."""

    heights: Floats
    """(M,), rising: the mean z of each contour's points, m."""
    curves: tuple[ClosedCurve, ...]
    """In the plane, counter-clockwise."""
    middles: Floats
    """(M, 2): centroids of their areas, m."""
    perimeter: Floats
    """(M,), m."""
    fine: Floats
    """(M, FINE, 2): each curve at even steps of its turn, m."""
    star: Bools
    """(M,): each ray from the middle meets the curve once."""
    self_intersecting: Bools
    """(M,): the curve meets itself."""
    tilt: Floats
    """(M,): root mean square by which z rises and falls around the contour, noise apart, m."""
    tilted: Bools
    """(M,): by more than a quarter of the distance to the next slice."""
    points: tuple[Floats, ...]
    """(n, 2) each: what the curves were made from, in their order, m."""
    rows: Ints
    """(M,): which of the given contours each one is."""
    dropped: tuple[Dropped, ...]
    """The given contours that are not among them, and why."""

    def without(self, bad: Bools, why: Reason) -> Slices:
        """The slices but those that are bad, (M,), for a reason.

        Raises
        ------
        ValueError
            If there are not as many as slices, or none stays.
        """
        if bad.shape != self.heights.shape or bad.all():
            raise ValueError(
                f"bad must leave at least one of {len(self.heights)} slices, got {bad.tolist()}"
            )
        stay = np.flatnonzero(~bad)
        left = [Dropped(int(row), why) for row in self.rows[bad]]
        rows = {name: getattr(self, name)[stay] for name in EACH_SLICE}
        return replace(
            self,
            curves=tuple(self.curves[row] for row in stay),
            points=tuple(self.points[row] for row in stay),
            dropped=tuple(sorted([*self.dropped, *left])),
            **rows,
        )


def slices_of(contours: Sequence[ArrayLike], heights: ArrayLike | None = None) -> Slices:
    """Put contours in order.

    Parameters
    ----------
    contours : sequence of (n, 3) arrays
        Points around each contour, z the slicing axis, in any one unit (written m here): begun
        anywhere, in either direction, any number of them, the first again at the end or not.
        Rows that are not finite are left out. With `heights`, (n, 2).
    heights : (len(contours),) array, optional
        z of plane contours, m.

    Returns
    -------
    Slices
        Without contours of fewer than 3 different points, in one place, or on one line. Of
        contours at one height one stays: the better of two that say the same or that cross,
        the outer one of nested ones, the larger of two that lie side by side.

    Raises
    ------
    ValueError
        If a shape is another, a height is not finite, or no contour can be used.
    """
    given = _given(contours, heights)
    dropped: list[Dropped] = []
    loops = []
    for which, points in enumerate(given):
        loop = _loop(which, points)
        if isinstance(loop, Dropped):
            dropped.append(loop)
        else:
            loops.append(loop)
    if not loops:
        found = "; ".join(f"contour {one.which}: {one.why}" for one in dropped) or "none"
        raise ValueError(f"contours must hold at least one of 3 points around an area, got {found}")
    loops, rivals = _one_at_each_height(sorted(loops, key=lambda loop: loop.height))
    dropped.extend(rivals)
    return _stack(loops, tuple(sorted(dropped)))


def _given(contours: Sequence[ArrayLike], heights: ArrayLike | None) -> list[Floats]:
    """The contours as (n, 3) arrays, of their finite rows."""
    if isinstance(contours, str) or not isinstance(contours, Sequence | np.ndarray):
        raise ValueError(f"contours must be a sequence of arrays, got {type(contours).__name__}")
    if not len(contours):
        raise ValueError("contours must be at least one, got none")
    columns = 3 if heights is None else 2
    found = []
    for which, contour in enumerate(contours):
        points = _numbers(which, contour)
        if not points.size:
            points = points.reshape(0, columns)
        if points.ndim != 2 or points.shape[1] != columns:
            raise ValueError(
                f"contour {which} must have shape (any, {columns}), got {points.shape}"
            )
        found.append(points)
    if heights is not None:
        levels = finite_array("heights", heights, (len(found),))
        found = [
            np.column_stack([points, np.full(len(points), level)])
            for points, level in zip(found, levels, strict=True)
        ]
    return [points[np.isfinite(points).all(axis=1)] for points in found]


def _numbers(which: int, contour: ArrayLike) -> Floats:
    try:
        points = np.asarray(contour)
        if np.iscomplexobj(points):
            raise ValueError("complex ones")
        return points.astype(np.float64, copy=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"contour {which} must be an array of real numbers: {error}") from None


def _loop(which: int, points: Floats) -> Loop | Dropped:
    """The closed curve through a contour's points."""
    if len(points) < LEAST_POINTS:
        return Dropped(which, "too few points")
    plane = points[:, :2]
    curve = fit_closed_curve(plane, parameters="even", smoothing=None)
    if curve.flags.self_intersecting:
        # Points that are nearer to each other than their noise make a curve through all loop.
        smooth = fit_closed_curve(plane, parameters="even", smoothing="gcv")
        curve = curve if smooth.flags.self_intersecting else smooth
    if len(curve.used) < LEAST_POINTS:
        return Dropped(which, "in one place" if len(curve.used) == 1 else "too few points")
    if curve.flags.degenerate:
        return Dropped(which, "on one line")
    used = points[curve.used]
    height = float(used[0, 2] + (used[:, 2] - used[0, 2]).mean())
    sway = height_sway(used)
    return Loop(
        which=which,
        height=height,
        curve=curve,
        points=used[:, :2],
        fine=curve.at(np.arange(FINE) / FINE),
        perimeter=curve.length,
        tilt=sway.shape,
        error=sway.noise / float(np.sqrt(len(used))),
    )


def _one_at_each_height(loops: list[Loop]) -> tuple[list[Loop], list[Dropped]]:
    """Those of rising loops that stay, no two at one height, and the others."""
    spacing = (loops[-1].height - loops[0].height) / max(len(loops) - 1, 1)
    kept, dropped = loops[:1], []
    for loop in loops[1:]:
        last = kept[-1]
        near = CERTAIN * float(np.hypot(last.error, loop.error)) + SAME_HEIGHT * spacing
        if loop.height - last.height > max(near, NOT_APART * loop.perimeter):
            kept.append(loop)
            continue
        worse, why = rivalry(last, loop)
        dropped.append(Dropped(worse.which, why))
        if worse is last:
            kept[-1] = loop
    return kept, dropped


def _stack(loops: list[Loop], dropped: tuple[Dropped, ...]) -> Slices:
    fine = np.stack([loop.fine for loop in loops])
    middles = np.stack([area_centroid(loop.fine) for loop in loops])
    heights = np.array([loop.height for loop in loops])
    perimeter = np.array([loop.perimeter for loop in loops])
    tilt = np.array([loop.tilt for loop in loops])
    allowed = TILTED_ALONE * perimeter
    if len(loops) > 1:
        gaps = np.diff(heights)
        allowed = TILTED * np.minimum(np.append(gaps, np.inf), np.append(np.inf, gaps))
    return Slices(
        heights=heights,
        curves=tuple(loop.curve for loop in loops),
        middles=middles,
        perimeter=perimeter,
        fine=fine,
        star=_are_star_shaped(fine - middles[:, None, :]),
        self_intersecting=np.array([loop.curve.flags.self_intersecting for loop in loops]),
        tilt=tilt,
        tilted=tilt > allowed,
        points=tuple(loop.points for loop in loops),
        rows=np.array([loop.which for loop in loops], np.int32),
        dropped=dropped,
    )


def _are_star_shaped(away: Floats) -> Bools:
    """Whether polygons (M, n, 2) are seen from the origin in one turn, always onwards."""
    rises = turn_between(away, np.roll(away, -1, axis=1))
    once = np.abs(rises.sum(axis=1) - 2.0 * np.pi) < 1.0
    star: Bools = once & (rises > 0.0).all(axis=1)
    return star
