import numpy as np
import pytest

from palpate.core.splines.bases import clamped_basis
from palpate.core.splines.curve_fits import closed_curve_points
from palpate.core.splines.inversion import invert_points
from palpate.core.splines.spline_volumes import Parallelepiped, SplineVolume
from palpate.core.thesis.spline_methods import (
    fit_closed_curve_thesis,
    fit_closed_thesis,
    invert_thesis,
)

AT = np.random.default_rng(0).random((500, 3))
TURN = 2 * np.pi * np.arange(40) / 40
CIRCLE = np.column_stack([np.cos(TURN), np.sin(TURN)])


def noisy(amplitude, seed=0):
    """A deformed volume; the amplitude is in quarters of its size, as in the published figures."""
    bases = clamped_basis(7), clamped_basis(7), clamped_basis(9)
    control = Parallelepiped(-np.ones(3), 2.0 * np.eye(3)).greville_control(bases)
    noise = np.random.default_rng(seed).normal(size=control.shape)
    return SplineVolume(control + 0.5 * amplitude * noise, bases)


def test_constraints_and_pseudo_vertices_of_clamped_knots_contradict_each_other():
    fit = fit_closed_thesis(CIRCLE, np.arange(40) / 40, 16)
    first, last = closed_curve_points(fit.control, fit.knots, np.array([0.0, 1.0]))
    assert np.linalg.norm(first - last) > 0.05


def test_a_curve_has_its_vertices_and_none_goes_around_one_place():
    assert fit_closed_curve_thesis(CIRCLE).control.shape == (16, 2)
    with pytest.raises(ValueError, match="at least 2 places, got 1"):
        fit_closed_curve_thesis(np.ones((5, 2)))


def test_inversion_takes_no_step_from_the_solution_and_no_points_have_no_parameters():
    volume = noisy(0.0)  # of which the affine guess is the answer
    found = invert_thesis(volume, volume.at(AT))
    assert not found.steps.any()
    assert found.converged.all()
    assert [len(part) for part in invert_thesis(volume, np.zeros((0, 3)))] == [0] * 5


def test_the_thesis_finds_the_same_parameters_where_it_converges():
    volume = noisy(0.1)
    found = invert_thesis(volume, volume.at(AT))
    assert found.converged.mean() > 0.99
    off = np.abs(found.parameters - AT)[found.converged]
    assert off.max() < 1e-5
    assert found.steps.max() > 1


def test_the_thesis_fails_where_the_volume_folds():
    volume = noisy(0.8, seed=1)
    points = volume.at(AT)
    assert invert_thesis(volume, points).converged.mean() < 0.7
    assert invert_points(volume, points).converged.mean() > 0.99


def test_the_thesis_gives_up_where_its_matrix_is_singular():
    volume = noisy(0.1)
    flat = SplineVolume(volume.control * [1.0, 1.0, 0.0], volume.bases)
    found = invert_thesis(flat, flat.at(AT) + [0.0, 0.0, 0.1])
    assert not found.converged.any()
    assert np.isfinite(found.parameters).all()
    assert np.isfinite(found.residual).all()
