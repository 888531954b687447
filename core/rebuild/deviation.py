"""One number for a whole solid: the standard deviation of its surface, ends included.

The side says its own, how much farther than by their noise taxels lie off it, as next to sharp
edges, and where it was not touched, what may bulge there. An end adds what nobody has touched of
it: the edge between the last height that was touched and the end, the end's own height, how far
what touched it lies off it, and, where nobody touched, by how much the object may go on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.closed_sides import ContourSolid
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.ends import End, on_end, straight
from palpate.core.rebuild.loft import SidePatch
from palpate.core.rebuild.radial import POSE_LEFT, SECTORS
from palpate.core.rebuild.surface import Patch

# Places of the side, and of each piece of an end, at which areas are taken.
SIDE_ROWS, END_ROWS, TURNS = 32, 6, 16
# Of the height of an edge that nobody felt: what its rounding may be wrong by, root mean square
# over the edge and as much of the end. With noise, a superellipse taken for an arc errs by that.
HIDES = 0.15
# What a stretch of the side that nobody felt, between two that were, may be wrong by: so much times
# its height to the fourth power over the third power of half the width, as between two ends with
# slopes. Measured on shipped scenes with 5 contours.
BULGES = 0.05
RING, WAYS = 128, 65  # Points of a rim, and places from there to the end


class _Cells(NamedTuple):
    """Cells of a piece of the surface, by rows upwards."""

    heights: Floats  # (a,), m
    areas: Floats  # (a, b), m^2
    steep: Floats  # Part of the normals across the axis, (a, b)


def whole_deviation(closed: ContourSolid, felt: ContactPoints | None) -> float:
    """Standard deviation of the surface along its normal, root mean square over its area, m.

    Parameters
    ----------
    closed : ContourSolid
        Skin and ends.
    felt : ContactPoints or None
        All touched taxels, seen from the slicing frame; those at the ends tell how well the ends
        fit.
    """
    felt = None if felt is None else straight(closed.shear, felt)
    pieces = closed.surface.pieces
    side = next(i for i, piece in enumerate(pieces) if isinstance(piece, SidePatch))
    cells = _cells(pieces[side], SIDE_ROWS)
    low, high = closed.bottom.rim, closed.top.rim
    inside = (cells.heights > low) & (cells.heights < high)
    area = float(cells.areas[inside].sum())
    total = float((cells.areas * np.square(_side_deviation(closed, cells)))[inside].sum())
    total += _of_gaps(closed)
    ends = (
        (closed.bottom, -1.0, pieces[:side], cells.heights <= low),
        (closed.top, 1.0, pieces[side + 1 :], cells.heights >= high),
    )
    for end, way, beyond, rounded in ends:
        covered = float(cells.areas[rounded].sum())
        covered += sum(float(_cells(piece, END_ROWS).areas.sum()) for piece in beyond)
        square, more = _of_end(closed, end, way, covered, felt)
        area, total = area + covered + more, total + square
    return float(np.sqrt(total / area))


def _cells(piece: Patch, count: int) -> _Cells:
    rows = np.repeat((np.arange(count) + 0.5) / count, TURNS)
    turns = np.tile(np.arange(TURNS) / TURNS, count)
    shape = (count, TURNS)
    heights = piece.at(rows, turns)[:, 2].reshape(shape).mean(axis=1)
    normals = np.cross(piece.at(rows, turns, (0, 1)), piece.at(rows, turns, (1, 0)))
    lengths = np.linalg.norm(normals, axis=1)
    steep = np.hypot(normals[:, 0], normals[:, 1]) / np.where(lengths > 0.0, lengths, 1.0)
    return _Cells(heights, (lengths / len(rows)).reshape(shape), steep.reshape(shape))


def _side_deviation(closed: ContourSolid, cells: _Cells) -> Floats:
    """Along the normals at the cells, (a, b), m."""
    deviation = closed.deviation(cells.heights, np.arange(TURNS) / TURNS)
    if closed.felt is None:
        return deviation
    # What was felt is told across the axis; where the side turns level, the poses are left.
    left = np.maximum(cells.steep * deviation, POSE_LEFT * closed.felt.pose_sigma)
    # Taxels that lie farther off than their noise lets them say how far the surface is wrong.
    off = max(closed.felt.rms**2 - closed.felt.sigma**2, 0.0)
    return np.asarray(np.sqrt(left**2 + off))


def _of_gaps(closed: ContourSolid) -> float:
    """Squared deviation times area of what the side may hide where it was not felt, m^4."""
    if closed.felt is None:
        return 0.0
    gaps, half = closed.felt.gaps, closed.skin.size
    bulges = BULGES * gaps * (gaps / half) ** 3
    return float((2.0 * np.pi * half / SECTORS * gaps) @ bulges**2)


def _of_end(
    closed: ContourSolid, end: End, way: float, area: float, felt: ContactPoints | None
) -> tuple[float, float]:
    """Squared deviation times area, m^4, and area that the object may have besides, m^2."""
    ring = closed.skin.at(end.rim, np.arange(RING) / RING)
    around = float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum())
    if end.uncovered > 0.0:
        more = 0.5 * around * end.uncovered
        return (area + more) * end.uncovered**2 / 3.0, more
    unfelt = np.array([end.unseen])
    scatter = closed.skin.health.sigma
    if closed.felt is not None:
        reached = closed.felt.lows if way < 0.0 else closed.felt.highs
        unfelt = np.maximum(way * (end.height - reached), 0.0)
        scatter = float(np.hypot(closed.felt.sigma, closed.felt.pose_sigma))
    hidden = around * float(np.mean(2.0 * unfelt * np.square(HIDES * unfelt)))
    off = 0.0 if felt is None or end.round else _misfit(end, way, ring, felt)
    level = (POSE_LEFT * scatter) ** 2 + max(off**2 - scatter**2, 0.0)
    return hidden + area * level, 0.0


def _misfit(end: End, way: float, ring: Floats, felt: ContactPoints) -> float:
    """How far what touched an end lies off it along the axis, root mean square, m."""
    points = felt.points[on_end(felt, end.rim, way)]
    if not len(points):
        return 0.0
    middle, rim = ring.mean(axis=0), ring - ring.mean(axis=0)
    along = np.clip((points[:, 2] - end.rim) / (end.height - end.rim), 0.0, 1.0)
    away = points[:, :2] - middle - along[:, None] * (end.middle - middle)
    angles = np.arctan2(rim[:, 1], rim[:, 0])
    order = np.argsort(angles)
    radii = np.interp(
        np.arctan2(away[:, 1], away[:, 0]),
        angles[order],
        np.hypot(*rim[order].T),
        period=2.0 * np.pi,
    )
    ways = np.linspace(0.0, 1.0, WAYS)
    shares = np.minimum.accumulate(end.profile.shares(ways))
    share = np.hypot(*away.T) / radii
    reached = np.interp(-share, -shares, ways, right=1.0)
    heights = end.rim + reached * (end.height - end.rim)
    return float(np.sqrt(np.mean((points[:, 2] - heights) ** 2)))
