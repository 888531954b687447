from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.distances import compare_surfaces, prepare_surface
from palpate.core.geometry.meshes import solidity
from palpate.launch.scene import load_scene
from palpate.nodes.specs.objects import build_shape
from tests.studies.accuracy import gp_explorer as peer
from tests.studies.accuracy.gp_explorer import (
    BallPrior,
    CholeskyFactor,
    Explorer,
    GpSurface,
    GuardedFinger,
    Observations,
    covariance_block,
    farthest_points,
    matern,
)
from tests.studies.explored import EXPLORED_OBJECTS
from tests.studies.harness import NOISES, Demand, write_scene

NAME = "ellipsoid"


def explorer_of(folder: Path, noise: str = "exact") -> Explorer:
    scene = write_scene(folder, EXPLORED_OBJECTS[NAME], NOISES[noise], Demand())
    box = build_shape(load_scene(scene).spec.object).bounds()
    return Explorer(GuardedFinger(scene), box, 0.0, 0.01)


def test_fifteen_touches_find_an_ellipsoid(tmp_path, monkeypatch):
    monkeypatch.setattr(peer, "CELL", 5e-3)
    monkeypatch.setattr(peer, "LEVEL", 5)
    explorer = explorer_of(tmp_path)
    explorer.touch_until(15)
    made = explorer.finger.touched
    assert 15 <= len(made) < 20
    assert 1.0 * len(made) < explorer.finger.robot_time < 10.0 * len(made)
    shape = build_shape(load_scene(tmp_path / "scene.yaml").spec.object)
    error = compare_surfaces(prepare_surface(*shape.mesh(4)), prepare_surface(*explorer.mesh())).rms
    assert error < 0.01 * 0.09


def test_the_same_finger_with_the_same_noise_explores_alike(tmp_path):
    times = []
    for _ in range(2):
        explorer = explorer_of(tmp_path, "noise")
        explorer.touch_until(4)
        times.append(explorer.finger.robot_time)
    assert times[0] == times[1] > 0.0


def test_a_touch_beside_the_object_tells_that_nothing_is_there(tmp_path):
    scene = write_scene(tmp_path, EXPLORED_OBJECTS[NAME], NOISES["exact"], Demand())
    finger = GuardedFinger(scene)
    touched = finger.touch(np.array([0.1, 0.0, 0.045]), np.array([1.0, 0.0, 0.0]), 0.02, 0.01)
    assert touched.outcome == "miss"
    assert len(touched.contact.points) == 0
    assert len(finger.touched) == 1
    seen = explorer_of(tmp_path)._seen(touched)
    assert seen.places == pytest.approx(np.array([[0.09, 0.0, 0.045]]))
    assert seen.values[0] > 0.0


def test_chosen_points_lie_far_from_one_another():
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(81)])
    chosen = points[farthest_points(points, 5), :2].tolist()
    assert chosen[0] == [4.0, 4.0]
    assert sorted(chosen[1:]) == [[0.0, 0.0], [0.0, 8.0], [8.0, 0.0], [8.0, 8.0]]
    assert farthest_points(points[:3], 5) == [1, 0, 2]


STEP = 1e-5
AXES = np.array([1.2, 0.8, 1.0])


def ellipsoid(count: int) -> tuple[Floats, Floats]:
    ways = np.random.default_rng(0).normal(size=(count, 3))
    points = AXES * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    normals = points / AXES**2
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def touched_ellipsoid(shared: float = 0.0) -> GpSurface:
    found = GpSurface(matern(1.5), BallPrior(np.zeros(3), 1.0))
    points, normals = ellipsoid(60)
    for start in range(0, 60, 5):
        some = slice(start, start + 5)
        errors = np.full(5, 1e-3), shared, normals[some], np.full(5, 0.02)
        found.observe(Observations(points[some], np.zeros(5), *errors))
    return found


def test_covariances_of_gradients_are_derivatives_of_those_of_values():
    kernel, rng = matern(0.7), np.random.default_rng(0)
    x, y = rng.normal(size=(2, 3))
    found = covariance_block(kernel, x[None], y[None], True)

    def k(dx: Floats, dy: Floats) -> float:
        return float(covariance_block(kernel, (x + dx)[None], (y + dy)[None], False)[0, 0])

    still, steps = np.zeros(3), STEP * np.eye(3)
    by_y = [(k(still, s) - k(still, -s)) / (2.0 * STEP) for s in steps]
    by_x = [(k(s, still) - k(-s, still)) / (2.0 * STEP) for s in steps]
    assert found[0, 1:] == pytest.approx(by_y, abs=1e-8)
    assert found[1:, 0] == pytest.approx(by_x, abs=1e-8)
    both = [
        [(k(s, t) - k(s, -t) - k(-s, t) + k(-s, -t)) / (4.0 * STEP**2) for t in steps]
        for s in steps
    ]
    assert found[1:, 1:] == pytest.approx(np.array(both), abs=1e-4)


def test_a_gradient_has_unit_variance():
    place = np.zeros((1, 3))
    found = covariance_block(matern(0.7), place, place, True)
    assert np.diag(found)[1:] == pytest.approx(np.ones(3))


def test_a_factor_that_grew_solves_as_the_whole_matrix_does():
    rng = np.random.default_rng(0)
    half = rng.normal(size=(600, 600))
    whole = half @ half.T + 600.0 * np.eye(600)
    grown = CholeskyFactor()
    for start, stop in ((0, 10), (10, 300), (300, 600)):
        grown.append(whole[start:stop, :start], whole[start:stop, start:stop])
    right = rng.normal(size=600)
    assert grown.solve(right) == pytest.approx(np.linalg.solve(whole, right), rel=1e-9)


def test_before_anything_is_touched_the_surface_is_the_ball():
    ball = BallPrior(np.array([1.0, 0.0, 0.0]), 2.0)
    found = GpSurface(lambda r: None, ball)
    value, gradient = found.at(np.array([[3.0, 0.0, 0.0], [1.0, 1.0, 0.0]]))
    assert value == pytest.approx([0.0, -0.75])
    assert gradient == pytest.approx(np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0]]))


def test_the_surface_goes_through_what_was_touched_along_its_normals():
    found = touched_ellipsoid()
    points, normals = ellipsoid(60)
    value, gradient = found.at(points)
    assert np.abs(value).max() < 3e-3
    assert np.abs(gradient - normals).max() < 0.1
    steps = STEP * np.eye(3)
    slopes = [(found.at(points + s)[0] - found.at(points - s)[0]) / (2.0 * STEP) for s in steps]
    assert gradient == pytest.approx(np.array(slopes).T, abs=1e-6)


def test_less_is_known_farther_from_what_was_touched():
    found = touched_ellipsoid()
    near, far = found.deviations(np.array([ellipsoid(1)[0][0], [3.0, 3.0, 3.0]]))
    assert near < 2e-3
    assert far > 0.5


def test_points_of_one_touch_are_off_together():
    alone, together = (touched_ellipsoid(shared) for shared in (0.0, 0.1))
    place = ellipsoid(1)[0]
    assert together.deviations(place)[0] > 2.0 * alone.deviations(place)[0]


def test_the_mesh_is_closed_and_ends_at_the_floor(monkeypatch):
    monkeypatch.setattr(peer, "CELL", 0.15)
    monkeypatch.setattr(peer, "LEVEL", 4)
    mesh = touched_ellipsoid().mesh(np.array([[-1.5] * 3, [1.5] * 3]), -0.5)
    whole = solidity(mesh.vertices, mesh.faces)
    assert whole.watertight
    assert mesh.vertices[:, 2].min() == pytest.approx(-0.5, abs=0.02)
    full = 4.0 / 3.0 * np.pi * AXES.prod()
    cap = np.pi * AXES[0] * AXES[1] * (2.0 / 3.0 - 0.5 + 0.5**3 / 3.0)
    assert whole.volume == pytest.approx(full - cap, rel=0.02)
