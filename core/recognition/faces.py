"""Plane faces of a surface, from samples of its places and normals.

Repeatedly the plane is taken on which most samples lie, by normal and by offset (as by Schnabel,
Wahl and Klein, *Efficient RANSAC for point-cloud shape detection*, 2007; but the trials are not
random). A strip of a round side lies on a plane as well; but its normals turn steadily over all of
it, while noise turns normals only locally.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceSettings:
    """Which samples lie on a plane, and when they are a plane face."""

    max_distance: float = 8e-4  # [m] of a sample from its plane
    max_angle: float = math.radians(18.0)  # [rad] of a sample's normal from the plane's
    min_face: float = 0.02  # fraction of the area; a smaller face is not counted
    sure_face: float = 0.045  # fraction of the area; a larger face counts fully
    # [rad] steady turn of the normals over a face, root mean square.
    plane_turn: float = math.radians(4.0)  # with less, a face counts fully
    round_turn: float = math.radians(7.5)  # with more, a face is round
    n_trials: int = 300  # planes that are tried
    max_faces: int = 30
    n_refits: int = 3


DEFAULT_FACES = FaceSettings()


class PlaneFaces(NamedTuple):
    """The plane faces of a surface, the largest first, and its round sides."""

    areas: Floats  # (n,) [m2]
    certainty: Floats  # of each being a plane face, (n,), more than 0 and at most 1
    normals: Floats  # outward unit normals, (n, 3)
    round_area: float  # [m2] outside of plane faces, whose areas count by their certainty


def plane_faces(
    points: Floats, normals: Floats, area: float, settings: FaceSettings = DEFAULT_FACES
) -> PlaneFaces:
    """Plane faces of samples (n, 3), even by area [m], with unit normals (n, 3); area in [m2]."""
    count, least = len(points), settings.min_face
    tried = np.linspace(0, count - 1, min(settings.n_trials, count)).astype(int)
    offsets = np.einsum("ni,ni->n", points[tried], normals[tried])
    votes = (normals[tried] @ normals.T > math.cos(settings.max_angle)) & (
        np.abs(normals[tried] @ points.T - offsets[:, None]) < settings.max_distance
    )
    free, faces = np.ones(count, bool), []
    for _ in range(settings.max_faces):
        counts = votes @ free.astype(np.float32)
        best = int(np.argmax(counts))
        if counts[best] < least * count:
            break
        on, normal = _refined(points, normals, votes[best] & free, settings)
        share, turn = float((on & free).mean()), _turn(points[on], normals[on])
        flat = (settings.round_turn - turn) / (settings.round_turn - settings.plane_turn)
        large = (share - least) / (settings.sure_face - least)
        certainty = min(max(flat, 0.0), 1.0) * min(max(large, 0.0), 1.0)
        if certainty > 0.0:
            faces.append((share, certainty, *normal))
        free &= ~on & ~votes[best]
    faces.sort(key=lambda face: -face[0] * face[1])
    table = np.array(faces).reshape(-1, 5)
    areas, certainties = area * table[:, 0], table[:, 1]
    return PlaneFaces(areas, certainties, table[:, 2:5], area - float(areas @ certainties))


def _refined(
    points: Floats, normals: Floats, on: Bools, settings: FaceSettings
) -> tuple[Bools, Floats]:
    """Samples (n,) of bool of a face, and its normal (3,), fitted repeatedly from `on` (n,)."""
    min_cosine = math.cos(settings.max_angle)
    for _ in range(settings.n_refits):
        middle, outwards = points[on].mean(axis=0), normals[on].mean(axis=0)
        normal = np.linalg.eigh(np.cov(points[on].T))[1][:, 0]
        normal = normal if normal @ outwards > 0.0 else -normal
        if normal @ outwards < min_cosine * np.linalg.norm(outwards):  # a strip as wide as thick
            normal = outwards / np.linalg.norm(outwards)
        offset = float(normal @ middle)
        near = np.abs(points @ normal - offset) < settings.max_distance
        refined = (normals @ normal > min_cosine) & near
        if refined.sum() < 3:
            break
        on = refined
    return on, normal


def _turn(points: Floats, normals: Floats) -> float:
    """Root mean square turn of normals that is linear in the place [rad]."""
    centred = points - points.mean(axis=0)
    flat = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    steady = flat @ np.linalg.lstsq(flat, normals - normals.mean(axis=0), rcond=None)[0]
    return float(np.sqrt(np.einsum("ni,ni->n", steady, steady).mean()))
