"""Closed polygons: area, winding, edges, crossings, inscribed circle, matching by azimuth.

`azimuth_match` gives one point for each azimuth also where a ray from the middle meets the contour
several times or never, where the match of Fung, 1999, 4.2, step 5, has several or none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry.boxes import overlapping_pairs

Numbers = NDArray[np.intp]
# Centres of a square's quarters, in sides of a quarter.
QUARTER_CENTRES: Floats = 0.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
QUARTER_CENTRES.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class InscribedCircleSettings:
    """Search of the largest inscribed circle; lengths are fractions of the box's longer side."""

    n_cells: int = 12  # first squares across the longer side
    tolerance: float = 1e-3  # no circle is larger by more, before the last steps
    last_step: float = 1e-9  # of the circle's middle; shorter steps end the search
    n_directions: int = 16  # of steps of the middle
    block: int = 1000  # squares at once, to limit memory


class Circle(NamedTuple):
    """A circle in the plane."""

    middle: Floats  # (2,) [m]
    radius: float  # [m]; 0 where the polygon encloses nothing


def inscribed_circle(
    polygon: Floats, settings: InscribedCircleSettings = InscribedCircleSettings()
) -> Circle:
    """The largest circle inside a closed polygon (n, 2) [m], which need not be convex.

    Raises ValueError if the polygon has fewer than 3 vertices or is not finite. Squares that may
    contain the middle of a larger circle than the best so far are quartered: the distance to the
    edges changes by no more than the distance moved. So the circle is the global optimum to 1e-3 of
    the polygon's size. Then its middle moves by ever smaller steps.
    """
    polygon = closed_polygon(polygon, least=3)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    size = float((high - low).max())
    best = Circle(0.5 * (low + high), 0.0)
    if size == 0.0:
        return best
    around = (polygon - best.middle) / size
    side = 1.0 / settings.n_cells
    steps = [np.arange(np.ceil(extent / (size * side)) + 1) for extent in high - low]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = (grid - 0.5 * grid.max(axis=0)) * side
    circle = Circle(np.zeros(2), 0.0)
    while len(cells):
        depth = _depth(around, cells, settings.block)
        deepest = int(np.argmax(depth))
        if depth[deepest] > circle.radius:
            circle = Circle(cells[deepest], float(depth[deepest]))
        promising = depth + np.sqrt(0.5) * side > circle.radius + settings.tolerance
        side *= 0.5
        cells = (cells[promising][:, None, :] + side * QUARTER_CENTRES).reshape(-1, 2)
    circle = _refined(around, circle, settings)
    return Circle(best.middle + size * circle.middle, size * circle.radius)


def _refined(polygon: Floats, circle: Circle, settings: InscribedCircleSettings) -> Circle:
    angles = 2 * np.pi * np.arange(settings.n_directions) / settings.n_directions
    directions = np.array([[np.cos(angle), np.sin(angle)] for angle in angles])
    step = settings.tolerance
    while step > settings.last_step:
        near = circle.middle + step * directions
        depth = _depth(polygon, near, settings.block)
        deepest = int(np.argmax(depth))
        if depth[deepest] > circle.radius:
            circle = Circle(near[deepest], float(depth[deepest]))
        else:
            step *= 0.5
    return circle


def _depth(polygon: Floats, points: Floats, block: int) -> Floats:
    """Distances (k,) of points (k, 2) from the edges, negative outside."""
    parts = np.split(points, range(block, len(points), block))
    signs = [np.where(winding_number(polygon, part) != 0, 1.0, -1.0) for part in parts]
    distances = [edge_distance(polygon, part) for part in parts]
    return np.asarray(np.concatenate(signs) * np.concatenate(distances))


def area_centroid(contour: Floats) -> Floats:
    """Centroid (2,) [m] of the area that a closed contour encloses.

    Without area it is the mean of the points, which depends on their density. `contour` (n, 2) or
    (n, 3): in either direction [m]; a third coordinate is ignored. Raises ValueError if the contour
    has no point, or another shape, or is not finite.
    """
    polygon = closed_polygon(np.asarray(contour)[..., :2])
    return np.asarray(area_centroids(polygon[None])[0])


def area_centroids(contours: Floats, min_area: float = 1e-9) -> Floats:
    """Centroids (m, 2) as of `area_centroid`, of contours (m, n, 2) of finite points.

    `min_area`: over the area of the contour's box; a smaller one counts as 0.
    """
    middle = contours.mean(axis=1)
    near = contours - middle[:, None]
    size = np.abs(near).max(axis=(1, 2))
    size = np.where(size > 0.0, size, 1.0)
    near = near / size[:, None, None]
    following = np.roll(near, -1, axis=1)
    first = near[:, :1]  # origin of the areas, for small rounding errors
    twice = _cross(near - first, following - first)
    area = 0.5 * twice.sum(axis=1)
    flat = np.abs(area) <= min_area * np.prod(np.ptp(near, axis=1), axis=1)
    shift = ((near + following) * _cross(near, following)[..., None]).sum(axis=1)
    safe = np.where(flat, 1.0, area)
    shift = np.where(flat[:, None], 0.0, shift / (6.0 * safe)[:, None])
    return np.asarray(middle + size[:, None] * shift)


def _cross(first: Floats, second: Floats) -> Floats:
    return first[..., 0] * second[..., 1] - second[..., 0] * first[..., 1]


def signed_area(polygon: Floats) -> float:
    """Area [m^2] of a closed polygon (n, 2), about a vertex: positive if counter-clockwise.

    Raises ValueError if the polygon has no vertex, or is not finite (n, 2).
    """
    polygon = closed_polygon(polygon)
    near = polygon - polygon[0]
    return 0.5 * float(_cross(near, np.roll(near, -1, axis=0)).sum())


def winding_number(polygon: Floats, points: Floats) -> Ints:
    """Turns (k,) that a closed polygon (n, 2) makes around points (k, 2); 0 outside.

    Positive counter-clockwise. Edges that cross the level of a point to its right are counted,
    without any angle: Sunday, *Inclusion of a point in a polygon*, 2001. Raises ValueError if the
    polygon has no vertex, or an array is not finite or of another shape.
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
    """Distance (k,) [m] of points (k, 2) to the nearest edge of a closed polygon (n, 2).

    Raises ValueError if the polygon has no vertex, or an array is not finite or of another shape.
    """
    polygon, points = closed_polygon(polygon), finite_array("points", points, (None, 2))
    along = np.roll(polygon, -1, axis=0) - polygon
    squares = np.einsum("nd,nd->n", along, along)
    away = points[:, None, :] - polygon
    share = np.einsum("knd,nd->kn", away, along) / np.where(squares > 0.0, squares, 1.0)
    offset = away - np.clip(share, 0.0, 1.0)[:, :, None] * along
    return np.asarray(np.sqrt(np.einsum("knd,knd->kn", offset, offset).min(axis=1)))


def self_intersects(polygon: Floats) -> bool:
    """Whether two edges of a closed polygon (n, 2) that are not neighbours cross or touch.

    Equal consecutive vertices, as a first one repeated at the end, are one. Raises ValueError if
    the polygon is not finite (n, 2). Only edges with overlapping boxes are tested.
    """
    polygon = closed_polygon(polygon, least=0)
    polygon = polygon[(polygon != np.roll(polygon, 1, axis=0)).any(axis=1)]
    if len(polygon) < 4:
        return False
    # Over its own size, so that no product of two lengths underflows or overflows.
    polygon = (polygon - polygon[0]) / np.ptp(polygon, axis=0).max()
    following = np.roll(polygon, -1, axis=0)
    count = len(polygon)
    sides = np.minimum(polygon, following), np.maximum(polygon, following)
    for first, second in overlapping_pairs(*sides):
        gap = second - first
        distinct = (gap > 1) & (gap < count - 1)
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
    """Places on a contour that are matched to azimuths."""

    points: Floats  # (k, 2) [m]
    # (k,): fraction of the contour's length from its first vertex, from 0 to 1. It increases with
    # the azimuth, except at the seam.
    turns: Floats
    one_to_one: bool  # each ray from the middle meets the contour once: the radial match
    # Whether the contour winds once around the middle, counter-clockwise. If not, the match is by
    # length alone.
    inside: bool


def azimuth_match(
    polygon: Floats, middle: Floats, azimuths: Floats, length_weight: float = 0.1
) -> AzimuthMatch:
    """Match a contour to azimuths about a middle.

    `polygon` (n, 2): fine, counter-clockwise [m]. `length_weight`: of the contour's length beside
    the azimuth, where the azimuth is not monotone. Raises ValueError if the polygon has fewer than
    3 vertices, or an array is not finite. Along a concave contour the azimuth rises, falls, and
    rises again; it is replaced by the mean of the running maximum and the remaining minimum.
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
    # The even pace gets the offset nearest to the azimuth in the mean.
    ahead = pace[:-1] - even[:-1]
    even += np.arctan2((lengths * np.sin(ahead)).sum(), (lengths * np.cos(ahead)).sum())
    if not inside:
        pace = even
    elif not one_to_one:
        even += 2.0 * np.pi * np.round((pace - even).mean() / (2.0 * np.pi))
        pace = (1.0 - length_weight) * pace + length_weight * even
    places = np.interp(pace[0] + np.mod(azimuths - pace[0], 2.0 * np.pi), pace, turns)
    points = np.column_stack([np.interp(places, turns, around[:, axis]) for axis in (0, 1)])
    return AzimuthMatch(points, places, one_to_one, inside)


def _rising(azimuth: Floats) -> Floats:
    """Mean of the running maximum and the remaining minimum of the azimuth, across the seam too."""
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


def kernel_point(polygon: Floats, min_depth: float = 1e-3) -> Floats | None:
    """Centre (2,) [m] of the largest disc in a polygon's kernel; None without a kernel.

    `polygon` (n, 2): counter-clockwise, finite [m]. `min_depth`: behind each edge, over the
    polygon's size. The kernel is the intersection of the edges' half planes (Lee and Preparata, *An
    optimal algorithm for finding the kernel of a polygon*, 1979); here by linear programming.
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
    bounds = [(-1.0, 1.0), (-1.0, 1.0), (min_depth, 2.0)]
    solution = linprog([0.0, 0.0, -1.0], A_ub=rows, b_ub=behind, bounds=bounds)
    return None if solution.x is None else np.asarray(middle + size * solution.x[:2])


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angle (...) [rad] above -pi and up to pi from one plane direction (..., 2) to another.

    Positive counter-clockwise; 0 if a direction has no length. By the arc tangent: an arc cosine
    has no digits for angles below 1e-8. Raises ValueError if a direction is not finite (..., 2).
    """
    first, second = _scaled("first", first), _scaled("second", second)
    along = np.einsum("...d,...d->...", first, second)
    return np.asarray(
        np.arctan2(_cross(first, second) + 0.0, along)
    )  # + 0.0: with -0 it would be -pi


def _scaled(name: str, direction: ArrayLike) -> Floats:
    """The direction with a largest coordinate of 1, so that no product overflows."""
    direction = np.asarray(direction, np.float64)
    if direction.shape[-1:] != (2,):
        raise ValueError(f"{name} must have shape (..., 2), got {direction.shape}")
    if not np.isfinite(direction).all():
        raise ValueError(f"{name} must be finite")
    largest = np.abs(direction).max(axis=-1, keepdims=True)
    return direction / np.where(largest > 0.0, largest, 1.0)


def is_simple_ring(points: Floats) -> bool:
    """Whether a closed polygon (n, 2) winds once and does not cross itself."""
    away = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
    rises = turn_between(away, np.roll(away, -1, axis=0))
    if (rises > 0.0).all() or (rises < 0.0).all():
        return abs(float(rises.sum())) < 3.0 * np.pi
    return not self_intersects(points)
