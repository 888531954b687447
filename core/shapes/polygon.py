"""Plane polygons cut into triangles: fans where they are convex, by ears where not."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints

AREA_TOLERANCE = 1e-6
"""Of a polygon's area. Triangles of a polygon that crosses itself cover another area."""
STRAIGHT = 1e-9
"""Sine of a turn to the right that is rounding."""


def triangulated(vertices: Floats, begins: Ints, corners: Ints, normals: Floats) -> Ints:
    """Triangles of plane polygons, turned as these are.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    begins, corners : arrays
        Where each polygon's corners begin, with the end of the last, and all corners in order.
    normals : (m, 3) array
        The polygons' unit normals, about which they run counter-clockwise.

    Returns
    -------
    (k, 3) array
        Corners of triangles, polygon after polygon; no vertex is added.

    Raises
    ------
    ValueError
        If a polygon crosses itself.
    """
    count = np.diff(begins)
    convex = _convex(vertices, begins, corners, normals)
    fan = np.where(convex, count - 2, 0)
    polygon = np.repeat(np.arange(len(count)), fan)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(fan) - fan, fan)
    first = begins[polygon]
    found = [corners[np.column_stack([first, first + step + 1, first + step + 2])]]
    for face in np.flatnonzero(~convex):
        own = corners[begins[face] : begins[face + 1]]
        found.append(own[_by_ears(vertices[own], normals[face], int(face))])
    return np.concatenate(found).astype(np.int32)


def _convex(vertices: Floats, begins: Ints, corners: Ints, normals: Floats) -> Bools:
    """Whether each polygon turns left at every corner, once around in all."""
    after = np.arange(len(corners)) + 1
    after[begins[1:] - 1] = begins[:-1]
    places = vertices[corners]
    side = places[after] - places
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    normal = np.repeat(normals, np.diff(begins), axis=0)
    sine = np.einsum("ni,ni->n", np.cross(side, side[after]), normal)
    cosine = np.einsum("ni,ni->n", side, side[after])
    turn = np.add.reduceat(np.arctan2(sine, cosine), begins[:-1])
    lefts = np.minimum.reduceat(sine, begins[:-1]) >= -STRAIGHT
    return np.asarray(lefts & (turn < 3.0 * np.pi))


def _by_ears(places: Floats, normal: Floats, face: int) -> Ints:
    """Triangles (n - 2, 3) of one polygon by its own corners' numbers."""
    import manifold3d

    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(normal)))] = 1.0
    across = np.cross(axis, normal)
    across /= np.linalg.norm(across)
    flat = places @ np.column_stack([across, np.cross(normal, across)])
    triangles = np.asarray(manifold3d.triangulate([flat]), np.int32)
    a, b, c = flat[triangles].transpose(1, 0, 2)
    covered = 0.5 * np.abs(_cross(b - a, c - a)).sum()
    area = 0.5 * float(_cross(flat, np.roll(flat, -1, axis=0)).sum())
    if abs(covered - area) > AREA_TOLERANCE * abs(area) or len(triangles) != len(flat) - 2:
        raise ValueError(f"faces[{face}] crosses itself; its corners must go around it once")
    return triangles


def _cross(first: Floats, second: Floats) -> Floats:
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
