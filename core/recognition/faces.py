"""Plane faces of a surface, from samples of its places and normals.

The plane that most samples agree on, by normal and by offset, again and again (as the planes of
Schnabel, Wahl and Klein, *Efficient RANSAC for point-cloud shape detection*, 2007; every trial here
is the same each time). A strip of a round side agrees with a plane as well: it is told by how its
normals turn on from place to place, over all of it, which noise makes them do only here and there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats

NEAR = 8e-4  # m: samples nearer to a plane lie on it, if their normals agree
AGREES = math.cos(math.radians(18.0))
LEAST_FACE, SURE_FACE = 0.02, 0.045  # Of the area: a smaller face is none, a larger one surely is
# Root mean square turn of the normals over a face: less is surely plane, more is round.
PLANE, ROUND = math.radians(4.0), math.radians(7.5)


class PlaneFaces(NamedTuple):
    """The plane faces of a surface, the largest first, and its round sides."""

    areas: Floats  # (n,), m2
    certainty: Floats  # How surely each is a plane face, (n,), more than 0 and at most 1
    normals: Floats  # Outward unit normals, (n, 3)
    round_area: float  # Of what is in no plane face: areas count as they are certain, m2


def plane_faces(points: Floats, normals: Floats, area: float) -> PlaneFaces:
    """Plane faces of samples (n, 3), even by area, m, with unit normals (n, 3); area in m2."""
    count = len(points)
    tried = np.linspace(0, count - 1, min(300, count)).astype(int)  # Planes that are tried
    offsets = np.einsum("ni,ni->n", points[tried], normals[tried])
    votes = (normals[tried] @ normals.T > AGREES) & (
        np.abs(normals[tried] @ points.T - offsets[:, None]) < NEAR
    )
    free, faces = np.ones(count, bool), []
    for _ in range(30):
        counts = votes @ free.astype(np.float32)
        best = int(np.argmax(counts))
        if counts[best] < LEAST_FACE * count:
            break
        on, normal = _refined(points, normals, votes[best] & free)
        share = float((on & free).mean())
        flat = (ROUND - _turn(points[on], normals[on])) / (ROUND - PLANE)
        large = (share - LEAST_FACE) / (SURE_FACE - LEAST_FACE)
        certain = min(max(flat, 0.0), 1.0) * min(max(large, 0.0), 1.0)
        if certain > 0.0:
            faces.append((share, certain, *normal))
        free &= ~on & ~votes[best]
    faces.sort(key=lambda one: -one[0] * one[1])
    table = np.array(faces).reshape(-1, 5)
    areas, certainty = area * table[:, 0], table[:, 1]
    return PlaneFaces(areas, certainty, table[:, 2:5], area - float(areas @ certainty))


def _refined(points: Floats, normals: Floats, on: Bools) -> tuple[Bools, Floats]:
    """Samples of a face and its normal (3,), fitted to those that it began with."""
    for _ in range(3):
        middle, outwards = points[on].mean(axis=0), normals[on].mean(axis=0)
        normal = np.linalg.eigh(np.cov(points[on].T))[1][:, 0]
        normal = normal if normal @ outwards > 0.0 else -normal
        if normal @ outwards < AGREES * np.linalg.norm(outwards):  # a strip: as wide as thick
            normal = outwards / np.linalg.norm(outwards)
        offset = float(normal @ middle)
        again = (normals @ normal > AGREES) & (np.abs(points @ normal - offset) < NEAR)
        if again.sum() < 3:
            break
        on = again
    return on, normal


def _turn(points: Floats, normals: Floats) -> float:
    """How far normals turn steadily with the place, root mean square, rad."""
    away = points - points.mean(axis=0)
    flat = away @ np.linalg.svd(away, full_matrices=False)[2][:2].T
    steady = flat @ np.linalg.lstsq(flat, normals - normals.mean(axis=0), rcond=None)[0]
    return float(np.sqrt(np.einsum("ni,ni->n", steady, steady).mean()))
