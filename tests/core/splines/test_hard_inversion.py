"""Inputs at which point inversion is known to break."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.frame import Frame
from palpate.core.splines.invert import Method, invert
from palpate.core.splines.volume import Volume

FRAME = Frame(-np.ones(3), 2.0 * np.eye(3))
BASES = clamped_basis(7), clamped_basis(7), clamped_basis(9)
GREVILLE = FRAME.greville_control(BASES)


def noisy(amplitude: float, seed: int = 3) -> Volume:
    noise = np.random.default_rng(seed).normal(size=GREVILLE.shape)
    return Volume(GREVILLE + 0.5 * amplitude * noise, BASES)


def places(count: int) -> Floats:
    return np.random.default_rng(0).random((count, 3))


def test_a_flat_lattice_gives_finite_parameters_and_says_that_they_are_not_unique() -> None:
    flat = Volume(GREVILLE * [1.0, 1.0, 0.0], BASES)
    found = invert(flat, flat.at(places(100)))
    assert np.isfinite(found.parameters).all()
    assert found.residual.max() < 1e-9
    assert found.converged.all()
    assert found.folded.all()


@pytest.mark.parametrize("method", ["auto", "thesis"])
@pytest.mark.parametrize("squeeze", [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_a_lattice_on_a_line_or_a_point_gives_finite_parameters(
    squeeze: list[float], method: Method
) -> None:
    volume = Volume(GREVILLE * squeeze, BASES)
    found = invert(volume, volume.at(places(20)), method=method)
    away = invert(volume, volume.at(places(20)) + [0.0, 0.5, 0.0], method=method)
    assert found.converged.all()
    assert not away.converged.any()
    for one in (found, away):
        assert np.isfinite(one.parameters).all()
        assert np.isfinite(one.residual).all()
        assert one.folded.all()


def test_a_lattice_of_which_17_per_cent_is_folded_loses_at_most_1_per_cent() -> None:
    volume = noisy(0.85, seed=9)
    points, slopes = volume.first(places(3000))
    share = (np.linalg.det(slopes) < 0.0).mean()
    assert 0.16 < share < 0.19
    found = invert(volume, points)
    assert (~found.converged).mean() <= 0.01
    assert found.residual[found.converged].max() < 1e-8
    # Where the inverse is not unique, that is said: the flags are those of the determinant.
    there = np.linalg.det(volume.first(found.parameters)[1]) <= 0.0
    assert found.folded.any()
    assert np.array_equal(found.folded, there)


def test_a_point_outside_has_not_converged_and_gets_the_nearest_point_of_a_face() -> None:
    volume = noisy(0.1)
    away = np.random.default_rng(1).normal(size=(100, 3))
    points = 3.0 * away / np.linalg.norm(away, axis=1, keepdims=True)
    found = invert(volume, points)
    assert not found.converged.any()
    assert ((found.parameters == 0.0) | (found.parameters == 1.0)).any(axis=1).all()
    axis = np.linspace(0.0, 1.0, 25)
    ends = [[axis, axis, np.array([end])] for end in (0.0, 1.0)]
    faces = [volume.grid(*np.roll(np.array(one, object), k)) for one in ends for k in range(3)]
    surface = np.concatenate([face.reshape(-1, 3) for face in faces])
    nearest = np.linalg.norm(points[:, None] - surface, axis=2).min(axis=1)
    assert (found.residual <= 1.03 * nearest).all()


def test_points_on_faces_edges_and_corners_are_exact_in_8_steps() -> None:
    volume = noisy(0.1)
    face = np.column_stack([np.zeros(100), places(100)[:, 1:]])
    edge = np.column_stack([np.ones(100), np.zeros(100), places(100)[:, 0]])
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    at = np.concatenate([face, edge, corners])
    found = invert(volume, volume.at(at))
    assert found.converged.all()
    assert found.steps.max() <= 8
    assert np.abs(found.parameters - at).max() < 1e-9


@pytest.mark.parametrize("method", ["auto", "general", "thesis"])
def test_a_start_at_the_solution_takes_no_step(method: Method) -> None:
    volume = Volume(GREVILLE, BASES)  # of which the affine guess is the answer
    found = invert(volume, volume.at(places(100)), method=method)
    assert not found.steps.any()
    assert found.converged.all()
    assert np.isfinite(found.parameters).all()


@pytest.mark.parametrize("scale", [1e-140, 1e-9, 1e9, 1e140])
def test_the_unit_changes_neither_the_steps_nor_the_answer(scale: float) -> None:
    here = noisy(0.2)
    there = Volume(scale * here.control, BASES)
    metres = invert(here, here.at(places(300)))
    found = invert(there, there.at(places(300)))
    assert np.array_equal(found.steps, metres.steps)
    assert found.converged.all()
    assert np.allclose(found.parameters, metres.parameters, rtol=0, atol=1e-9)
    assert np.array_equal(found.folded, metres.folded)
