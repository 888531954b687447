"""Meshes of sections swept along an axis, with an edge wherever the surface has one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.piecewise import PiecewiseCubic
from palpate.core.shapes.protocol import Mesh

LEAST_AROUND = 8
SIDE_RINGS, CAP_RINGS = 3 / 8, 1 / 8
"""For each point of a ring; those of one plane end."""


def profile_mesh(
    outline: Callable[[int], Floats], scale: PiecewiseCubic, shear: Floats, level: int
) -> Mesh:
    """A swept section, closed by plane ends.

    Parameters
    ----------
    outline : function
        Gives that many points (n, 2) around the section, m.
    scale : PiecewiseCubic
        Scale of the section along the axis; 0 at an end is an apex, else the end is a plane.
    shear : (3, 3) array
        From the upright solid to the wanted one.
    level : int
        Each has four times the faces of the one before: 80,000 for level 6.
    """
    around = max(2 ** (level + 2), LEAST_AROUND)
    size, height = _profile(scale, int(SIDE_RINGS * around), int(CAP_RINGS * around))
    figure = outline(around)
    inner = np.concatenate(
        [size[1:-1, None, None] * figure,
         np.broadcast_to(height[1:-1, None, None], (len(size) - 2, around, 1))], axis=2
    )  # fmt: skip
    poles = np.array([[0.0, 0.0, height[0]], [0.0, 0.0, height[-1]]])
    vertices = np.concatenate([inner.reshape(-1, 3), poles])
    return Mesh(vertices @ shear.T, _faces(len(size) - 2, around))


def _profile(scale: PiecewiseCubic, rings: int, on_cap: int) -> tuple[Floats, Floats]:
    """Sizes and heights of rings from the lower pole to the upper one, a ring at each knot."""
    knots = scale.knots
    # As many parts of each piece as it is long, and at least one.
    parts = np.maximum(np.rint(rings * np.diff(knots) / np.ptp(knots)), 1).astype(int)
    piece = np.repeat(np.arange(len(parts), dtype=np.int32), parts)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    height = knots[piece] + np.diff(knots)[piece] * within / parts[piece]
    size = scale.at(height, piece)[0]
    end = scale.at(knots[-1:], scale.piece(knots[-1:]))[0]
    size, height = np.append(size, end), np.append(height, knots[-1])
    share = np.arange(on_cap) / on_cap
    low = share * size[0] if size[0] > 0.0 else np.zeros(0)
    high = share[::-1] * size[-1] if size[-1] > 0.0 else np.zeros(0)
    return (
        np.concatenate([low, size, high]),
        np.concatenate([np.full(len(low), knots[0]), height, np.full(len(high), knots[-1])]),
    )


def _faces(rings: int, around: int) -> Ints:
    """Triangles of rings, then two poles; counter-clockwise seen from outside."""
    here = np.arange(around)
    after = (here + 1) % around
    low, high = rings * around, rings * around + 1
    first = (rings - 1) * around
    begin = (np.arange(rings - 1) * around)[:, None]
    a, b = (begin + here).ravel(), (begin + after).ravel()
    faces = [
        np.column_stack([np.full(around, low), after, here]),
        np.column_stack([a, b, b + around]),
        np.column_stack([a, b + around, a + around]),
        np.column_stack([first + here, first + after, np.full(around, high)]),
    ]
    return np.concatenate(faces).astype(np.int32)
