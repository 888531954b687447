"""How descriptions of one object scatter over copies: turned, meshed again, with noisy surfaces.

The noise is a random field over space, of rough and fine waves, so that meshes of any fineness are
moved alike, and none crosses itself. The waves have random lengths and phases: Rahimi and Recht,
*Random features for large-scale kernel machines*, 2007.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.recognition.description import FEATURES, describe, feature_vector
from palpate.core.shapes import Mesh


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterSettings:
    """How copies of an object differ from it."""

    noise: float = 1.5e-4  # [m] root mean square shift of a surface along its normals
    # Factor of the noise, by the copy in turn: a surface with less noise is rounder.
    noise_factors: tuple[float, ...] = (1.0, 1.0, 0.1)
    rough_length: float = 8e-3  # [m] correlation length of the rough waves
    fine_length: float = 2e-3  # [m] correlation length of the fine waves
    fine_share: float = 1.0 / 3.0  # amplitude of the fine waves over that of the rough ones
    n_waves: int = 80  # of each kind
    edges: tuple[float, float] = (2.5e-3, 4e-3)  # [m] range of a copy's longest edge
    max_faces: int = 60_000  # of a copy
    offset: float = 2e-4  # [m] outwards and inwards, for the slopes of the features


DEFAULT_SCATTER = ScatterSettings()


class Scatter(NamedTuple):
    """Features of one object's copies."""

    vectors: Floats  # features of each copy, (n, k)
    slopes: Floats  # derivative of the features by an offset of the surface, (k,) [1/m]


def learn_scatter(
    meshes: Sequence[Mesh], copies: int, seed: int = 0, settings: ScatterSettings = DEFAULT_SCATTER
) -> Scatter:
    """Describe `copies`, at least 2, of one object's meshes in turn; the same for the same seed."""
    vectors, factors = np.empty((copies, len(FEATURES))), settings.noise_factors
    for i in range(copies):
        rng = np.random.default_rng((seed, i))
        noise = settings.noise * factors[i % len(factors)]
        copy = noisy_copy(meshes[i % len(meshes)], rng, noise, settings=settings)
        vectors[i] = feature_vector(describe(*copy))
    finest = refined(meshes[-1], settings.edges[1], settings.max_faces)
    thick, thin = (
        feature_vector(describe(_moved_out(finest, sign * settings.offset), finest.faces))
        for sign in (1, -1)
    )
    return Scatter(vectors, (thick - thin) / (2.0 * settings.offset))


def noisy_copy(
    mesh: Mesh,
    rng: np.random.Generator,
    noise: float = DEFAULT_SCATTER.noise,
    edges: tuple[float, float] = DEFAULT_SCATTER.edges,
    settings: ScatterSettings = DEFAULT_SCATTER,
) -> Mesh:
    """A refined copy of a mesh in a random pose, its surface shifted by `noise` [m], rms.

    `edges`: range of the copy's longest edge [m].
    """
    vertices, faces = refined(mesh, rng.uniform(*edges), settings.max_faces)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = vertices @ turn.T + rng.normal(scale=0.1, size=3)
    rough = _field(moved, settings.rough_length, settings.n_waves, rng)
    fine = _field(moved, settings.fine_length, settings.n_waves, rng)
    return Mesh(moved + noise * (rough + settings.fine_share * fine), faces)


def _field(places: Floats, length: float, n_waves: int, rng: np.random.Generator) -> Floats:
    """A smooth random vector at each place (n, 3), each component with variance 1."""
    waves, phases = rng.normal(size=(3, n_waves)) / length, rng.uniform(0.0, 2.0 * np.pi, n_waves)
    amplitudes = rng.normal(size=(n_waves, 3)) * np.sqrt(2.0 / n_waves)
    return np.asarray(np.cos(places @ waves + phases) @ amplitudes)


def refined(mesh: Mesh, max_edge: float, max_faces: int = DEFAULT_SCATTER.max_faces) -> Mesh:
    """A mesh with edges of at most `max_edge` [m]; longer ones are halved repeatedly.

    The refinement stops once there are `max_faces` faces or more.
    """
    vertices, faces = mesh
    while len(faces) < max_faces:
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
        edges, which = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
        first, last = vertices[edges[:, 0]], vertices[edges[:, 1]]
        long = np.linalg.norm(last - first, axis=1) > max_edge
        if not long.any():
            break
        middles = np.where(long, len(vertices) + np.cumsum(long) - 1, -1)[which.reshape(-1, 3)]
        vertices = np.concatenate([vertices, 0.5 * (first + last)[long]])
        faces = _split(faces, middles)
    return Mesh(vertices, np.ascontiguousarray(faces, np.int32))


def _split(faces: Ints, middles: Ints) -> Ints:
    """Faces cut at the middles (m, 3) of the edges that begin at their corners; -1 is no cut."""
    cuts = (middles >= 0).sum(axis=1)
    # Rotated so that a single cut is on the first edge, and of two cuts none is on the last.
    first = np.where(cuts == 1, (middles >= 0).argmax(axis=1), 0)
    first = np.where(cuts == 2, ((middles < 0).argmax(axis=1) + 1) % 3, first)
    order = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, order, axis=1).T
    p, q, r = np.take_along_axis(middles, order, axis=1).T
    pieces = [
        (0, (a, b, c)), (1, (a, p, c)), (1, (p, b, c)),
        (2, (a, p, c)), (2, (p, q, c)), (2, (p, b, q)),
        (3, (a, p, r)), (3, (p, b, q)), (3, (r, q, c)), (3, (p, q, r)),
    ]  # fmt: skip
    return np.concatenate([np.stack(parts, axis=1)[cuts == count] for count, parts in pieces])


def _moved_out(mesh: Mesh, distance: float) -> Floats:
    """Vertices (n, 3) moved outwards along the mean normals of their faces [m]."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(mesh.vertices)
    for corner in mesh.faces.T:
        np.add.at(sums, corner, normals)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(mesh.vertices + distance * sums / np.where(length > 0.0, length, 1.0))
