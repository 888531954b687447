from __future__ import annotations

import numpy as np
import pytest

from palpate.bench.explore import gp_surface
from palpate.bench.explore.gp_surface import (
    BallPrior,
    CholeskyFactor,
    GpSurface,
    Kernel,
    Observations,
    covariance_block,
    matern,
    thin_plate,
)
from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import solidity

STEP = 1e-5
AXES = np.array([1.2, 0.8, 1.0])


def kernel_of(name: str) -> Kernel:
    return matern(0.7) if name == "matern" else thin_plate(5.0)


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


@pytest.mark.parametrize("name", ["matern", "thin plate"])
def test_covariances_of_gradients_are_derivatives_of_those_of_values(name: str) -> None:
    kernel, rng = kernel_of(name), np.random.default_rng(0)
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


@pytest.mark.parametrize("name", ["matern", "thin plate"])
def test_a_gradient_has_unit_variance(name: str) -> None:
    place = np.zeros((1, 3))
    found = covariance_block(kernel_of(name), place, place, True)
    assert np.diag(found)[1:] == pytest.approx(np.ones(3))


def test_a_factor_that_grew_solves_as_the_whole_matrix_does() -> None:
    rng = np.random.default_rng(0)
    half = rng.normal(size=(600, 600))
    whole = half @ half.T + 600.0 * np.eye(600)
    grown = CholeskyFactor()
    for start, stop in ((0, 10), (10, 300), (300, 600)):
        grown.append(whole[start:stop, :start], whole[start:stop, start:stop])
    right = rng.normal(size=600)
    assert grown.solve(right) == pytest.approx(np.linalg.solve(whole, right), rel=1e-9)


def test_before_anything_is_touched_the_surface_is_the_ball() -> None:
    ball = BallPrior(np.array([1.0, 0.0, 0.0]), 2.0)
    found = GpSurface(lambda r: None, ball)
    value, gradient = found.at(np.array([[3.0, 0.0, 0.0], [1.0, 1.0, 0.0]]))
    assert value == pytest.approx([0.0, -0.75])
    assert gradient == pytest.approx(np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0]]))


def test_the_surface_goes_through_what_was_touched_along_its_normals() -> None:
    found = touched_ellipsoid()
    points, normals = ellipsoid(60)
    value, gradient = found.at(points)
    assert np.abs(value).max() < 3e-3
    assert np.abs(gradient - normals).max() < 0.1
    steps = STEP * np.eye(3)
    slopes = [(found.at(points + s)[0] - found.at(points - s)[0]) / (2.0 * STEP) for s in steps]
    assert gradient == pytest.approx(np.array(slopes).T, abs=1e-6)


def test_less_is_known_farther_from_what_was_touched() -> None:
    found = touched_ellipsoid()
    near, far = found.deviations(np.array([ellipsoid(1)[0][0], [3.0, 3.0, 3.0]]))
    assert near < 2e-3
    assert far > 0.5


def test_points_of_one_touch_are_off_together() -> None:
    alone, together = (touched_ellipsoid(shared) for shared in (0.0, 0.1))
    place = ellipsoid(1)[0]
    assert together.deviations(place)[0] > 2.0 * alone.deviations(place)[0]


def test_the_mesh_is_closed_and_ends_at_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gp_surface, "CELL", 0.15)
    monkeypatch.setattr(gp_surface, "LEVEL", 4)
    mesh = touched_ellipsoid().mesh(np.array([[-1.5] * 3, [1.5] * 3]), -0.5)
    whole = solidity(mesh.vertices, mesh.faces)
    assert whole.watertight
    assert mesh.vertices[:, 2].min() == pytest.approx(-0.5, abs=0.02)
    full = 4.0 / 3.0 * np.pi * AXES.prod()
    cap = np.pi * AXES[0] * AXES[1] * (2.0 / 3.0 - 0.5 + 0.5**3 / 3.0)
    assert whole.volume == pytest.approx(full - cap, rel=0.02)
