"""Separation of inner walls and sheets of a mesh from its outer surface.

Around each edge the faces are sorted by angle; consecutive faces bound the same room, so that the
sides of all faces fall into rooms. A face with the same room on both sides, or two closed ones,
bounds nothing (Zhou et al., *Mesh arrangements for solid geometry*, 2016, section 4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import (
    are_outside,
    face_edges,
    linked_groups,
    nearest_points,
    nearest_search,
    signed_volume,
)

Indices = NDArray[np.intp]
PROBE_DIRECTION = np.array([0.36, 0.48, 0.8])  # of the ray through each piece


class OuterSurface(NamedTuple):
    """The faces of a mesh between the outside and a closed room."""

    faces: Ints  # (k, 3), oriented outwards
    walls: int  # number of faces left out, with closed rooms on both sides
    sheets: int  # number of faces left out, with the outside on both sides
    turned: int  # number of reversed faces


def outer_surface(vertices: Floats, faces: Ints) -> OuterSurface:
    """Outer surface of faces (m, 3) of vertices (n, 3) with any number of faces at an edge.

    Holes do not connect rooms: an open edge does not join the two sides of its face.
    """
    count = len(faces)
    first, second, piece_links = _room_links(vertices, faces)
    room = linked_groups(2 * count, first, second)
    piece = linked_groups(count, *piece_links)
    outside = np.zeros(2 * count, bool)
    for number in range(int(piece.max()) + 1):
        side = _outermost_side(vertices, faces, np.flatnonzero(piece == number))
        outside |= room == room[side]
    front, back = outside[:count], outside[count:]
    kept = front != back
    turned = kept & back
    rows = np.where(turned[:, None], faces[:, ::-1], faces)[kept]
    walls, sheets = (~front & ~back).sum(), (front & back).sum()
    return OuterSurface(rows, int(walls), int(sheets), int(turned.sum()))


def loose_walls(vertices: Floats, faces: Ints, tolerance: float) -> Bools:
    """Faces (m,) of open pieces that extend beyond the closed ones by up to `tolerance`."""
    _, _, links = _room_links(vertices, faces)
    piece = linked_groups(len(faces), *links)
    _, edge, counts = face_edges(faces)
    rim = (counts[edge] == 1).any(axis=1)
    opened = np.isin(piece, piece[rim])
    if opened.all() or not opened.any():
        return np.zeros(len(faces), bool)
    shell = faces[~opened]
    shell = shell[:, ::-1] if signed_volume(vertices[shell]) < 0.0 else shell
    corners = vertices[faces[opened]]
    places = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)
    near = nearest_points(nearest_search(vertices[shell]), places.reshape(-1, 3))
    beyond = are_outside(vertices, shell, places.reshape(-1, 3), near)
    beyond &= near.distances > tolerance
    reaching = np.unique(piece[opened][beyond.reshape(-1, 4).any(axis=1)])
    return np.asarray(opened & ~np.isin(piece, reaching))


def _room_links(vertices: Floats, faces: Ints) -> tuple[Indices, Indices, tuple[Indices, Indices]]:
    """Pairs of sides of the same room, and of faces that share an edge.

    Side f is the front of face f, side f + m its back.
    """
    count = len(faces)
    begin, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    key = low * (int(faces.max()) + 1) + high
    third = np.roll(faces, -2, axis=1).ravel()
    _, edge, sizes = np.unique(key, return_inverse=True, return_counts=True)
    order = np.lexsort((_angles(vertices, low, high, third, edge.reshape(-1)), edge.reshape(-1)))
    firsts = np.concatenate([[0], np.cumsum(sizes)])
    following = np.arange(len(order)) + 1
    following[firsts[1:] - 1] = firsts[:-1]
    here, there = order, order[following]
    shared = sizes[edge.reshape(-1)[here]] > 1
    here, there = here[shared], there[shared]
    # A face that passes the edge from its lower corner has its front ahead.
    along = begin == low
    ahead = here // 3 + count * ~along[here]
    behind = there // 3 + count * along[there]
    return ahead, behind, (here // 3, there // 3)


def _angles(vertices: Floats, low: Indices, high: Indices, third: Ints, edge: Indices) -> Floats:
    """Angle (3 m,) of each face around its edge, directed low to high, from the first face."""
    axis = vertices[high] - vertices[low]
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), np.finfo(float).tiny)
    arm = vertices[third] - vertices[low]
    arm -= np.einsum("ni,ni->n", arm, axis)[:, None] * axis
    first = np.zeros(int(edge.max()) + 1, np.intp)
    first[edge[::-1]] = np.arange(len(edge))[::-1]
    zero = arm[first[edge]]
    across = np.cross(axis, zero)
    angle = np.arctan2(np.einsum("ni,ni->n", arm, across), np.einsum("ni,ni->n", arm, zero))
    return np.asarray(angle)


def _outermost_side(vertices: Floats, faces: Ints, piece: Indices) -> int:
    """A side of a piece that faces the outside: the last that a ray through it leaves."""
    corners = vertices[faces[piece]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = normals @ PROBE_DIRECTION
    start = corners[int(np.abs(slope).argmax())].mean(axis=0)
    hit = _are_hit(corners - start, slope)
    height = np.einsum("ni,ni->n", corners[:, 0] - start, normals)
    places = np.where(hit, height / np.where(hit, slope, 1.0), -np.inf)
    last = int(places.argmax())
    return int(piece[last]) + len(faces) * bool(slope[last] < 0.0)


def _are_hit(corners: Floats, slope: Floats) -> Bools:
    """Whether the line through the origin along `PROBE_DIRECTION` meets triangles (n, 3, 3)."""
    following = np.roll(corners, -1, axis=1)
    turns = np.einsum("nij,j->ni", np.cross(corners, following), PROBE_DIRECTION)
    same = (turns >= 0.0).all(axis=1) | (turns <= 0.0).all(axis=1)
    return np.asarray(same & (slope != 0.0))
