"""Standard deviation of the whole surface of a solid, and of its ends.

The deviation of the whole surface is that of the side, which includes the misfit of taxels beyond
their noise and possible bulges where it was not touched. An end adds the edge beyond the last
touched height, the error of its height, the misfit of its contacts, and, if it was not touched, the
height by which the object may extend.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours import ContactPoints, taxel_pitch
from palpate.core.rebuild.ends import End, end_fractions, on_end
from palpate.core.rebuild.side import DEFAULT_ERROR_BOUND, Side
from palpate.core.rebuild.surface import EndPatch, Patch


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviationSettings:
    """Cells over which the deviation is integrated, and the error of untouched edges."""

    n_side_rows: int = 32  # of cells along the side
    n_end_rows: int = 6  # of cells along each piece of an end
    n_turns: int = 16  # cells around
    n_rim: int = 128  # points of a rim
    # Root mean square error of the rounding of an untouched edge, over the edge and an equal width
    # of the end, as a fraction of the edge's height. With noise, a superellipse that is taken for
    # an arc has this error.
    edge_error: float = 0.15


class Deviation(NamedTuple):
    """Standard deviations of a surface along its normal, root mean square over its area [m]."""

    whole: float  # of the whole surface
    ends: float  # contribution of the ends


def whole_deviation(
    pieces: tuple[Patch, ...],
    side: Side,
    ends: tuple[End, End],
    contacts: ContactPoints | None,
    settings: DeviationSettings = DeviationSettings(),
) -> Deviation:
    """Standard deviation of a surface along its normal, root mean square over its area [m].

    It includes noise and untouched edges of the ends; features of untouched parts of the side are
    predicted from slopes and curvatures beside them (`palpate.planning`).
    """
    number = next(i for i, piece in enumerate(pieces) if not isinstance(piece, EndPatch))
    cells = _cells(pieces[number], settings.n_side_rows, settings.n_turns)
    bottom, top = ends
    inside = (cells.heights > bottom.rim) & (cells.heights < top.rim)
    area = float(cells.areas[inside].sum())
    turns = np.arange(settings.n_turns) / settings.n_turns
    deviation = side.normal_deviation(cells.heights, turns, cells.steep)
    total = float((cells.areas * np.square(deviation))[inside].sum())
    parts = (
        (bottom, False, pieces[:number], cells.heights <= bottom.rim),
        (top, True, pieces[number + 1 :], cells.heights >= top.rim),
    )
    of_ends = 0.0
    for end, upper, caps, rounded in parts:
        covered = float(cells.areas[rounded].sum())
        covered += sum(
            float(_cells(cap, settings.n_end_rows, settings.n_turns).areas.sum()) for cap in caps
        )
        square, more = _end_deviation(side, end, upper, covered, contacts, settings)
        area, of_ends = area + covered + more, of_ends + square
    return Deviation(math.sqrt((total + of_ends) / area), math.sqrt(of_ends / area))


def _cells(piece: Patch, n_rows: int, n_turns: int) -> _Cells:
    """Cells of a piece, `n_rows` along and `n_turns` around."""
    v, turns = (np.arange(n_rows) + 0.5) / n_rows, np.arange(n_turns) / n_turns
    heights = piece.on_grid(v, turns)[..., 2].mean(axis=1)
    normals = np.cross(piece.on_grid(v, turns, (0, 1)), piece.on_grid(v, turns, (1, 0)))
    lengths = np.linalg.norm(normals, axis=2)
    steep = np.hypot(normals[..., 0], normals[..., 1]) / np.where(lengths > 0.0, lengths, 1.0)
    return _Cells(heights, lengths / lengths.size, steep)


def _end_deviation(
    side: Side,
    end: End,
    upper: bool,
    area: float,
    contacts: ContactPoints | None,
    settings: DeviationSettings,
) -> tuple[float, float]:
    """Squared deviation times area [m^4], and the area that the object may have besides [m^2]."""
    n_rim = settings.n_rim
    ring = side.patch.rings(np.array([end.rim]), np.arange(n_rim) / n_rim)[0]
    around = float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum())
    if end.uncovered > 0.0:
        more = 0.5 * around * end.uncovered
        return (area + more) * end.uncovered**2 / 3.0, more
    direction, pitch = 1.0 if upper else -1.0, 0.0 if contacts is None else taxel_pitch(contacts)
    untouched = np.maximum(direction * (end.height - side.reached(end.rim, upper)), 0.0)
    untouched = widest_untouched(untouched, around, pitch)
    hidden = around * float(np.mean(2.0 * untouched * np.square(settings.edge_error * untouched)))
    off = 0.0 if contacts is None or end.pointed else _misfit(end, direction, ring, contacts)
    left = DEFAULT_ERROR_BOUND.min_pose_fraction * side.scatter
    level = left**2 + max(off**2 - side.scatter**2, 0.0)
    level += 0.0 if end.relief is None else end.relief.deviation**2
    return hidden + area * level, 0.0


def widest_untouched(lengths: Floats, around: float, pitch: float) -> Floats:
    """Largest widths (n,) [m] of features that fit between touches at even places of a rim.

    `lengths` (n,) [m]: untouched lengths across the rim at these places; `around` [m]: length of
    the rim; `pitch` [m] of the taxels, each of which covers a cell of its width. A feature wider
    than twice the distance to the cell of another place lies there, too, and so is no longer than
    the untouched length there.
    """
    count = len(lengths)
    steps = np.minimum(np.arange(count), count - np.arange(count))
    # From the middle of a sector to the far border of another, on both sides.
    wide = np.where(steps > 0, 2.0 * (steps + 0.5) * around / count - pitch, 0.0)
    shifted = lengths[(np.arange(count)[:, None] + np.arange(count)) % count]
    return np.asarray(np.maximum(wide, shifted).min(axis=1))


def _misfit(end: End, direction: float, ring: Floats, contacts: ContactPoints) -> float:
    """Distance of an end's contacts from it along the axis, root mean square [m]."""
    points = contacts.points[on_end(contacts, end.rim, direction)]
    if not len(points):
        return 0.0
    shares = end_fractions(end, ring, points)[0]
    heights = end.rim + shares * (end.height - end.rim)
    if end.relief is not None:
        heights += shares * end.relief.at(points[:, :2])
    return float(np.sqrt(np.mean((points[:, 2] - heights) ** 2)))


class _Cells(NamedTuple):
    """Cells of a piece of the surface, by rows from below."""

    heights: Floats  # (a,) [m]
    areas: Floats  # (a, b) [m^2]
    steep: Floats  # component of unit normals across the axis, (a, b)
