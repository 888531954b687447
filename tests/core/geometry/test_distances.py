from types import SimpleNamespace

import numpy as np
import pytest

from palpate.core.geometry.distances import (
    _best,
    align,
    compare_surfaces,
    prepare_surface,
    sample_surface,
)
from palpate.core.geometry.meshes import triangle_corners
from palpate.core.poses import rotations_from_vectors, transform_points
from palpate.core.shapes.tessellations import icosphere


def test_a_surface_is_at_no_distance_from_itself(sphere):
    same = prepare_surface(*sphere)
    distances = compare_surfaces(same, same)
    assert distances.hausdorff < 1e-16
    assert distances.normal_deg < 1e-9


def test_two_shifted_squares_are_at_their_shift():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    distances = compare_surfaces(
        prepare_surface(square, faces), prepare_surface(square + np.array([0, 0, 0.25]), faces)
    )
    assert distances == pytest.approx((0.25, 0.25, 0.25, 0.25, 0.0), abs=1e-12)


def test_concentric_spheres_are_as_far_apart_as_their_radii():
    directions, faces = icosphere(5)
    distances = compare_surfaces(
        prepare_surface(0.040 * directions, faces), prepare_surface(0.041 * directions, faces)
    )
    # The facets stand off by up to 0.04 * 0.035**2 / 8 = 6 um.
    assert distances[:4] == pytest.approx((1e-3,) * 4, abs=7e-6)
    assert distances.normal_deg < 1.0


def test_each_figure_has_its_own_definition():
    # A square, and the same with a small flap one metre up: only one way sees the flap.
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    flap = np.array([[0.4, 0.4, 1], [0.6, 0.4, 1], [0.6, 0.6, 1], [0.4, 0.6, 1]])
    both = np.concatenate([square, flap])
    distances = compare_surfaces(
        prepare_surface(square, faces),
        prepare_surface(both, np.concatenate([faces, faces + len(square)])),
    )
    share = 0.04 / 1.04  # of the samples of the surface with the flap
    assert distances.chamfer == pytest.approx(0.5 * share, rel=1e-3)
    assert distances.rms == pytest.approx((0.5 * share) ** 0.5, rel=1e-3)
    assert distances.p95 < 1e-15
    assert distances.hausdorff == pytest.approx(1.0)


def test_turned_normals_are_seen(sphere):
    inside_out = prepare_surface(sphere.vertices, sphere.faces[:, ::-1])
    # 180 degrees, but for the samples whose nearest point is on a neighbouring facet.
    assert compare_surfaces(prepare_surface(*sphere), inside_out).normal_deg == pytest.approx(
        180.0, abs=0.5
    )


def test_both_ways_count_alike(sphere, box):
    one, other = prepare_surface(*sphere), prepare_surface(0.05 * box.vertices, box.faces)
    assert compare_surfaces(one, other) == compare_surfaces(other, one)


def test_the_same_meshes_give_the_same_bits(sphere, box):
    first, second = (
        compare_surfaces(prepare_surface(*sphere), prepare_surface(*box)) for _ in range(2)
    )
    assert first == second


def test_millimetres_and_metres_agree(sphere, box):
    metres = compare_surfaces(
        prepare_surface(*sphere), prepare_surface(0.05 * box.vertices, box.faces)
    )
    millimetres = compare_surfaces(
        prepare_surface(1e3 * sphere.vertices, sphere.faces),
        prepare_surface(50.0 * box.vertices, box.faces),
    )
    assert np.array(millimetres[:4]) / 1e3 == pytest.approx(metres[:4], rel=1e-9)
    assert millimetres.normal_deg == pytest.approx(metres.normal_deg, rel=1e-3)


def test_moving_both_changes_nothing(sphere):
    squashed = sphere.vertices * [1.0, 0.9, 1.1]
    here = compare_surfaces(prepare_surface(*sphere), prepare_surface(squashed, sphere.faces))
    shift = np.array([1.0, -2.0, 3.0])
    there = compare_surfaces(
        prepare_surface(sphere.vertices + shift, sphere.faces),
        prepare_surface(squashed + shift, sphere.faces),
    )
    assert there[:4] == pytest.approx(here[:4], rel=1e-9)


def test_faces_without_area_are_left_out(sphere):
    plain = prepare_surface(*sphere)
    extra = np.concatenate([[[0, 0, 1], [5, 5, 5]], sphere.faces])
    assert compare_surfaces(plain, prepare_surface(sphere.vertices, extra)) == compare_surfaces(
        plain, plain
    )


def test_a_surface_without_area_is_refused():
    with pytest.raises(ValueError, match="must have an area, but all 2 faces have none"):
        prepare_surface(np.zeros((3, 3)), [[0, 1, 2], [2, 1, 0]])


def test_each_face_gets_samples_by_its_area():
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


def test_samples_lie_on_their_faces(sphere):
    corners = triangle_corners(sphere.vertices, sphere.faces)
    points, faces = sample_surface(corners, 500, np.random.default_rng(2))
    a, b, c = np.moveaxis(corners[faces], 1, 0)
    shares = np.linalg.solve(np.stack([a, b, c], axis=2), points[:, :, None])[:, :, 0]
    assert shares.min() >= -1e-12
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-12)


def test_points_of_a_triangle_are_equally_likely():
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    points = sample_surface(corners, 100_000, np.random.default_rng(3)).points
    x, y = points[:, 0], points[:, 1]
    # Four congruent quarters of the triangle; the bound is five standard deviations.
    quarters = [(x > 0.5).mean(), (y > 0.5).mean(), (x + y < 0.5).mean()]
    assert quarters == pytest.approx([0.25] * 3, abs=5 * (0.25 * 0.75 / 100_000) ** 0.5)


def test_means_over_a_sphere_are_unbiased(sphere):
    corners = triangle_corners(sphere.vertices, sphere.faces)
    points = sample_surface(corners, 20_000, np.random.default_rng(4)).points
    # 40 mm / sqrt(3 * 20000) = 0.16 mm would be the deviation of a plain sample.
    assert np.abs(points.mean(axis=0)).max() < 5 * 0.16e-3


def test_the_same_seed_gives_the_same_samples(sphere):
    corners = triangle_corners(sphere.vertices, sphere.faces)
    one, other = (sample_surface(corners, 100, np.random.default_rng(5)) for _ in range(2))
    assert one.points.tobytes() == other.points.tobytes()


def test_a_last_face_without_area_gets_no_sample():
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    assert sample_surface(corners, 1000, np.random.default_rng(6)).faces.max() == 0


def test_a_surface_without_area_is_not_sampled():
    with pytest.raises(ValueError, match="must have an area to be sampled, got 0"):
        sample_surface(np.zeros((2, 3, 3)), 10, np.random.default_rng(0))


@pytest.fixture(scope="module")
def lopsided():
    """A solid without any symmetry, some 100 mm long."""
    directions, faces = icosphere(3)
    vertices = directions * [0.05, 0.04, 0.03]
    vertices[:, 0] *= 1.0 + 6.0 * vertices[:, 2]
    vertices[:, 1] += 4.0 * vertices[:, 0] ** 2
    return prepare_surface(vertices, faces)


def moved(points, vector, shift):
    turn = rotations_from_vectors(np.asarray(vector, float)[None])[0]
    return np.asarray(points @ turn.T + np.asarray(shift))


@pytest.mark.parametrize("vector", [[0, 0, 0], [np.pi, 0, 0], [0.3, 2.5, -0.7]])
def test_points_of_a_surface_are_brought_back_from_any_pose(lopsided, vector):
    points = lopsided.samples.points[::20]
    found = align(moved(points, vector, [0.3, -0.1, 0.5]), lopsided)
    back = transform_points(found.pose, moved(points, vector, [0.3, -0.1, 0.5]))
    np.testing.assert_allclose(back, points, atol=1e-9)
    assert found.rms < 1e-10
    assert found.converged
    assert not found.ambiguous
    assert found.pose[6] >= 0.0


def test_with_noise_what_is_left_is_the_noise(lopsided):
    rng = np.random.default_rng(4)
    points = lopsided.samples.points[::20]
    noisy = moved(points, [1.0, 0.5, -0.4], [0.1, 0.2, 0.3]) + 1e-4 * rng.normal(size=points.shape)
    found = align(noisy, lopsided)
    assert found.rms == pytest.approx(1e-4, rel=0.1)
    np.testing.assert_allclose(transform_points(found.pose, noisy), points, atol=6e-4)


def test_the_part_of_a_solid_that_was_seen_is_enough_to_lay_it_on(lopsided):
    points = lopsided.samples.points
    seen = points[points[:, 2] > -0.01][::10]
    found = align(moved(seen, [0.2, 0.1, 0.3], [0.02, 0.01, 0.03]), lopsided)
    back = transform_points(found.pose, moved(seen, [0.2, 0.1, 0.3], [0.02, 0.01, 0.03]))
    np.testing.assert_allclose(back, seen, atol=1e-8)


def test_a_ball_fits_every_way_and_is_turned_least():
    directions, faces = icosphere(4)
    ball = prepare_surface(0.04 * directions, faces)
    found = align(ball.samples.points[::20] + [0.1, 0.2, 0.3], ball)
    assert found.ambiguous
    np.testing.assert_allclose(found.pose[:3], [-0.1, -0.2, -0.3], atol=2e-5)


def test_a_box_of_three_lengths_fits_four_ways(box):
    surface = prepare_surface(box.vertices * [0.03, 0.05, 0.08], box.faces)
    found = align(moved(surface.samples.points[::20], [0.0, 0.0, 0.2], [0, 0, 0.1]), surface)
    assert found.ambiguous
    assert found.rms < 1e-9
    # Of the four poses the one that turns least, back by 0.2.
    assert 2.0 * np.arcsin(np.linalg.norm(found.pose[3:6])) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("unit", [1e-3])
def test_the_unit_does_not_matter(lopsided, unit):
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
def test_points_that_cannot_be_laid_on_anything_are_refused(lopsided, points, words):
    with pytest.raises(ValueError, match=words):
        align(points, lopsided)


def test_of_starts_that_came_to_one_turn_only_the_better_is_ended():
    turns = rotations_from_vectors(np.array([[0, 0, 0], [0, 0, 0.01], [0, 0, 1.0]]))
    rough = SimpleNamespace(parameters=np.zeros((3, 6)), cost=np.array([2.0, 1.0, 3.0]))
    assert _best(SimpleNamespace(turns=turns), rough) == [1, 2]
