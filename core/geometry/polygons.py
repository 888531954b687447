"""Closed polygons: area, winding, edges, crossings, inscribed circle, matching by azimuth.

`azimuth_match` gives one point for each azimuth also where a ray from the middle meets the contour
several times or not at all, where the match of Fung, 1999, 4.2, step 5, has several or none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry.boxes import overlapping_pairs

CELLS = 12  # Across the longer side of the box around the polygon, at the beginning
TOLERANCE = 1e-3  # Of the longer side: no circle is larger by more
POLISHED = 1e-9  # Of the longer side: steps by which the middle of the best one is moved at last
CELLS_AT_ONCE = 1000  # Cells whose distances are taken together, so that memory stays small
# Middles of a square's quarters, in halves of its side.
CORNERS: Floats = 0.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
# Directions in which the middle is moved.
AROUND: Floats = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(16) / 16])
FLAT = 1e-9  # Area, as a share of the box around the contour, below which it encloses nothing
Numbers = NDArray[np.intp]
LENGTH_SHARE = 0.1  # Of the even pace, mixed in where the azimuth does not always rise
DEEP = 1e-3  # Of the polygon's size: what sees it whole lies so far behind each edge


class Circle(NamedTuple):
    """A circle in the plane."""

    middle: Floats  # (2,), m
    radius: float  # m; 0 where the polygon encloses nothing


def inscribed_circle(polygon: Floats) -> Circle:
    """The largest circle inside a closed polygon (n, 2), m, which need not be convex.

    Raises ValueError if the polygon has fewer than 3 vertices or is not finite. Squares that may
    hold the middle of a larger circle than the best so far are quartered: the distance to the edges
    changes by no more than the way. So it is the largest to 1e-3 of the polygon's size, however
    many local ones there are. Then its middle climbs on by steps to ever nearer places.
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
    parts = np.split(points, range(CELLS_AT_ONCE, len(points), CELLS_AT_ONCE))
    signs = [np.where(winding_number(polygon, part) != 0, 1.0, -1.0) for part in parts]
    distances = [edge_distance(polygon, part) for part in parts]
    return np.asarray(np.concatenate(signs) * np.concatenate(distances))


def area_centroid(contour: Floats) -> Floats:
    """Centroid (2,) of the area that a closed contour encloses, m.

    The mean of unevenly measured points, which stands in where there is no area, lies nearer to
    where they are dense. `contour` (n, 2) or (n, 3): in either direction, m; a third coordinate is
    ignored. Raises ValueError if the contour has no point, or another shape, or is not finite.
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
    return np.asarray(middle + size[:, None] * shift)


def _cross(first: Floats, second: Floats) -> Floats:
    return first[..., 0] * second[..., 1] - second[..., 0] * first[..., 1]


def signed_area(polygon: Floats) -> float:
    """Area of a closed polygon (n, 2), m^2, about a vertex: positive if counter-clockwise.

    Raises ValueError if the polygon has no vertex, or is not finite (n, 2).
    """
    polygon = closed_polygon(polygon)
    near = polygon - polygon[0]
    return 0.5 * float(_cross(near, np.roll(near, -1, axis=0)).sum())


def winding_number(polygon: Floats, points: Floats) -> Ints:
    """Turns (k,) that a closed polygon (n, 2) makes around points (k, 2); 0 outside.

    Positive counter-clockwise. Edges that cross the level of a point to its right are counted, so
    that no angle is ever taken: Sunday, *Inclusion of a point in a polygon*, 2001. Raises
    ValueError if the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, points = closed_polygon(polygon), finite_array("points", points, (None, 2))
    starts, ends = polygon, np.roll(polygon, -1, axis=0)
    left = _cross(ends - starts, points[:, None, :] - starts)
    begins_below = starts[:, 1] <= points[:, 1, None]
    ends_below = ends[:, 1] <= points[:, 1, None]
    up = begins_below & ~ends_below & (left > 0.0)
    down = ~begins_below & ends_below & (left < 0.0)
    return np.asarray((up.sum(axis=1) - down.sum(axis=1)).astype(np.int32))


def edge_distance(polygon: Floats, points: Floats) -> Floats:
    """Distance (k,) of points (k, 2) to the nearest edge of a closed polygon (n, 2), m.

    Raises ValueError if the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, points = closed_polygon(polygon), finite_array("points", points, (None, 2))
    along = np.roll(polygon, -1, axis=0) - polygon
    squares = np.einsum("nd,nd->n", along, along)
    away = points[:, None, :] - polygon
    share = np.einsum("knd,nd->kn", away, along) / np.where(squares > 0.0, squares, 1.0)
    off = away - np.clip(share, 0.0, 1.0)[:, :, None] * along
    return np.asarray(np.sqrt(np.einsum("knd,knd->kn", off, off).min(axis=1)))


def self_intersects(polygon: Floats) -> bool:
    """Whether two edges of a closed polygon (n, 2) cross or touch that are not neighbours.

    Vertices that come twice in a row, as where the first is given again at the end, are one. Raises
    ValueError if the polygon is not finite (n, 2). Edges that follow each other lie together in
    ever larger boxes; only where two boxes overlap are their halves looked at.
    """
    polygon = closed_polygon(polygon, least=0)
    polygon = polygon[(polygon != np.roll(polygon, 1, axis=0)).any(axis=1)]
    if len(polygon) < 4:
        return False
    # In its own size, so that no product of two lengths vanishes or leaves the range.
    polygon = (polygon - polygon[0]) / np.ptp(polygon, axis=0).max()
    following = np.roll(polygon, -1, axis=0)
    count = len(polygon)
    sides = np.minimum(polygon, following), np.maximum(polygon, following)
    for first, second in overlapping_pairs(*sides):
        apart = second - first
        distinct = (apart > 1) & (apart < count - 1)
        a, b = first[distinct], second[distinct]
        if _meet(polygon[a], following[a], polygon[b], following[b]).any():
            return True
    return False


def _meet(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    return (_side(a, b, c) * _side(a, b, d) <= 0.0) & (_side(c, d, a) * _side(c, d, b) <= 0.0)


def _side(a: Floats, b: Floats, point: Floats) -> Floats:
    """1, 0 or -1 (k,): left of, on or right of the line from a to b."""
    return np.sign(_cross(b - a, point - a))


class AzimuthMatch(NamedTuple):
    """Which places on a contour belong to azimuths."""

    points: Floats  # (k, 2), m
    # (k,): the share of the contour's length from its first vertex on, from 0 to 1. Azimuths that
    # rise by less than a turn give turns that do as well, but for the seam.
    turns: Floats
    one_to_one: bool  # Each ray from the middle meets the contour once: the radial match
    # The contour goes once round the middle, counter-clockwise. If not, the azimuth says nothing,
    # and the match is by length alone.
    inside: bool


def azimuth_match(polygon: Floats, middle: Floats, azimuths: Floats) -> AzimuthMatch:
    """Match a contour to azimuths about a middle.

    `polygon` (n, 2): fine, counter-clockwise, m. Raises ValueError if it has fewer than 3 vertices,
    or anything is not finite. Along a concave contour the azimuth rises, falls back, and rises
    again; here it is replaced by the middle between the largest so far and the least still to come.
    """
    polygon = closed_polygon(polygon, least=3)
    middle = finite_array("middle", middle, (2,))
    azimuths = finite_array("azimuths", azimuths, (None,))
    around = np.vstack([polygon, polygon[:1]])
    lengths = np.linalg.norm(np.diff(around, axis=0), axis=1)
    turns = np.concatenate([[0.0], np.cumsum(lengths)])
    turns /= turns[-1] if turns[-1] > 0.0 else 1.0
    away = around - middle
    rises = turn_between(away[:-1], away[1:])
    azimuth = np.arctan2(away[0, 1], away[0, 0]) + np.concatenate([[0.0], np.cumsum(rises)])
    inside = bool(abs(float(rises.sum()) - 2.0 * np.pi) < 1.0)
    one_to_one = inside and bool((rises > 0.0).all())
    pace = _rising(azimuth) if inside else azimuth
    even = 2.0 * np.pi * turns
    # The even pace is begun where it is nearest to the azimuth all around.
    ahead = pace[:-1] - even[:-1]
    even += np.arctan2((lengths * np.sin(ahead)).sum(), (lengths * np.cos(ahead)).sum())
    if not inside:
        pace = even
    elif not one_to_one:
        even += 2.0 * np.pi * np.round((pace - even).mean() / (2.0 * np.pi))
        pace = (1.0 - LENGTH_SHARE) * pace + LENGTH_SHARE * even
    places = np.interp(pace[0] + np.mod(azimuths - pace[0], 2.0 * np.pi), pace, turns)
    points = np.column_stack([np.interp(places, turns, around[:, axis]) for axis in (0, 1)])
    return AzimuthMatch(points, places, one_to_one, inside)


def _rising(azimuth: Floats) -> Floats:
    """The middle of the largest azimuth so far and the least to come, around the seam as well."""
    turn = azimuth[:-1]
    wound = np.concatenate([turn - 2.0 * np.pi, turn, turn + 2.0 * np.pi, azimuth[-1:] + 2 * np.pi])
    so_far = np.maximum.accumulate(wound)
    to_come = np.minimum.accumulate(wound[::-1])[::-1]
    return 0.5 * (so_far + to_come)[len(turn) : 2 * len(turn) + 1]


def closed_polygon(polygon: ArrayLike, least: int = 1) -> Floats:
    """Vertices (n, 2); raises ValueError if they are not finite (n, 2), or fewer than `least`."""
    checked = finite_array("polygon", polygon, (None, 2))
    if len(checked) < least:
        ending = "vertex" if least == 1 else "vertices"
        raise ValueError(f"polygon must have at least {least} {ending}, got {len(checked)}")
    return checked


def kernel_point(polygon: Floats) -> Floats | None:
    """The place (2,) deepest behind all edges of a polygon, m; None if none sees it whole.

    `polygon` (n, 2): counter-clockwise, finite, m. The edges' half planes have the kernel in common
    (Lee and Preparata, *An optimal algorithm for finding the kernel of a polygon*, 1979); here a
    linear programme finds the middle of the largest disc in it.
    """
    from scipy.optimize import linprog

    middle = polygon.mean(axis=0)
    size = float(np.abs(polygon - middle).max())
    if not size > 0.0:
        return None
    corners = (polygon - middle) / size
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    corners, edges = corners[lengths > 0.0], edges[lengths > 0.0]
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[lengths > 0.0, None]
    behind = np.einsum("ni,ni->n", outward, corners)
    rows = np.column_stack([outward, np.ones(len(outward))])
    bounds = [(-1.0, 1.0), (-1.0, 1.0), (DEEP, 2.0)]
    found = linprog([0.0, 0.0, -1.0], A_ub=rows, b_ub=behind, bounds=bounds)
    return None if found.x is None else np.asarray(middle + size * found.x[:2])


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angle (...) above -pi and up to pi from one plane direction (..., 2) to another, rad.

    Positive counter-clockwise; 0 if a direction has no length. By the arc tangent: an arc cosine
    knows nothing of angles below 1e-8. Raises ValueError if a direction is not finite (..., 2).
    """
    first, second = _scaled("first", first), _scaled("second", second)
    along = np.einsum("...d,...d->...", first, second)
    return np.asarray(np.arctan2(_cross(first, second) + 0.0, along))  # of -0 it would be -pi


def _scaled(name: str, direction: ArrayLike) -> Floats:
    """The direction with a largest coordinate of 1, so that no product leaves the range."""
    direction = np.asarray(direction, np.float64)
    if direction.shape[-1:] != (2,):
        raise ValueError(f"{name} must have shape (..., 2), got {direction.shape}")
    if not np.isfinite(direction).all():
        raise ValueError(f"{name} must be finite")
    largest = np.abs(direction).max(axis=-1, keepdims=True)
    return direction / np.where(largest > 0.0, largest, 1.0)


CORNERS.setflags(write=False)


AROUND.setflags(write=False)


def is_simple_ring(points: Floats) -> bool:
    """Whether a closed polygon (n, 2) goes around once and crosses itself nowhere."""
    away = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
    rises = turn_between(away, np.roll(away, -1, axis=0))
    if (rises > 0.0).all() or (rises < 0.0).all():
        return abs(float(rises.sum())) < 3.0 * np.pi
    return not self_intersects(points)
