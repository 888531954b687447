from __future__ import annotations

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.geometry import nearest_points, nearest_search, solidity
from palpate.core.recognition import FEATURES, LEARNED_NOISE, learn_scatter, noisy_copy
from palpate.core.recognition.scatter import _field, refined

BALL = shapes.Superquadric(np.full(3, 0.04), np.ones(2))
OCTAHEDRON = shapes.Mesh(
    0.05 * np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]),
    np.array(
        [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]],
        np.int32,
    ),
)


@pytest.mark.parametrize("longest", [0.02, 0.0093, 0.004])
def test_a_finer_mesh_is_the_same_surface_with_shorter_edges(longest):
    fine = refined(OCTAHEDRON, longest)
    found, before = solidity(*fine), solidity(*OCTAHEDRON)
    assert (found.watertight, found.genus) == (True, 0)
    assert found.volume == pytest.approx(before.volume, rel=1e-12)
    edges = fine.vertices[fine.faces] - fine.vertices[np.roll(fine.faces, -1, axis=1)]
    assert np.linalg.norm(edges, axis=2).max() <= longest
    corners = OCTAHEDRON.vertices[OCTAHEDRON.faces]
    assert nearest_points(nearest_search(corners), fine.vertices).distances.max() < 1e-15


def test_uneven_meshes_are_cut_conformingly():
    stretched = shapes.Mesh(OCTAHEDRON.vertices * [3.0, 1.0, 0.2], OCTAHEDRON.faces)
    fine = refined(stretched, 0.006)
    assert solidity(*fine).watertight
    assert solidity(*fine).volume == pytest.approx(solidity(*stretched).volume, rel=1e-12)


def test_the_noise_has_the_height_and_the_length_that_it_says():
    rng = np.random.default_rng(0)
    places = rng.uniform(0.0, 0.5, (4000, 3))
    steps = rng.normal(size=(4000, 3))
    steps *= 0.008 / np.linalg.norm(steps, axis=1, keepdims=True)
    here, there = [], []
    for seed in range(12):
        here.append(_field(places, 0.008, np.random.default_rng(seed)))
        there.append(_field(places + steps, 0.008, np.random.default_rng(seed)))
    one, other = np.array(here), np.array(there)
    assert one.std() == pytest.approx(1.0, abs=0.06)
    assert float((one * other).mean()) == pytest.approx(np.exp(-0.5), abs=0.06)


def test_a_copy_is_near_the_surface_and_crosses_itself_nowhere():
    mesh = BALL.mesh(4)
    copy = noisy_copy(mesh, np.random.default_rng(3))
    middle = copy.vertices.mean(axis=0)
    off = np.linalg.norm(copy.vertices - middle, axis=1) - 0.04
    assert off.std() == pytest.approx(LEARNED_NOISE, rel=0.35)
    assert np.linalg.norm(middle) > 0.01
    assert solidity(*copy).watertight


def test_what_is_learned_is_the_same_each_time_and_follows_the_surface():
    meshes = [BALL.mesh(3), BALL.mesh(4)]
    one, other = (learn_scatter(meshes, 4, seed=5) for _ in range(2))
    assert np.array_equal(one.vectors, other.vectors)
    assert np.array_equal(one.slopes, other.slopes)
    assert one.vectors.shape == (4, len(FEATURES))
    assert not np.array_equal(one.vectors, learn_scatter(meshes, 4, seed=6).vectors)
    assert one.slopes[0] == pytest.approx(3.0 / 0.04, rel=0.02)  # of the volume's logarithm
    assert one.slopes[1] == pytest.approx(2.0 / 0.04, rel=0.02)
