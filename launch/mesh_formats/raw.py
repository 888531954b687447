"""What all readers of meshes share: the result, numbers in text, polygons cut into triangles."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_TRIANGLES = 2_000_000
"""Of a mesh."""
MOST_CORNERS = 1024
"""Of a face; it is cut into triangles about its first one, which suits no rounder ones."""
MOST_VERTICES = 3 * MOST_TRIANGLES
"""Of a mesh: STL repeats each corner for each triangle."""

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class RawMesh(NamedTuple):
    """What a file says, unchecked but for its form."""

    vertices: Floats
    """(n, 3), in the file's unit."""
    faces: Indices
    """(m, 3); none if the file holds points alone."""


class Ragged(NamedTuple):
    """Lists of numbers, end to end."""

    lengths: Indices
    """(n,)."""
    items: NDArray[np.generic]
    """All items of the first list, then all of the second."""


NO_FACES = np.zeros((0, 3), np.int64)


def numbers(text: bytes) -> Floats:
    """All numbers in a text, in which there must be nothing else but blanks.

    Raises
    ------
    ValueError
        If there is something else.
    """
    if not text.strip():  # which numpy takes for a number
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            raise ValueError("has something else where there must be numbers") from None


def doubles(found: NDArray[np.generic]) -> Floats:
    """Numbers in double precision, without a word about those that are none."""
    with np.errstate(invalid="ignore"):
        return found.astype(np.float64)


def check_counts(vertices: int, faces: int) -> None:
    """Refuse a mesh that is too large, or counts that are none.

    Raises
    ------
    ValueError
        If it is.
    """
    if not 0 <= vertices <= MOST_VERTICES:
        raise ValueError(f"states {vertices} vertices; there may be 0 to {MOST_VERTICES}")
    if not 0 <= faces <= MOST_TRIANGLES:
        raise ValueError(f"states {faces} faces; there may be 0 to {MOST_TRIANGLES}")


def triangles(polygons: Ragged) -> Indices:
    """Polygons cut into triangles (m, 3) about their first corners.

    Raises
    ------
    ValueError
        If a polygon has fewer than three corners or far too many, if a corner is no whole number,
        or if there are too many triangles.
    """
    lengths, items = polygons
    if not len(lengths):
        return NO_FACES
    if lengths.min() < 3:
        raise ValueError(f"has a face of {lengths.min()} corners; a face has three or more")
    if lengths.max() > MOST_CORNERS:
        raise ValueError(f"has a face of {lengths.max()} corners; at most {MOST_CORNERS} are read")
    total = len(items) - 2 * len(lengths)
    check_counts(0, total)
    corners = _whole(items)
    cut = lengths - 2
    first = np.repeat(np.cumsum(lengths) - lengths, cut)
    turn = np.arange(total) - np.repeat(np.cumsum(cut) - cut, cut)
    return np.stack([corners[first], corners[first + turn + 1], corners[first + turn + 2]], axis=1)


def _whole(items: NDArray[np.generic]) -> Indices:
    if items.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            found = items.astype(np.int64)
        if not np.array_equal(found, items):
            raise ValueError("has a face with a corner that is no whole number")
        return found
    return items.astype(np.int64)
