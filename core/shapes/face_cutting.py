"""Triangulation of polygons: fans where one corner sees all others, ear clipping elsewhere.

Ears are clipped by the manifold library, in the polygon's own plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.poses import axes_along

Numbers = NDArray[np.integer]
MIN_SINE = 1e-9  # of a turn; a corner that turns less lies on a straight line


def cut_faces(vertices: Floats, lengths: Numbers, corners: Numbers) -> Numbers:
    """Triangles (k, 3) of polygons in space, with their orientation, without degenerate ones.

    `vertices` (n, 3). `lengths` (f,): number of corners of each polygon. `corners`: indices of
    vertices, polygon after polygon. A polygon may be concave, have repeated corners and corners on
    straight lines, and leave its plane, which is that of its area vector, as long as its projected
    outline does not cross itself. Raises ValueError for others; the message continues the mesh's
    name.
    """
    if (lengths == 3).all():
        return corners.reshape(-1, 3)
    lengths, corners, number = _without_repeats(vertices, lengths, corners)
    begins = np.concatenate([[0], np.cumsum(lengths)])
    normals = _area_vectors(vertices, begins, corners)
    apex = _apexes(vertices, begins, corners, normals)
    apex[lengths == 3] = 0
    triangles = [_fans(begins, corners, apex)]
    for face in np.flatnonzero(apex < 0):
        own = corners[begins[face] : begins[face + 1]]
        if not normals[face].any() and _is_line(vertices[own]):
            triangles.append(_fans(np.array([0, len(own)]), own, np.array([0])))
            continue
        ears = _ears(vertices[own], normals[face]) if normals[face].any() else None
        if ears is None:
            raise ValueError(
                f"has a face, number {number[face] + 1}, that lies in no plane or whose outline "
                "crosses itself; its corners must go around it once"
            )
        triangles.append(own[ears])
    return np.concatenate(triangles)


def by_ears(places: Floats, normal: Floats, face: int) -> Numbers:
    """Triangles (n - 2, 3) of one polygon, as indices of its corners.

    `places` (n, 3); `normal` (3,), unit. Raises ValueError with the face's index if it crosses
    itself.
    """
    triangles = _ears(places, normal)
    if triangles is None:
        raise ValueError(f"faces[{face}] crosses itself; its corners must go around it once")
    return triangles


def _ears(places: Floats, normal: Floats, area_tolerance: float = 1e-6) -> Numbers | None:
    """Triangles by ear clipping; None for a polygon that crosses itself: their area differs."""
    import manifold3d

    flat = (places - places[0]) @ axes_along(normal)[:, :2]
    triangles = np.asarray(manifold3d.triangulate([flat]), np.int32).reshape(-1, 3)
    a, b, c = flat[triangles].transpose(1, 0, 2)
    covered = 0.5 * np.abs(_cross(b - a, c - a)).sum()
    area = 0.5 * float(_cross(flat, np.roll(flat, -1, axis=0)).sum())
    fits = abs(covered - area) <= area_tolerance * abs(area) and len(triangles) == len(flat) - 2
    return triangles if fits else None


def _cross(first: Floats, second: Floats) -> Floats:
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _is_line(places: Floats) -> bool:
    away = places - places[0]
    spread = np.linalg.svd(away, compute_uv=False)
    return bool(len(spread) < 2 or spread[1] <= MIN_SINE * spread[0])


def _without_repeats(
    vertices: Floats, lengths: Numbers, corners: Numbers
) -> tuple[Numbers, Numbers, Numbers]:
    """Lengths, corners and indices of the polygons, without consecutive repeated corners."""
    face = np.repeat(np.arange(len(lengths)), lengths)
    begins = np.concatenate([[0], np.cumsum(lengths)])
    before = corners[_before(begins)]
    kept = (vertices[corners] != vertices[before]).any(axis=1) | (np.repeat(lengths, lengths) == 3)
    left = np.bincount(face[kept], minlength=len(lengths))
    whole = left >= 3
    kept &= whole[face]
    return left[whole], corners[kept], np.flatnonzero(whole)


def _before(begins: Numbers) -> Numbers:
    before = np.arange(begins[-1]) - 1
    before[begins[:-1][np.diff(begins) > 0]] = (begins[1:] - 1)[np.diff(begins) > 0]
    return before


def _after(begins: Numbers) -> Numbers:
    """Index of the corner after each, in polygons that begin at `begins` (f + 1,)."""
    after = np.arange(begins[-1]) + 1
    after[begins[1:] - 1] = begins[:-1]
    return after


def _area_vectors(vertices: Floats, begins: Numbers, corners: Numbers) -> Floats:
    """Unit area vectors (f, 3) of polygons, seen from their first corners; 0 without area."""
    if not len(corners):
        return np.zeros((0, 3))
    first = np.repeat(vertices[corners[begins[:-1]]], np.diff(begins), axis=0)
    away = vertices[corners] - first
    following = away[_after(begins)]
    sums = np.add.reduceat(np.cross(away, following), begins[:-1], axis=0)
    size = np.maximum.reduceat(np.einsum("ni,ni->n", away, away), begins[:-1])
    length = np.linalg.norm(sums, axis=1)
    flat = ~(length > MIN_SINE * size)
    return np.asarray(np.where(flat[:, None], 0.0, sums / np.where(flat, 1.0, length)[:, None]))


def _apexes(vertices: Floats, begins: Numbers, corners: Numbers, normals: Floats) -> Numbers:
    """Corner (f,) of each polygon whose fan has no degenerate triangle; -1 without one.

    In a convex polygon it is between two corners that turn, in a concave quadrilateral it is the
    one that turns right.
    """
    if not len(corners):
        return np.zeros(0, np.intp)
    sine, cosine = _turns(vertices, begins, corners, normals)
    turn = np.add.reduceat(np.arctan2(sine, cosine), begins[:-1])
    once = np.abs(turn - 2.0 * np.pi) < np.pi
    after, before = _after(begins), _before(begins)
    length = np.diff(begins)
    convex = np.minimum.reduceat(sine, begins[:-1]) >= -MIN_SINE
    right = sine < -MIN_SINE
    sees = np.where(
        np.repeat(convex, length),
        (np.abs(sine[after]) > MIN_SINE) & (np.abs(sine[before]) > MIN_SINE),
        right & np.repeat(length == 4, length),
    )
    place = np.where(sees, np.arange(len(corners)) - np.repeat(begins[:-1], length), len(corners))
    apex = np.minimum.reduceat(place, begins[:-1])
    valid = once & (apex < len(corners)) & normals.any(axis=1)
    return np.where(valid, apex, -1)


def _turns(
    vertices: Floats, begins: Numbers, corners: Numbers, normals: Floats
) -> tuple[Floats, Floats]:
    """Sine and cosine (c,) of the left turn at each corner of polygons."""
    places = vertices[corners]
    normal = np.repeat(normals, np.diff(begins), axis=0)
    side = places[_after(begins)] - places
    side -= np.einsum("ni,ni->n", side, normal)[:, None] * normal
    length = np.linalg.norm(side, axis=1, keepdims=True)
    side /= np.where(length > 0.0, length, 1.0)
    back = side[_before(begins)]
    sine = np.einsum("ni,ni->n", np.cross(back, side), normal)
    return np.asarray(sine), np.asarray(np.einsum("ni,ni->n", back, side))


def _fans(begins: Numbers, corners: Numbers, apex: Numbers) -> Numbers:
    """Triangles (k, 3) of fans from the apexes (f,) of polygons; none where that is negative."""
    length = np.diff(begins)
    cuts = np.where(apex >= 0, length - 2, 0)
    polygon = np.repeat(np.arange(len(length)), cuts)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(cuts) - cuts, cuts)
    at = [
        corners[begins[polygon] + (apex[polygon] + ahead) % length[polygon]]
        for ahead in (np.zeros_like(step), step + 1, step + 2)
    ]
    return np.stack(at, axis=1)
