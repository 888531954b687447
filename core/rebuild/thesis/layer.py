"""One layer of the deformed lattice, of shell and core: Fung, 1999, 4.4.3, corrected."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.plane.angle_between import turn_between
from palpate.core.plane.inscribed_circle import inscribed_circle
from palpate.core.rebuild.thesis.rectangle import rectangle_scale
from palpate.core.splines.curve_least_squares import LEAST_SMOOTHING, fit_closed
from palpate.core.splines.curve_parameters import curve_parameters

MARGIN = 0.95
"""The core's size over the largest that has room: that of the thesis's program."""
NARROW = 0.25
"""Scale of a core in the middle of the box below which a better middle is looked for."""


class Layer(NamedTuple):
    """Control points of one layer."""

    control: Floats
    """(l, m, 2), along s and t."""
    core_scale: float
    """Sides of the core over those of the box around the shell; 0 where it has no room."""
    moved: bool
    """The core is not in the middle of that box, where it would have had little room or none."""
    gap: float
    """Distance between the ends of the curve whose polygon the shell is, over its mean width."""


def make_layer(points: Floats, sides: tuple[int, int]) -> Layer:
    """A layer whose rim is the control polygon of a contour.

    Parameters
    ----------
    points : (k, 2) array
        Of the contour, counter-clockwise, begun where all layers begin.
    sides : two integers
        Control points along s and t, at least 4.

    Notes
    -----
    The polygon is that of a periodic spline, which closes. The core is the largest rectangle
    inside it that has the proportions of the box around it. As printed it is the box around
    the largest such ellipse, the corners of which stand out of a round polygon.
    """
    count = 2 * (sides[0] + sides[1]) - 4
    polygon = _polygon(points, count)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    scale, moved = 0.0, False
    if (half > 0.0).all():
        scale = rectangle_scale(polygon, middle, half)
        if scale < NARROW:
            deepest = inscribed_circle(polygon).middle
            elsewhere = rectangle_scale(polygon, deepest, half)
            if elsewhere > scale:
                middle, scale, moved = deepest, elsewhere, True
    control = np.empty((*sides, 2))
    cells = rim_cells(sides)
    control[cells[:, 0], cells[:, 1]] = np.roll(
        polygon, -nearest_phase(polygon, 0.5 * (low + high), np.array([low[0], high[1]])), axis=0
    )
    reach = MARGIN * scale * half
    x, y = (np.linspace(-1.0, 1.0, side - 2) for side in sides)
    control[1:-1, 1:-1, 0] = middle[0] + reach[0] * x[:, None]
    control[1:-1, 1:-1, 1] = middle[1] + reach[1] * y
    return Layer(control, scale, moved, 0.0)


def rim_cells(sides: tuple[int, int]) -> Ints:
    """Places (n, 2) around a layer's rim, counter-clockwise from its north-west corner."""
    last_s, last_t = sides[0] - 1, sides[1] - 1
    s, t = np.arange(last_s), np.arange(last_t)
    return np.concatenate(
        [
            np.column_stack([0 * t, last_t - t]),
            np.column_stack([s, 0 * s]),
            np.column_stack([0 * t + last_s, t]),
            np.column_stack([last_s - s, 0 * s + last_t]),
        ]
    ).astype(np.int32)


def nearest_phase(polygon: Floats, middle: Floats, corner: Floats) -> int:
    """Which vertex of a polygon (n, 2) lies most nearly in the direction of a corner."""
    turns = turn_between(polygon - middle, np.broadcast_to(corner - middle, polygon.shape))
    return int(np.abs(turns).argmin())


def _polygon(points: Floats, count: int) -> Floats:
    """Control polygon (count, 2) of the periodic cubic nearest to points by (4.27) to (4.30)."""
    apart = (points != np.roll(points, 1, axis=0)).any(axis=1)
    different = points[apart]
    if len(different) < 2:
        return np.repeat(points[:1], count, axis=0)
    return fit_closed(
        different, curve_parameters(different, "chord"), count, LEAST_SMOOTHING
    ).control
