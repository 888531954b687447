"""What a solid is rebuilt from: slices, which places of them correspond, and what was touched."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.plane.signed_area import signed_area
from palpate.core.rebuild.correspondence.correspondence import Correspondence, match_slices
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.slices.bad_contours import bad_contours
from palpate.core.rebuild.slices.slices import Slices, slices_of

FEWEST, MOST = 24, 160
"""Places around a contour that are matched: as many as it has points, within these."""
NO_AREA = 1e-6
"""Of the square of its perimeter: a contour that meets itself around less has no inside."""
LEAST_SIZE, MOST_SIZE = 1e-50, 1e50
"""Of what is rebuilt: the fifth power of a length, as in an inertia, must be a number."""


class Evidence(NamedTuple):
    """Everything that is known of an object, lengths in the unit of its contours."""

    slices: Slices
    """The contours that are used, and those that are not, and why."""
    correspondence: Correspondence
    """Which places of them belong together."""
    bottom: float | None
    """Height at which a touch found the lower end."""
    top: float | None
    """Height at which a touch found the upper end."""
    felt: FeltPoints | None
    """All touched taxels."""
    noise: float | None
    """Standard deviation of a coordinate, if it is known."""


def gather(
    contours: Sequence[ArrayLike],
    tops: ArrayLike | None = None,
    *,
    felt: FeltPoints | None = None,
    heights: ArrayLike | None = None,
    noise: float | None = None,
) -> Evidence:
    """Put what was felt in order; parameters and errors as of `reconstruct`."""
    slices = slices_of(contours, heights)
    bottom, top = _touched_ends(tops, slices)
    _check_size(slices, (bottom, top))
    slices = _around_areas(slices)
    matched = _matched(slices)
    found = bad_contours(slices.heights, matched.grid)
    if found.bad.any():
        slices = slices.without(found.bad, "unlike its neighbours")
        matched = _matched(slices)
    return Evidence(slices, matched, bottom, top, felt, noise)


def _matched(slices: Slices) -> Correspondence:
    usual = int(np.median([len(points) for points in slices.points]))
    return match_slices(slices, min(max(usual, FEWEST), MOST))


def _check_size(slices: Slices, ends: tuple[float | None, float | None]) -> None:
    reached = [float(slices.heights[0]), float(slices.heights[-1])]
    reached += [end for end in ends if end is not None]
    size = max(float(slices.perimeter.max()), max(reached) - min(reached))
    if not LEAST_SIZE <= size <= MOST_SIZE:
        raise ValueError(
            f"contours and tops must span from {LEAST_SIZE:g} to {MOST_SIZE:g}, got {size:g}"
        )


def _around_areas(slices: Slices) -> Slices:
    """Without figures of eight whose halves cancel: nobody can say which way they run."""
    areas = np.array([signed_area(one) for one in slices.fine])
    none = slices.self_intersecting & (np.abs(areas) < NO_AREA * slices.perimeter**2)
    if none.all():
        raise ValueError("contours must run around an area, got none but figures of eight")
    return slices.without(none, "around no area") if none.any() else slices


def _touched_ends(tops: ArrayLike | None, slices: Slices) -> tuple[float | None, float | None]:
    """Heights of the touched ends, below and above."""
    if tops is None or (isinstance(tops, list | tuple) and not tops):
        return None, None
    touched: Floats = finite_array("tops", tops, (None, 3))[:, 2]
    middle = 0.5 * float(slices.heights[0] + slices.heights[-1])
    below, above = touched[touched < middle], touched[touched >= middle]
    return (
        float(below.min()) if len(below) else None,
        float(above.max()) if len(above) else None,
    )
