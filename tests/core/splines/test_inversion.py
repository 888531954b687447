from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.splines.bases import Basis, averaged_knots, clamped_basis, uniform_knots
from palpate.core.splines.inversion import (
    affine_fit,
    affine_image,
    invert_general,
    invert_monotone,
    invert_points,
    regular_planes,
)
from palpate.core.splines.spline_volumes import Bases, Parallelepiped, SplineVolume
from palpate.core.thesis.layers import invert_thesis

EPSILON = np.finfo(float).eps
BASES: Bases = clamped_basis(5), clamped_basis(5), clamped_basis(27)
FRAME = Parallelepiped(-np.ones(3), 2.0 * np.eye(3))
SKEWED = Parallelepiped(
    np.array([3.0, -1.0, 0.5]), np.array([[2, 0.3, 0], [-0.4, 1, 0], [0.5, 0, 3.0]])
)
AT = np.random.default_rng(0).random((500, 3))


def noisy(amplitude, seed=0, counts=(7, 7, 9)):
    """A deformed volume; the amplitude is in quarters of its size, as in the published figures."""
    bases = clamped_basis(counts[0]), clamped_basis(counts[1]), clamped_basis(counts[2])
    control = FRAME.greville_control(bases)
    noise = np.random.default_rng(seed).normal(size=control.shape)
    return SplineVolume(control + 0.5 * amplitude * noise, bases)


@pytest.mark.parametrize("frame", [FRAME, SKEWED], ids=["upright", "skewed"])
def test_control_points_at_greville_abscissae_need_no_iteration(frame):
    volume, points = SplineVolume(frame.greville_control(BASES), BASES), frame.points(AT)
    found = invert_points(volume, points)
    assert np.allclose(found.parameters, AT, rtol=0, atol=8 * EPSILON)
    size = np.abs(volume.control).max()
    assert np.abs(volume.at(found.parameters) - points).max() <= 8 * EPSILON * size
    assert found.residual.max() <= 8 * EPSILON * size
    assert found.converged.all()
    assert not found.folded.any()
    assert not found.steps.any()


@pytest.mark.parametrize("frame", [FRAME, SKEWED], ids=["upright", "skewed"])
def test_regular_control_points_take_three_inversions_of_one_variable(frame):
    volume = SplineVolume(frame.even_control((5, 5, 27)), BASES)
    found = invert_points(volume, frame.points(AT))
    size = np.abs(volume.control).max()
    assert np.abs(volume.at(found.parameters) - frame.points(AT)).max() <= 32 * EPSILON * size
    assert found.converged.all()
    assert found.steps.max() <= 6
    general = invert_general(volume, frame.points(AT))
    assert np.allclose(general.parameters, found.parameters, rtol=0, atol=1e-10)


@given(st.integers(0, 1000), st.integers(1, 4))
@settings(derandomize=True, deadline=None, max_examples=20)
def test_what_is_deformed_and_inverted_comes_back(seed: int, degree: int) -> None:
    rng = np.random.default_rng(seed)
    sites = [np.sort(np.concatenate([[0.0, 1.0], rng.random(degree + 2)])) for _ in range(3)]
    s, t, u = (Basis(averaged_knots(places, degree), degree) for places in sites)
    control = SKEWED.greville_control((s, t, u))
    volume = SplineVolume(control + 0.01 * rng.normal(size=control.shape), (s, t, u))
    found = invert_points(volume, volume.at(AT[:30]))
    assert found.converged.all()
    sound = ~found.folded
    assert np.allclose(volume.at(found.parameters), volume.at(AT[:30]), rtol=0, atol=1e-8)
    assert np.median(np.abs(found.parameters - AT[:30])[sound]) < 1e-8


@pytest.mark.parametrize("amplitude", [0.05, 0.1, 0.2])
def test_no_point_of_an_unfolded_volume_is_lost(amplitude):
    volume = noisy(amplitude)
    found = invert_points(volume, volume.at(AT))
    assert found.converged.all()
    assert np.abs(found.parameters - AT).max() < 1e-8
    assert found.residual.max() <= 1e-11


def test_a_rational_volume_is_inverted_as_well():
    weights = np.random.default_rng(3).uniform(0.3, 3.0, (7, 7, 9))
    volume = SplineVolume(noisy(0.1).control, noisy(0.1).bases, weights)
    found = invert_points(volume, volume.at(AT))
    assert found.converged.all()
    assert np.abs(found.parameters - AT).max() < 1e-8


def test_an_affine_image_of_the_volume_keeps_the_parameters():
    volume, matrix = noisy(0.15), np.array([[1.2, 0.3, 0], [-0.1, 0.8, 0.2], [0.4, 0, 1.1]])
    image = SplineVolume(volume.control @ matrix + [5.0, 0.0, -2.0], volume.bases)
    here = invert_points(volume, volume.at(AT)).parameters
    there = invert_points(image, image.at(AT)).parameters
    assert np.allclose(here, there, rtol=0, atol=1e-9)


def test_a_mirrored_volume_is_not_folded():
    volume = noisy(0.1)
    mirrored = SplineVolume(volume.control * [-1, 1, 1], volume.bases)
    assert not invert_points(mirrored, mirrored.at(AT)).folded.any()
    assert not invert_points(volume, volume.at(AT)).folded.any()


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_a_volume_that_runs_round_a_ring_is_not_folded(hand):
    bases = clamped_basis(17), clamped_basis(4), clamped_basis(4)
    angle, radius, height = np.meshgrid(
        1.98 * np.pi * np.linspace(0, 1, 17),
        np.linspace(1, 2, 4),
        np.linspace(0, 1, 4),
        indexing="ij",
    )
    ring = np.stack([radius * np.cos(angle), hand * radius * np.sin(angle), height], axis=-1)
    volume = SplineVolume(ring, bases)
    found = invert_points(volume, volume.at(AT[:100]))
    assert found.converged.all()
    assert not found.folded.any()
    assert np.allclose(found.parameters, AT[:100], rtol=0, atol=1e-9)


def test_points_outside_a_skewed_lattice_are_answered_with_the_nearest():
    volume = SplineVolume(SKEWED.greville_control(BASES), BASES)
    points = SKEWED.points(np.array([[1.2, 1.3, 0.5], [0.5, 0.5, 0.5], [-0.4, 0.2, 1.2]]))
    found = invert_points(volume, points)
    assert found.converged.tolist() == [False, True, False]
    axis = np.linspace(0, 1, 41)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    reached = SKEWED.points(grid)
    for point, residual in zip(points[[0, 2]], found.residual[[0, 2]], strict=True):
        assert residual <= np.linalg.norm(reached - point, axis=1).min() + 1e-12
    clipped = np.linalg.norm(SKEWED.points(np.clip([[1.2, 1.3, 0.5]], 0, 1)) - points[0])
    assert found.residual[0] < 0.999 * clipped


@pytest.mark.parametrize("invert", [invert_points, invert_general])
def test_no_points_have_no_parameters(invert):
    for volume in (noisy(0.1), SplineVolume(FRAME.greville_control(BASES), BASES)):
        found = invert(volume, np.zeros((0, 3)))
        assert [len(part) for part in found] == [0] * 5


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros(3), r"points must have shape \(any, 3\)"),
        (np.full((2, 3), math.nan), "points must be finite"),
    ],
)
def test_points_that_are_none_are_refused(points, words):
    with pytest.raises(ValueError, match=words):
        invert_points(noisy(0.1), points)


MIXED_BASES = clamped_basis(6), clamped_basis(4, 2), Basis(uniform_knots(5), 3)
OBLIQUE_FRAME = Parallelepiped(
    np.array([10.0, -3.0, 2.0]), np.array([[0.5, 0.1, 0], [-0.1, 0.25, 0], [0.3, 0, 2]])
)
GREVILLE = OBLIQUE_FRAME.greville_control(MIXED_BASES)


def test_an_affine_image_of_the_greville_abscissae_is_found_with_its_frame(rotations):
    for rotation in rotations(4):
        found = affine_image(SplineVolume(GREVILLE @ rotation, MIXED_BASES))
        assert found is not None
        assert np.allclose(found.corner, OBLIQUE_FRAME.corner @ rotation, rtol=0, atol=1e-13)
        assert np.allclose(found.edges, OBLIQUE_FRAME.edges @ rotation, rtol=0, atol=1e-13)


def test_weights_that_are_all_alike_hide_nothing():
    assert affine_image(SplineVolume(GREVILLE, MIXED_BASES, np.full((6, 4, 5), 3.0))) is not None


@pytest.mark.parametrize("find", [affine_image, regular_planes])
def test_what_is_bent_weighted_or_flat_has_no_frame(find):
    bent = GREVILLE.copy()
    bent[2, 1, 3] += 1e-9
    weights = np.ones((6, 4, 5))
    weights[1, 1, 1] = 1.0 + 1e-9
    assert find(SplineVolume(bent, MIXED_BASES)) is None
    assert find(SplineVolume(GREVILLE, MIXED_BASES, weights)) is None
    assert find(SplineVolume(GREVILLE * [1, 1, 0], MIXED_BASES)) is None
    assert find(SplineVolume(np.zeros_like(GREVILLE), MIXED_BASES)) is None


def test_even_control_points_are_regular_but_no_affine_image():
    volume = SplineVolume(OBLIQUE_FRAME.even_control((6, 4, 5)), MIXED_BASES)
    assert affine_image(volume) is None
    found = regular_planes(volume)
    assert found is not None
    for planes, count in zip(found[1], (6, 4, 5), strict=True):
        assert np.allclose(planes, np.linspace(0, 1, count), rtol=0, atol=1e-13)


def test_planes_that_do_not_rise_are_not_regular():
    places = [np.array([0, 0.3, 0.2, 0.5, 0.8, 1]), np.linspace(0, 1, 4), np.linspace(0, 1, 5)]
    control = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)
    assert regular_planes(SplineVolume(control, MIXED_BASES)) is None
    assert regular_planes(SplineVolume(np.sort(control, axis=0), MIXED_BASES)) is not None


def test_the_affine_fit_gives_the_parameters_of_an_affine_image():
    at = np.random.default_rng(0).random((20, 3))
    points = OBLIQUE_FRAME.points(at)
    fit = affine_fit(SplineVolume(GREVILLE, MIXED_BASES))
    assert np.allclose(points @ fit[:3] + fit[3], at, rtol=0, atol=1e-12)


@pytest.mark.parametrize("squeeze", [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_the_affine_fit_of_what_is_squeezed_flat_is_finite(squeeze):
    fit = affine_fit(SplineVolume(GREVILLE * squeeze, MIXED_BASES))
    assert np.isfinite(fit).all()


@given(
    st.integers(1, 5),
    st.lists(st.floats(1e-6, 1.0), min_size=6, max_size=12),
    st.sampled_from([1e-9, 1.0, 1e9]),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_a_rising_spline_takes_its_values_where_they_are_found(
    degree: int, rises: list[float], scale: float
) -> None:
    coefficients = scale * np.cumsum([0.0, *rises])
    basis = clamped_basis(len(coefficients), degree)
    at = np.concatenate([np.random.default_rng(0).random(50), [0.0, 1.0], np.unique(basis.knots)])
    values = basis.matrix(at) @ coefficients
    found = invert_monotone(basis, coefficients, values)
    off = np.abs(basis.matrix(found.parameters) @ coefficients - values)
    assert off.max() <= 16 * EPSILON * np.ptp(coefficients)
    assert found.residual.max() <= 8 * EPSILON * np.ptp(coefficients)


def test_roots_are_found_in_few_steps_and_stay():
    basis = clamped_basis(27)
    coefficients = np.linspace(-1.0, 1.0, 27)
    values = np.random.default_rng(1).uniform(-1, 1, 10_000)
    found = invert_monotone(basis, coefficients, values)
    assert found.steps.max() <= 6
    assert found.residual.max() <= 4 * EPSILON * 2.0


def test_an_identity_needs_no_step():
    basis = clamped_basis(9)
    values = np.random.default_rng(2).random(100)
    found = invert_monotone(basis, basis.greville(), values)
    assert np.allclose(found.parameters, values, rtol=0, atol=4 * EPSILON)
    assert found.steps.max() <= 1


def test_a_spline_that_stands_still_somewhere_is_inverted_there_too():
    # Its slope is nearly 3 x^2: Newton's method alone creeps to a root near 0.
    rising = np.array([0, 1e-12, 2e-12, 1.0])
    found = invert_monotone(clamped_basis(4, 3), rising, np.array([0, 1e-9, 1.0]))
    assert found.parameters[[0, 2]].tolist() == [0.0, 1.0]
    assert found.parameters[1] == pytest.approx(1e-3, rel=1e-5)


def test_values_beyond_the_ends_are_answered_with_the_ends():
    found = invert_monotone(clamped_basis(6), np.arange(6.0), np.array([-1.0, 7.0]))
    assert found.parameters.tolist() == [0.0, 1.0]
    assert found.residual.tolist() == [1.0, 2.0]


def test_unclamped_ends_are_where_the_spline_ends_not_its_coefficients():
    basis = Basis(uniform_knots(7), 3)
    values = basis.matrix(np.linspace(0, 1, 20)) @ np.arange(7.0)
    found = invert_monotone(basis, np.arange(7.0), values)
    assert np.allclose(found.parameters, np.linspace(0, 1, 20), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("coefficients", "words"),
    [
        ([0, 1, 2, 2], "coefficients must rise"),
        ([0, 1, 2], r"coefficients must have shape \(4\)"),
        ([0, 1, 2, np.inf], "coefficients must be finite"),
    ],
)
def test_coefficients_that_do_not_rise_are_refused(coefficients, words):
    with pytest.raises(ValueError, match=words):
        invert_monotone(clamped_basis(4), np.array(coefficients, float), np.zeros(1))


def test_values_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="values must be numbers, got 1 nan"):
        invert_monotone(clamped_basis(6), np.arange(6.0), np.array([1.0, np.nan]))


FINE_BASES = clamped_basis(7), clamped_basis(7), clamped_basis(9)
FINE_GREVILLE = FRAME.greville_control(FINE_BASES)


def noisy_fine(amplitude, seed=3):
    noise = np.random.default_rng(seed).normal(size=FINE_GREVILLE.shape)
    return SplineVolume(FINE_GREVILLE + 0.5 * amplitude * noise, FINE_BASES)


def places(count):
    return np.random.default_rng(0).random((count, 3))


def test_a_flat_lattice_gives_finite_parameters_and_says_that_they_are_not_unique():
    flat = SplineVolume(FINE_GREVILLE * [1.0, 1.0, 0.0], FINE_BASES)
    found = invert_points(flat, flat.at(places(100)))
    assert np.isfinite(found.parameters).all()
    assert found.residual.max() < 1e-9
    assert found.converged.all()
    assert found.folded.all()


@pytest.mark.parametrize("invert", [invert_points, invert_thesis])
@pytest.mark.parametrize("squeeze", [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_a_lattice_on_a_line_or_a_point_gives_finite_parameters(squeeze, invert):
    volume = SplineVolume(FINE_GREVILLE * squeeze, FINE_BASES)
    found = invert(volume, volume.at(places(20)))
    away = invert(volume, volume.at(places(20)) + [0.0, 0.5, 0.0])
    assert found.converged.all()
    assert not away.converged.any()
    for one in (found, away):
        assert np.isfinite(one.parameters).all()
        assert np.isfinite(one.residual).all()
        assert one.folded.all()


def test_a_lattice_of_which_17_per_cent_is_folded_loses_at_most_1_per_cent():
    volume = noisy_fine(0.85, seed=9)
    points, slopes = volume.first(places(3000))
    share = (np.linalg.det(slopes) < 0.0).mean()
    assert 0.16 < share < 0.19
    found = invert_points(volume, points)
    assert (~found.converged).mean() <= 0.01
    assert found.residual[found.converged].max() < 1e-8
    # Where the inverse is not unique the flags tell it: they are those of the determinant.
    there = np.linalg.det(volume.first(found.parameters)[1]) <= 0.0
    assert found.folded.any()
    assert np.array_equal(found.folded, there)


def test_a_point_outside_has_not_converged_and_gets_the_nearest_point_of_a_face():
    volume = noisy_fine(0.1)
    away = np.random.default_rng(1).normal(size=(100, 3))
    points = 3.0 * away / np.linalg.norm(away, axis=1, keepdims=True)
    found = invert_points(volume, points)
    assert not found.converged.any()
    assert ((found.parameters == 0.0) | (found.parameters == 1.0)).any(axis=1).all()
    axis = np.linspace(0.0, 1.0, 25)
    ends = [[axis, axis, np.array([end])] for end in (0.0, 1.0)]
    faces = [volume.grid(*np.roll(np.array(one, object), k)) for one in ends for k in range(3)]
    surface = np.concatenate([face.reshape(-1, 3) for face in faces])
    nearest = np.linalg.norm(points[:, None] - surface, axis=2).min(axis=1)
    assert (found.residual <= 1.03 * nearest).all()


def test_points_on_faces_edges_and_corners_are_exact_in_8_steps():
    volume = noisy_fine(0.1)
    face = np.column_stack([np.zeros(100), places(100)[:, 1:]])
    edge = np.column_stack([np.ones(100), np.zeros(100), places(100)[:, 0]])
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    at = np.concatenate([face, edge, corners])
    found = invert_points(volume, volume.at(at))
    assert found.converged.all()
    assert found.steps.max() <= 8
    assert np.abs(found.parameters - at).max() < 1e-9


@pytest.mark.parametrize("invert", [invert_points, invert_general])
def test_a_start_at_the_solution_takes_no_step(invert):
    volume = SplineVolume(FINE_GREVILLE, FINE_BASES)  # of which the affine guess is the answer
    found = invert(volume, volume.at(places(100)))
    assert not found.steps.any()
    assert found.converged.all()
    assert np.isfinite(found.parameters).all()


@pytest.mark.parametrize("scale", [1e-140, 1e-9, 1e9, 1e140])
def test_the_unit_changes_neither_the_steps_nor_the_answer(scale):
    here = noisy_fine(0.2)
    there = SplineVolume(scale * here.control, FINE_BASES)
    metres = invert_points(here, here.at(places(300)))
    found = invert_points(there, there.at(places(300)))
    assert np.array_equal(found.steps, metres.steps)
    assert found.converged.all()
    assert np.allclose(found.parameters, metres.parameters, rtol=0, atol=1e-9)
    assert np.array_equal(found.folded, metres.folded)
