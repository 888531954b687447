"""What of a slice a pad can touch at all: the truth that gaps are compared with.

Seen along the pad's axis, an object is a field of depths. A rigid face that may stand anywhere
over it reaches down to the field's opening by that face; a pad that yields reaches so much deeper
as it can be compressed. So one cast answers for all places at which the pad may be put.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.path import Gap
from palpate.core.frames import pad_rotation
from palpate.core.touch.pad import Pad
from palpate.launch.tracing_objects import Traced

TURNS = tuple(np.radians(np.arange(-75.0, 76.0, 12.5)).tolist())
"""Azimuths from which a stretch is touched, against the normal of its chord, rad."""
TILTS = tuple(np.radians(np.arange(-60.0, 61.0, 30.0)).tolist())
"""Elevations, rad."""
CELL = 0.75e-3
"""Of the field, m."""
FINE = 0.1e-3
"""Distance of the outline's points that are asked about, m."""
SEEN = 0.1e-3
"""A point is seen that is as far away as the first thing in its way, m."""
FAR, PAST = 0.07, 0.01
"""Rays begin this far before the stretch and end this far past it, m."""


def hidden(target: Traced, pad: Pad, height: float, gap: Gap) -> float:
    """Chord of the longest stretch in a gap that no pose of the pad can touch, m; 0 for none."""
    points = _stretch(target.outline(height), gap)
    reached = np.zeros(len(points), bool)
    chord = points[-1] - points[0]
    heading = math.atan2(-chord[0], chord[1])
    for turn in TURNS:
        for tilt in TILTS:
            open_ = ~reached
            if open_.any():
                axes = pad_rotation(heading + turn, tilt)
                reached[open_] = _touched(target, pad, axes, _at(points[open_], height))
    return _longest(points, ~reached)


def _stretch(outline: Floats, gap: Gap) -> Floats:
    """Points (n, 2) of an outline from a gap's start to its end."""
    first, last = (
        int(np.linalg.norm(outline - end[:2], axis=1).argmin()) for end in (gap.start, gap.end)
    )
    count = (last - first) % len(outline)
    if count > len(outline) // 2:  # on a steep wall the nearest points may change places
        first, count = last, len(outline) - count
    way = np.roll(outline, -first, axis=0)[: count + 1]
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
    even = np.linspace(0.0, length[-1], max(int(length[-1] / FINE), 2))
    return np.column_stack([np.interp(even, length, one) for one in way.T])


def _at(points: Floats, height: float) -> Floats:
    return np.column_stack([points, np.full(len(points), height)])


def _touched(target: Traced, pad: Pad, axes: Floats, points: Floats) -> Bools:
    """Which of some points (n, 3) a pad with these axes can touch, wherever it is put."""
    from scipy.ndimage import grey_dilation, grey_erosion, map_coordinates

    local = points @ axes
    face: Any = -_face(pad)  # the stubs know of whole numbers alone
    margin = CELL * np.array(face.shape[::-1])
    low, high = local.min(axis=0)[:2] - margin, local.max(axis=0)[:2] + margin
    columns, rows = (np.arange(a, b, CELL) for a, b in zip(low, high, strict=True))
    x, y = (grid.ravel() for grid in np.meshgrid(columns, rows))
    before = float(local[:, 2].min()) - FAR
    origins = np.concatenate([np.column_stack([x, y]), local[:, :2]])
    origins = np.column_stack([origins, np.full(len(origins), before)])
    depth = before + target.shape.cast(origins @ axes.T, axes[:, 2], FAR + PAST)
    nothing = before + FAR + PAST
    field = np.minimum(depth[: len(x)].reshape(len(rows), len(columns)), nothing)
    opened = grey_dilation(grey_erosion(field, structure=face), structure=face)
    cells = (local[:, 1::-1] - low[::-1]) / CELL
    floor = map_coordinates(opened, cells.T, order=1, mode="nearest")
    seen = np.abs(depth[len(x) :] - local[:, 2]) < SEEN
    return np.asarray(seen & (local[:, 2] - floor <= pad.saturation * pad.thickness))


def _face(pad: Pad) -> Floats:
    """How far the face falls back behind its middle, on the field's cells, m."""
    y, x = (
        CELL * np.arange(-half, half + 1)
        for half in (int(0.5 * (n - 1) * pad.pitch / CELL) for n in (pad.rows, pad.cols))
    )
    return np.asarray(0.5 * pad.dome * (y[:, None] ** 2 + x**2))


def _longest(points: Floats, hidden: Bools) -> float:
    """Longest chord of a run of hidden points, to the points beside it, m."""
    edges = np.diff(np.concatenate([[False], hidden, [False]]).astype(np.int8))
    firsts: NDArray[np.intp] = np.flatnonzero(edges > 0)
    ends: NDArray[np.intp] = np.flatnonzero(edges < 0)
    last = len(points) - 1
    return max(
        (
            float(np.linalg.norm(points[min(end, last)] - points[max(first - 1, 0)]))
            for first, end in zip(firsts.tolist(), ends.tolist(), strict=True)
        ),
        default=0.0,
    )
