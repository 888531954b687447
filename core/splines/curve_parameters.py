"""Parameters of points along a closed curve, in turns."""

from __future__ import annotations

from typing import Literal

import numpy as np

from palpate.core.arrays import Floats

Parameters = Literal["auto", "chord", "centripetal", "even"]

CORNER = np.pi / 3
"""A point at which the polygon turns farther is a corner, rad."""
MOST_CORNERS = 0.2
"""Of the points: where more of them turn like that, it is noise, not corners."""
EVEN_GAP = 2.0
"""Points at equal distances along a curve have no chord longer than the usual one by this,"""
EVEN_MIDDLE = 1.25
"""and the middle half of their chords within this factor: only across corners are they short."""
MOST_MOVE = 0.45
"""Of the gap to a neighbour: two points that move towards each other do not meet."""


def curve_parameters(points: Floats, kind: Parameters) -> Floats:
    """Parameters (m,) of points (m, d) around a closed curve; the first is 0.

    In proportion to the chords between neighbours, (4.28), or to their square roots, (4.18) of
    Fung, 1999; both with the chord that closes the curve, which the text leaves out. "auto"
    takes square roots where a few of the points are corners: there chords overshoot. "even"
    takes equal steps where the points were felt at equal distances along the curve, which a
    chord across a corner tells too short, and chords otherwise.
    """
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    if kind == "even" and _are_even(chords):
        return np.arange(len(points)) / len(points)
    if kind == "centripetal" or (kind == "auto" and _has_corners(points)):
        chords = np.sqrt(chords)
    ends = np.cumsum(chords)
    parameters: Floats = np.concatenate([[0.0], ends[:-1]]) / ends[-1]
    return parameters


def gap_ratio(points: Floats) -> float:
    """The longest chord of a closed polygon (m, d) over its shortest."""
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    return float(chords.max() / chords.min())


def moved_parameters(parameters: Floats, points: Floats, places: Floats, slopes: Floats) -> Floats:
    """Parameters nearer to those of the curve's nearest points: Fung, 1999, (4.40).

    Each takes the step of (4.40), but never so far that it could meet a neighbour, so that
    the points keep their order around the curve.

    Parameters
    ----------
    parameters : (m,) array
        Increasing, in turns.
    points : (m, d) array
        What the curve should pass.
    places, slopes : (m, d) arrays
        The curve and its derivative at the parameters.
    """
    squares = np.einsum("md,md->m", slopes, slopes)
    wanted = np.einsum("md,md->m", points - places, slopes)
    step = np.divide(wanted, squares, out=np.zeros_like(wanted), where=squares > 0.0)
    ahead = np.diff(parameters, append=parameters[0] + 1.0)
    step = np.clip(step, -MOST_MOVE * np.roll(ahead, 1), MOST_MOVE * ahead)
    moved: Floats = parameters + step
    return moved


def _are_even(chords: Floats) -> bool:
    tenth, quarter, most = np.quantile(chords, [0.1, 0.25, 0.75])
    return bool(chords.max() <= EVEN_GAP * tenth and most <= EVEN_MIDDLE * quarter)


def _has_corners(points: Floats) -> bool:
    back, ahead = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    along = np.einsum("md,md->m", back, ahead)
    lengths = np.linalg.norm(back, axis=1) * np.linalg.norm(ahead, axis=1)
    corners = np.count_nonzero(along < np.cos(CORNER) * lengths)
    return bool(0 < corners <= MOST_CORNERS * len(points))
