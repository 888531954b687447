"""Nearly even triangulations of the unit sphere."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from palpate.core.arrays import Floats, Ints

MOST_LEVELS = 8
"""1.3 million faces."""


@cache
def icosphere(level: int) -> tuple[Floats, Ints]:
    """Icosahedron, its faces split in four `level` times, on the unit sphere.

    Returns
    -------
    directions : (10 * 4**level + 2, 3) array
        Unit vectors; read-only.
    faces : (20 * 4**level, 3) array
        Counter-clockwise seen from outside; read-only.

    Raises
    ------
    ValueError
        If `level` is not between 0 and 8.
    """
    if not 0 <= level <= MOST_LEVELS:
        raise ValueError(f"level must be between 0 and {MOST_LEVELS}, got {level}")
    directions, faces = _icosahedron()
    for _ in range(level):
        directions, faces = _split(directions, faces)
    directions.setflags(write=False)
    faces.setflags(write=False)
    return directions, faces


def _icosahedron() -> tuple[Floats, Ints]:
    """Poles on the z axis and two rings of five."""
    latitude = math.atan(0.5)
    azimuth = np.arange(5) * (2 * math.pi / 5)
    ring = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * math.cos(latitude)
    turned = azimuth + math.pi / 5
    lower = np.column_stack([np.cos(turned), np.sin(turned)]) * math.cos(latitude)
    height = np.full((5, 1), math.sin(latitude))
    directions = np.concatenate(
        [[[0, 0, 1]], np.hstack([ring, height]), np.hstack([lower, -height]), [[0, 0, -1]]]
    )
    i = np.arange(5)
    after = (i + 1) % 5
    up, low = 1 + i, 6 + i
    up_after, low_after = 1 + after, 6 + after
    faces = np.concatenate(
        [
            np.column_stack([np.zeros(5, int), up, up_after]),
            np.column_stack([up, low, up_after]),
            np.column_stack([low, low_after, up_after]),
            np.column_stack([low, np.full(5, 11), low_after]),
        ]
    )
    return directions, faces.astype(np.int32)


def _split(directions: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Each face into four; the midpoint of an edge is shared by its two faces."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, which = np.unique(edges, axis=0, return_inverse=True)
    middle = directions[unique].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (which.reshape(-1, 3) + len(directions)).T
    a, b, c = faces.T
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    split = np.stack([np.column_stack(corner) for corner in corners], axis=1)
    return np.concatenate([directions, middle]), split.reshape(-1, 3).astype(np.int32)
