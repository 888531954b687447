"""How descriptions of one object scatter: copies of it, turned, meshed again, with noisy surfaces.

The noise is a random field that moves every place of space, rough waves over fine ones: however
finely a mesh is cut, its surface is moved alike and crosses itself nowhere. It is made of waves of
random lengths and phases: Rahimi and Recht, *Random features for large-scale kernel machines*,
2007.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.recognition.description import FEATURES, describe, feature_vector
from palpate.core.shapes import Mesh

LEARNED_NOISE = 1.5e-4  # Of the waves across a surface, root mean square, m
ROUGH, FINE = 8e-3, 2e-3  # Correlation lengths of both kinds of waves, m
WAVES = 80  # Of each kind
EDGES = (2.5e-3, 4e-3)  # Longest edge of a copy's mesh, at random between these, m
OFFSET = 2e-4  # By which a surface is moved outwards to see how its description follows, m


class Scatter(NamedTuple):
    """What became of one object's features in its copies."""

    vectors: Floats  # Features of each copy, (n, k)
    slopes: Floats  # Change of the features by how far the surface stands off, (k,), 1/m


def learn_scatter(meshes: Sequence[Mesh], copies: int, seed: int = 0) -> Scatter:
    """Describe so many `copies`, at least 2, of one object's meshes in turns, repeatably."""
    vectors = np.empty((copies, len(FEATURES)))
    for i in range(copies):
        rng = np.random.default_rng((seed, i))
        # Noise makes what is round less so, and may be missing.
        noise = LEARNED_NOISE * (1.0, 1.0, 0.1)[i % 3]
        vectors[i] = feature_vector(describe(*noisy_copy(meshes[i % len(meshes)], rng, noise)))
    finest = refined(meshes[-1], EDGES[1])
    thick, thin = (
        feature_vector(describe(_moved_out(finest, way * OFFSET), finest.faces)) for way in (1, -1)
    )
    return Scatter(vectors, (thick - thin) / (2.0 * OFFSET))


def noisy_copy(
    mesh: Mesh,
    rng: np.random.Generator,
    noise: float = LEARNED_NOISE,
    edges: tuple[float, float] = EDGES,
) -> Mesh:
    """A mesh, cut finer, turned at random, its surface moved by so much, root mean square, m.

    `edges`: the longest edge that is left is between these, m.
    """
    vertices, faces = refined(mesh, rng.uniform(*edges))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = vertices @ turn.T + rng.normal(scale=0.1, size=3)
    rough, fine = _field(moved, ROUGH, rng), _field(moved, FINE, rng)
    return Mesh(moved + noise * (rough + 1.0 / 3.0 * fine), faces)


def _field(places: Floats, length: float, rng: np.random.Generator) -> Floats:
    """A smooth random vector at each place (n, 3), each component with variance 1."""
    waves, phases = rng.normal(size=(3, WAVES)) / length, rng.uniform(0.0, 2.0 * np.pi, WAVES)
    heights = rng.normal(size=(WAVES, 3)) * np.sqrt(2.0 / WAVES)
    return np.asarray(np.cos(places @ waves + phases) @ heights)


def refined(mesh: Mesh, longest: float) -> Mesh:
    """A mesh whose edges are no longer than that, m; longer ones are halved, again and again."""
    vertices, faces = mesh
    while len(faces) < 60_000:  # Of a copy, at most
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
        edges, which = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
        first, last = vertices[edges[:, 0]], vertices[edges[:, 1]]
        long = np.linalg.norm(last - first, axis=1) > longest
        if not long.any():
            break
        middles = np.where(long, len(vertices) + np.cumsum(long) - 1, -1)[which.reshape(-1, 3)]
        vertices = np.concatenate([vertices, 0.5 * (first + last)[long]])
        faces = _split(faces, middles)
    return Mesh(vertices, np.ascontiguousarray(faces, np.int32))


def _split(faces: Ints, middles: Ints) -> Ints:
    """Faces cut at the middles (m, 3) of the edges that begin at their corners; -1 is no cut."""
    cuts = (middles >= 0).sum(axis=1)
    # Turned so that, of one cut, it is the first edge's; of two, the last edge has none.
    first = np.where(cuts == 1, (middles >= 0).argmax(axis=1), 0)
    first = np.where(cuts == 2, ((middles < 0).argmax(axis=1) + 1) % 3, first)
    order = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, order, axis=1).T
    p, q, r = np.take_along_axis(middles, order, axis=1).T
    none, one, two, three = (cuts == count for count in range(4))
    pieces = [
        (none, (a, b, c)), (one, (a, p, c)), (one, (p, b, c)),
        (two, (a, p, c)), (two, (p, q, c)), (two, (p, b, q)),
        (three, (a, p, r)), (three, (p, b, q)), (three, (r, q, c)), (three, (p, q, r)),
    ]  # fmt: skip
    return np.concatenate([np.stack(parts, axis=1)[rows] for rows, parts in pieces])


def _moved_out(mesh: Mesh, way: float) -> Floats:
    """Vertices (n, 3) moved along the mean normals of their faces, m."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(mesh.vertices)
    for corner in mesh.faces.T:
        np.add.at(sums, corner, normals)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(mesh.vertices + way * sums / np.where(length > 0.0, length, 1.0))
