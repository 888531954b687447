"""Closed polygons: area, centroid, winding, edges, crossings, inscribed circle and ellipse."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array

CELLS = 12  # Across the longer side of the box around the polygon, at the beginning
TOLERANCE = 1e-3  # Of the longer side: no circle is larger by more
POLISHED = 1e-9  # Of the longer side: steps by which the middle of the best one is moved at last
CELLS_AT_ONCE = 1000  # Cells whose distances are taken together, so that memory stays small
# Middles of a square's quarters, in halves of its side.
CORNERS: Floats = 0.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
# Directions in which the middle is moved.
AROUND: Floats = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(16) / 16])
CORNERS.setflags(write=False)
AROUND.setflags(write=False)
FLAT = 1e-9  # Area, as a share of the box around the contour, below which it encloses nothing
Numbers = NDArray[np.intp]
Boxes = Floats  # Left, lower, right and upper sides, (4, k)
FIRST_BOXES = 32  # At most so many boxes are compared each with each
PAIRS_AT_ONCE = 1 << 15  # Pairs of boxes that are looked at together, so that memory stays small


class Circle(NamedTuple):
    """A circle in the plane."""

    middle: Floats  # (2,), m
    radius: float  # m; 0 where the polygon encloses nothing


def inscribed_circle(polygon: Floats) -> Circle:
    """The largest circle inside a closed polygon (n, 2), m, which need not be convex.

    Its middle is inside where that of the box, or of the area, is not: in a U or a C.

    Raises ValueError if the polygon has fewer than 3 vertices or is not finite.

    Squares that may hold the middle of a larger circle than the best one so far are quartered:
    the distance to the edges changes by no more than the way. So the result is the largest
    one to a tolerance of 1e-3 of the polygon's size, however many local ones there are. Then
    its middle climbs on by steps to ever nearer places.
    """
    polygon = closed_polygon(polygon, least=3)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    size = float((high - low).max())
    best = Circle(0.5 * (low + high), 0.0)
    if size == 0.0:
        return best
    around = (polygon - best.middle) / size
    side = 1.0 / CELLS
    steps = [np.arange(np.ceil(extent / (size * side)) + 1) for extent in high - low]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = (grid - 0.5 * grid.max(axis=0)) * side
    found = Circle(np.zeros(2), 0.0)
    while len(cells):
        depth = _depth(around, cells)
        deepest = int(np.argmax(depth))
        if depth[deepest] > found.radius:
            found = Circle(cells[deepest], float(depth[deepest]))
        promising = depth + np.sqrt(0.5) * side > found.radius + TOLERANCE
        side *= 0.5
        cells = (cells[promising][:, None, :] + side * CORNERS).reshape(-1, 2)
    found = _polish(around, found, TOLERANCE)
    return Circle(best.middle + size * found.middle, size * found.radius)


def _polish(polygon: Floats, circle: Circle, step: float) -> Circle:
    """The circle, moved to where no place around it is deeper."""
    while step > POLISHED:
        near = circle.middle + step * AROUND
        depth = _depth(polygon, near)
        deepest = int(np.argmax(depth))
        if depth[deepest] > circle.radius:
            circle = Circle(near[deepest], float(depth[deepest]))
        else:
            step *= 0.5
    return circle


def _depth(polygon: Floats, points: Floats) -> Floats:
    """Distance (k,) to the edges, negative outside."""
    parts = [
        points[first : first + CELLS_AT_ONCE] for first in range(0, len(points), CELLS_AT_ONCE)
    ]
    return np.concatenate(
        [
            np.where(winding_number(polygon, part) != 0, 1.0, -1.0) * edge_distance(polygon, part)
            for part in parts
        ]
    )


def inscribed_ellipse_scale(polygon: Floats, middle: Floats, semi_axes: Floats) -> float:
    """The largest factor of an ellipse's semi-axes for which it lies inside a polygon.

    `polygon` (n, 2): closed, need not be convex, m. `middle` (2,): centre of the ellipse, m.
    `semi_axes` (2,): along x and y, m. Returns 1; 0 where the middle is not inside. Raises
    ValueError if a shape is wrong, a number not finite, or a semi-axis not positive.

    In the plane in which the ellipse is the unit circle this is the distance of its middle
    from the polygon's edges: the answer to the search of Fung, 1999, table 4.2, which also
    tests the edges as if they were infinite lines.
    """
    polygon = finite_array("polygon", polygon, (None, 2))
    middle = finite_array("middle", middle, (2,))
    semi_axes = finite_array("semi_axes", semi_axes, (2,))
    if not (semi_axes > 0.0).all():
        raise ValueError(f"semi_axes must be positive, got {semi_axes.tolist()} m")
    around = (polygon - middle) / semi_axes
    origin = np.zeros((1, 2))
    if winding_number(around, origin)[0] == 0:
        return 0.0
    return float(edge_distance(around, origin)[0])


def area_centroid(contour: Floats) -> Floats:
    """Centroid (2,) of the area that a closed contour encloses, m.

    Of the area, because the mean of unevenly measured points lies nearer to where they are dense;
    where there is no area, that mean.

    `contour` (n, 2) or (n, 3): around it, in either direction, m; a third coordinate is ignored.
    Raises ValueError if the contour has no point, or is not finite (n, 2) or (n, 3).
    """
    polygon = closed_polygon(np.asarray(contour)[..., :2])
    return np.asarray(area_centroids(polygon[None])[0])


def area_centroids(contours: Floats) -> Floats:
    """The same of many contours (m, n, 2) of finite points at once, (m, 2)."""
    middle = contours.mean(axis=1)
    near = contours - middle[:, None]
    size = np.abs(near).max(axis=(1, 2))
    size = np.where(size > 0.0, size, 1.0)
    near = near / size[:, None, None]
    following = np.roll(near, -1, axis=1)
    first = near[:, :1]  # areas are taken about it, for digits
    twice = _cross(near - first, following - first)
    area = 0.5 * twice.sum(axis=1)
    flat = np.abs(area) <= FLAT * np.prod(np.ptp(near, axis=1), axis=1)
    shift = ((near + following) * _cross(near, following)[..., None]).sum(axis=1)
    safe = np.where(flat, 1.0, area)
    shift = np.where(flat[:, None], 0.0, shift / (6.0 * safe)[:, None])
    centroids: Floats = middle + size[:, None] * shift
    return centroids


def _cross(first: Floats, second: Floats) -> Floats:
    return first[..., 0] * second[..., 1] - second[..., 0] * first[..., 1]


def signed_area(polygon: Floats) -> float:
    """Area of a closed polygon (n, 2), m^2: positive where it runs counter-clockwise.

    About its first vertex, so that a small polygon far from the origin keeps its digits.

    Raises ValueError if the polygon has no vertex, or is not finite (n, 2).
    """
    polygon = closed_polygon(polygon)
    near = polygon - polygon[0]
    following = np.roll(near, -1, axis=0)
    twice = near[:, 0] * following[:, 1] - following[:, 0] * near[:, 1]
    return 0.5 * float(twice.sum())


def winding_number(polygon: Floats, points: Floats) -> Ints:
    """Turns (k,) that a closed polygon (n, 2) makes around points (k, 2); 0 outside.

    Positive counter-clockwise. Edges that cross the level of a point to its right are counted,
    so that no angle is ever taken: Sunday, *Inclusion of a point in a polygon*, 2001.

    Raises ValueError if the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, points = closed_polygon(polygon), finite_array("points", points, (None, 2))
    starts, ends = polygon, np.roll(polygon, -1, axis=0)
    along = ends - starts
    away = points[:, None, :] - starts
    left = along[:, 0] * away[:, :, 1] - along[:, 1] * away[:, :, 0]
    begins_below = starts[:, 1] <= points[:, 1, None]
    ends_below = ends[:, 1] <= points[:, 1, None]
    up = begins_below & ~ends_below & (left > 0.0)
    down = ~begins_below & ends_below & (left < 0.0)
    turns: Ints = (up.sum(axis=1) - down.sum(axis=1)).astype(np.int32)
    return turns


def edge_distance(polygon: Floats, points: Floats) -> Floats:
    """Distance (k,) of points (k, 2) to the nearest edge of a closed polygon (n, 2), m.

    To the edges, not to the lines that they lie on.

    Raises ValueError if the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, points = closed_polygon(polygon), finite_array("points", points, (None, 2))
    along = np.roll(polygon, -1, axis=0) - polygon
    squares = np.einsum("nd,nd->n", along, along)
    away = points[:, None, :] - polygon
    share = np.einsum("knd,nd->kn", away, along) / np.where(squares > 0.0, squares, 1.0)
    off = away - np.clip(share, 0.0, 1.0)[:, :, None] * along
    distance: Floats = np.sqrt(np.einsum("knd,knd->kn", off, off).min(axis=1))
    return distance


def self_intersects(polygon: Floats) -> bool:
    """Whether two edges of a closed polygon (n, 2) cross or touch that are not neighbours.

    Vertices that come twice in a row, as where the first is given again at the end, are one.

    Raises ValueError if the polygon is not finite (n, 2).

    Edges that follow each other lie together in ever larger boxes; only where two boxes
    overlap are their halves looked at.
    """
    polygon = closed_polygon(polygon, least=0)
    polygon = polygon[(polygon != np.roll(polygon, 1, axis=0)).any(axis=1)]
    if len(polygon) < 4:
        return False
    # In its own size, so that no product of two lengths vanishes or leaves the range.
    polygon = (polygon - polygon[0]) / np.ptp(polygon, axis=0).max()
    following = np.roll(polygon, -1, axis=0)
    count = len(polygon)
    for first, second in _near_pairs(polygon, following):
        apart = second - first
        distinct = (apart > 1) & (apart < count - 1)
        a, b = first[distinct], second[distinct]
        if _meet(polygon[a], following[a], polygon[b], following[b]).any():
            return True
    return False


def _near_pairs(starts: Floats, ends: Floats) -> Iterator[tuple[Numbers, Numbers]]:
    """Pairs of edges (k,), (k,) whose boxes overlap, the first never after the second."""
    levels = _boxes(np.vstack([np.minimum(starts, ends).T, np.maximum(starts, ends).T]))
    first, second = np.triu_indices(levels[-1].shape[1])
    waiting = [(len(levels) - 1, first, second)]
    while waiting:
        level, first, second = waiting.pop()
        left, low, right, high = levels[level]
        overlap = (left[first] <= right[second]) & (left[second] <= right[first])
        overlap &= (low[first] <= high[second]) & (low[second] <= high[first])
        first, second = first[overlap], second[overlap]
        if level == 0:
            yield first, second
            continue
        first = 2 * np.repeat(first, 4) + np.tile([0, 0, 1, 1], len(first))
        second = 2 * np.repeat(second, 4) + np.tile([0, 1, 0, 1], len(second))
        there = (first <= second) & (second < levels[level - 1].shape[1])
        first, second = first[there], second[there]
        for begin in range(0, len(first), PAIRS_AT_ONCE):
            part = slice(begin, begin + PAIRS_AT_ONCE)
            waiting.append((level - 1, first[part], second[part]))


def _boxes(edges: Boxes) -> list[Boxes]:
    """Boxes around each edge, around each two of them, each four, and so on."""
    levels = [edges]
    while levels[-1].shape[1] > FIRST_BOXES:
        below = levels[-1]
        if below.shape[1] % 2:  # the last one stands alone
            below = np.hstack([below, below[:, -1:]])
        one, other = below[:, ::2], below[:, 1::2]
        both = np.vstack([np.minimum(one[:2], other[:2]), np.maximum(one[2:], other[2:])])
        levels.append(both)
    return levels


def _meet(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Whether segments ab and cd, (k, 2) each, whose boxes overlap, have a point in common."""
    on_ab = _side(a, b, c) * _side(a, b, d)
    on_cd = _side(c, d, a) * _side(c, d, b)
    return (on_ab <= 0.0) & (on_cd <= 0.0)


def _side(a: Floats, b: Floats, point: Floats) -> Floats:
    """1, 0 or -1 (k,): left of, on or right of the line from a to b."""
    along, away = b - a, point - a
    return np.sign(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])


def closed_polygon(polygon: ArrayLike, least: int = 1) -> Floats:
    """Vertices (n, 2) of a closed polygon, m, once they have been looked at.

    Raises ValueError if they are not finite (n, 2), or fewer than `least`.
    """
    checked = finite_array("polygon", polygon, (None, 2))
    if len(checked) < least:
        ending = "vertex" if least == 1 else "vertices"
        raise ValueError(f"polygon must have at least {least} {ending}, got {len(checked)}")
    return checked
