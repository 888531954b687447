from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis, clamped_basis
from palpate.core.splines.frame import Bases, Frame
from palpate.core.splines.invert import Method, invert
from palpate.core.splines.knots import averaged_knots
from palpate.core.splines.volume import Volume

EPSILON = np.finfo(float).eps
BASES: Bases = clamped_basis(5), clamped_basis(5), clamped_basis(27)
FRAME = Frame(-np.ones(3), 2.0 * np.eye(3))
SKEWED = Frame(np.array([3.0, -1.0, 0.5]), np.array([[2, 0.3, 0], [-0.4, 1, 0], [0.5, 0, 3.0]]))
AT = np.random.default_rng(0).random((500, 3))


def noisy(amplitude: float, seed: int = 0, counts: tuple[int, int, int] = (7, 7, 9)) -> Volume:
    """A deformed volume; the amplitude is in quarters of its size, as in the published figures."""
    bases = clamped_basis(counts[0]), clamped_basis(counts[1]), clamped_basis(counts[2])
    control = FRAME.greville_control(bases)
    noise = np.random.default_rng(seed).normal(size=control.shape)
    return Volume(control + 0.5 * amplitude * noise, bases)


@pytest.mark.parametrize("frame", [FRAME, SKEWED], ids=["upright", "skewed"])
def test_control_points_at_greville_abscissae_need_no_iteration(frame: Frame) -> None:
    volume, points = Volume(frame.greville_control(BASES), BASES), frame.points(AT)
    found = invert(volume, points)
    assert np.allclose(found.parameters, AT, rtol=0, atol=8 * EPSILON)
    size = np.abs(volume.control).max()
    assert np.abs(volume.at(found.parameters) - points).max() <= 8 * EPSILON * size
    assert found.residual.max() <= 8 * EPSILON * size
    assert found.converged.all()
    assert not found.folded.any()
    assert not found.steps.any()


@pytest.mark.parametrize("frame", [FRAME, SKEWED], ids=["upright", "skewed"])
def test_regular_control_points_take_three_inversions_of_one_variable(frame: Frame) -> None:
    volume = Volume(frame.even_control((5, 5, 27)), BASES)
    found = invert(volume, frame.points(AT))
    size = np.abs(volume.control).max()
    assert np.abs(volume.at(found.parameters) - frame.points(AT)).max() <= 32 * EPSILON * size
    assert found.converged.all()
    assert found.steps.max() <= 6
    general = invert(volume, frame.points(AT), method="general")
    assert np.allclose(general.parameters, found.parameters, rtol=0, atol=1e-10)


@given(st.integers(0, 1000), st.integers(1, 4))
@settings(derandomize=True, deadline=None, max_examples=20)
def test_what_is_deformed_and_inverted_comes_back(seed: int, degree: int) -> None:
    rng = np.random.default_rng(seed)
    sites = [np.sort(np.concatenate([[0.0, 1.0], rng.random(degree + 2)])) for _ in range(3)]
    s, t, u = (Basis(averaged_knots(places, degree), degree) for places in sites)
    control = SKEWED.greville_control((s, t, u))
    volume = Volume(control + 0.01 * rng.normal(size=control.shape), (s, t, u))
    found = invert(volume, volume.at(AT[:30]))
    assert found.converged.all()
    sound = ~found.folded
    assert np.allclose(volume.at(found.parameters), volume.at(AT[:30]), rtol=0, atol=1e-8)
    assert np.median(np.abs(found.parameters - AT[:30])[sound]) < 1e-8


@pytest.mark.parametrize("amplitude", [0.05, 0.1, 0.2])
def test_no_point_of_an_unfolded_volume_is_lost(amplitude: float) -> None:
    volume = noisy(amplitude)
    found = invert(volume, volume.at(AT))
    assert found.converged.all()
    assert np.abs(found.parameters - AT).max() < 1e-8
    assert found.residual.max() <= 1e-11


def test_a_rational_volume_is_inverted_as_well() -> None:
    weights = np.random.default_rng(3).uniform(0.3, 3.0, (7, 7, 9))
    volume = Volume(noisy(0.1).control, noisy(0.1).bases, weights)
    found = invert(volume, volume.at(AT))
    assert found.converged.all()
    assert np.abs(found.parameters - AT).max() < 1e-8


def test_an_affine_image_of_the_volume_keeps_the_parameters() -> None:
    volume, matrix = noisy(0.15), np.array([[1.2, 0.3, 0], [-0.1, 0.8, 0.2], [0.4, 0, 1.1]])
    image = Volume(volume.control @ matrix + [5.0, 0.0, -2.0], volume.bases)
    here = invert(volume, volume.at(AT)).parameters
    there = invert(image, image.at(AT)).parameters
    assert np.allclose(here, there, rtol=0, atol=1e-9)


def test_a_mirrored_volume_is_not_folded() -> None:
    volume = noisy(0.1)
    mirrored = Volume(volume.control * [-1, 1, 1], volume.bases)
    assert not invert(mirrored, mirrored.at(AT)).folded.any()
    assert not invert(volume, volume.at(AT)).folded.any()


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_a_volume_that_runs_round_a_ring_is_not_folded(hand: float) -> None:
    bases = clamped_basis(17), clamped_basis(4), clamped_basis(4)
    angle, radius, height = np.meshgrid(
        1.98 * np.pi * np.linspace(0, 1, 17),
        np.linspace(1, 2, 4),
        np.linspace(0, 1, 4),
        indexing="ij",
    )
    ring = np.stack([radius * np.cos(angle), hand * radius * np.sin(angle), height], axis=-1)
    volume = Volume(ring, bases)
    found = invert(volume, volume.at(AT[:100]))
    assert found.converged.all()
    assert not found.folded.any()
    assert np.allclose(found.parameters, AT[:100], rtol=0, atol=1e-9)


def test_points_outside_a_skewed_lattice_are_answered_with_the_nearest() -> None:
    volume = Volume(SKEWED.greville_control(BASES), BASES)
    points = SKEWED.points(np.array([[1.2, 1.3, 0.5], [0.5, 0.5, 0.5], [-0.4, 0.2, 1.2]]))
    found = invert(volume, points)
    assert found.converged.tolist() == [False, True, False]
    axis = np.linspace(0, 1, 41)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    reached = SKEWED.points(grid)
    for point, residual in zip(points[[0, 2]], found.residual[[0, 2]], strict=True):
        assert residual <= np.linalg.norm(reached - point, axis=1).min() + 1e-12
    clipped = np.linalg.norm(SKEWED.points(np.clip([[1.2, 1.3, 0.5]], 0, 1)) - points[0])
    assert found.residual[0] < 0.999 * clipped


def test_the_thesis_finds_the_same_parameters_where_it_converges() -> None:
    volume = noisy(0.1)
    found = invert(volume, volume.at(AT), method="thesis")
    assert found.converged.mean() > 0.99
    off = np.abs(found.parameters - AT)[found.converged]
    assert off.max() < 1e-5
    assert found.steps.max() > 1


def test_the_thesis_fails_where_the_volume_folds() -> None:
    volume = noisy(0.8, seed=1)
    points = volume.at(AT)
    assert invert(volume, points, method="thesis").converged.mean() < 0.7
    assert invert(volume, points).converged.mean() > 0.99


def test_the_thesis_gives_up_where_its_matrix_is_singular() -> None:
    volume = noisy(0.1)
    flat = Volume(volume.control * [1.0, 1.0, 0.0], volume.bases)
    found = invert(flat, flat.at(AT) + [0.0, 0.0, 0.1], method="thesis")
    assert not found.converged.any()
    assert np.isfinite(found.parameters).all()
    assert np.isfinite(found.residual).all()


@pytest.mark.parametrize("method", ["auto", "general", "thesis"])
def test_no_points_have_no_parameters(method: Method) -> None:
    for volume in (noisy(0.1), Volume(FRAME.greville_control(BASES), BASES)):
        found = invert(volume, np.zeros((0, 3)), method=method)
        assert [len(part) for part in found] == [0] * 5


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros(3), r"points must have shape \(any, 3\)"),
        (np.full((2, 3), math.nan), "points must be finite"),
    ],
)
def test_points_that_are_none_are_refused(points: Floats, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        invert(noisy(0.1), points)


def test_a_method_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="method must be auto, general or thesis, got 'newton'"):
        invert(noisy(0.1), AT, method="newton")  # type: ignore[arg-type]
