from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.alignment import align
from palpate.core.geometry.distances import PreparedSurface, prepare_surface
from palpate.core.poses import rotations_from_vectors, transform_points
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.tessellations import icosphere


@pytest.fixture(scope="module")
def lopsided() -> PreparedSurface:
    """A solid without any symmetry, some 100 mm long."""
    directions, faces = icosphere(3)
    vertices = directions * [0.05, 0.04, 0.03]
    vertices[:, 0] *= 1.0 + 6.0 * vertices[:, 2]
    vertices[:, 1] += 4.0 * vertices[:, 0] ** 2
    return prepare_surface(vertices, faces)


def moved(points: Floats, vector: object, shift: object) -> Floats:
    turn = rotations_from_vectors(np.asarray(vector, float)[None])[0]
    return np.asarray(points @ turn.T + np.asarray(shift))


@pytest.mark.parametrize("vector", [[0, 0, 0], [np.pi, 0, 0], [0.3, 2.5, -0.7]])
def test_points_of_a_surface_are_brought_back_from_any_pose(
    lopsided: PreparedSurface, vector: list[float]
) -> None:
    points = lopsided.samples.points[::20]
    found = align(moved(points, vector, [0.3, -0.1, 0.5]), lopsided)
    back = transform_points(found.pose, moved(points, vector, [0.3, -0.1, 0.5]))
    np.testing.assert_allclose(back, points, atol=1e-9)
    assert found.rms < 1e-10
    assert found.converged
    assert not found.ambiguous
    assert found.pose[6] >= 0.0


def test_with_noise_what_is_left_is_the_noise(lopsided: PreparedSurface) -> None:
    rng = np.random.default_rng(4)
    points = lopsided.samples.points[::20]
    noisy = moved(points, [1.0, 0.5, -0.4], [0.1, 0.2, 0.3]) + 1e-4 * rng.normal(size=points.shape)
    found = align(noisy, lopsided)
    assert found.rms == pytest.approx(1e-4, rel=0.1)
    np.testing.assert_allclose(transform_points(found.pose, noisy), points, atol=6e-4)


def test_the_part_of_a_solid_that_was_seen_is_enough_to_lay_it_on(
    lopsided: PreparedSurface,
) -> None:
    points = lopsided.samples.points
    seen = points[points[:, 2] > -0.01][::10]
    found = align(moved(seen, [0.2, 0.1, 0.3], [0.02, 0.01, 0.03]), lopsided)
    back = transform_points(found.pose, moved(seen, [0.2, 0.1, 0.3], [0.02, 0.01, 0.03]))
    np.testing.assert_allclose(back, seen, atol=1e-8)


def test_a_ball_fits_every_way_and_is_turned_least() -> None:
    directions, faces = icosphere(4)
    ball = prepare_surface(0.04 * directions, faces)
    found = align(ball.samples.points[::20] + [0.1, 0.2, 0.3], ball)
    assert found.ambiguous
    np.testing.assert_allclose(found.pose[:3], [-0.1, -0.2, -0.3], atol=2e-5)


def test_a_box_of_three_lengths_fits_four_ways(box: Mesh) -> None:
    surface = prepare_surface(box.vertices * [0.03, 0.05, 0.08], box.faces)
    found = align(moved(surface.samples.points[::20], [0.0, 0.0, 0.2], [0, 0, 0.1]), surface)
    assert found.ambiguous
    assert found.rms < 1e-9
    # Of the four poses the one that turns least, back by 0.2.
    assert 2.0 * np.arcsin(np.linalg.norm(found.pose[3:6])) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("unit", [1e-3])
def test_the_unit_does_not_matter(lopsided: PreparedSurface, unit: float) -> None:
    directions, faces = icosphere(2)
    vertices = directions * [0.05, 0.04, 0.03] + 0.1 * directions**2 * [0.1, 0.2, 0.3]
    plain, scaled = (prepare_surface(one * vertices, faces) for one in (1.0, unit))
    points = moved(plain.samples.points[::50], [0.5, 0.4, 0.3], [0.1, 0.0, 0.0])
    one, other = align(points, plain), align(unit * points, scaled)
    np.testing.assert_allclose(other.pose[3:], one.pose[3:], atol=1e-7)
    np.testing.assert_allclose(other.pose[:3] / unit, one.pose[:3], atol=1e-7)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((5, 3)), "points must be at least 6, got 5"),
        (np.ones((9, 3)), "points must not lie all in one place, got 9"),
        (np.full((9, 3), np.nan), "points must be finite"),
        (np.zeros((9, 2)), r"points must have shape \(any, 3\)"),
    ],
)
def test_points_that_cannot_be_laid_on_anything_are_refused(
    lopsided: PreparedSurface, points: Floats, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        align(points, lopsided)
