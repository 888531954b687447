from __future__ import annotations

import numpy as np
import pytest

from palpate.core.measure.sampling import sample_surface
from palpate.core.measure.triangles import corners_of
from palpate.core.shapes.protocol import Mesh


def test_each_face_gets_samples_by_its_area() -> None:
    # Areas 1, 0, 3: a face without area in the middle gets none.
    corners = np.array(
        [
            [[0.0, 0, 0], [2, 0, 0], [0, 1, 0]],
            [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]],
            [[0.0, 0, 5], [2, 0, 5], [0, 3, 5]],
        ]
    )

    samples = sample_surface(corners, 4000, np.random.default_rng(1))

    counts = np.bincount(samples.faces, minlength=3)
    # Stratified: only the stratum that a boundary cuts can fall to either side.
    assert abs(counts[0] - 1000) <= 1
    assert counts[1] == 0


def test_samples_lie_on_their_faces(sphere: Mesh) -> None:
    corners = corners_of(sphere.vertices, sphere.faces)

    points, faces = sample_surface(corners, 500, np.random.default_rng(2))

    a, b, c = np.moveaxis(corners[faces], 1, 0)
    shares = np.linalg.solve(np.stack([a, b, c], axis=2), points[:, :, None])[:, :, 0]
    assert shares.min() >= -1e-12
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-12)


def test_points_of_a_triangle_are_equally_likely() -> None:
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])

    points = sample_surface(corners, 100_000, np.random.default_rng(3)).points

    x, y = points[:, 0], points[:, 1]
    # Four congruent quarters of the triangle; the bound is five standard deviations.
    quarters = [(x > 0.5).mean(), (y > 0.5).mean(), (x + y < 0.5).mean()]
    assert quarters == pytest.approx([0.25] * 3, abs=5 * (0.25 * 0.75 / 100_000) ** 0.5)


def test_means_over_a_sphere_are_unbiased(sphere: Mesh) -> None:
    corners = corners_of(sphere.vertices, sphere.faces)

    points = sample_surface(corners, 20_000, np.random.default_rng(4)).points

    # 40 mm / sqrt(3 * 20000) = 0.16 mm would be the deviation of a plain sample.
    assert np.abs(points.mean(axis=0)).max() < 5 * 0.16e-3


def test_the_same_seed_gives_the_same_samples(sphere: Mesh) -> None:
    corners = corners_of(sphere.vertices, sphere.faces)

    one, other = (sample_surface(corners, 100, np.random.default_rng(5)) for _ in range(2))

    assert one.points.tobytes() == other.points.tobytes()


def test_a_last_face_without_area_gets_no_sample() -> None:
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])

    assert sample_surface(corners, 1000, np.random.default_rng(6)).faces.max() == 0


def test_a_surface_without_area_is_refused() -> None:
    with pytest.raises(ValueError, match="must have an area to be sampled, got 0"):
        sample_surface(np.zeros((2, 3, 3)), 10, np.random.default_rng(0))
