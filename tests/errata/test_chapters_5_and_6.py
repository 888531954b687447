import numpy as np
import pytest

from palpate.core.splines.spline_volumes import upright_parallelepiped


def test_a_lattice_about_a_centroid_begins_half_its_size_before_it():
    points = np.random.default_rng(0).uniform(-1, 1, (2000, 3)) * [3, 2, 1] + 5.0
    size = np.array([6.0, 4.0, 2.0])
    middle = np.full(3, 5.0)
    printed = upright_parallelepiped(middle - size, size).local(points)  # step 2 of section 5.4
    right = upright_parallelepiped(middle - size / 2, size).local(points)
    assert (printed > 1.0).any(axis=1).mean() > 0.8
    assert ((right >= 0.0) & (right <= 1.0)).all()


def test_points_are_scaled_by_the_lattice_and_not_by_the_shape():
    # (5.1) divides by the size of the shape; a lattice with a margin is larger.
    shape, lattice, corner = 2.0, 2.4, -1.2
    x = np.array([-1.0, 1.0])
    printed = 2.0 / shape * (x - corner) - 1.0
    right = 2.0 / lattice * (x - corner) - 1.0
    assert printed.max() == pytest.approx(1.2)
    assert np.abs(right).max() == pytest.approx(1.0 / 1.2)
    frame = upright_parallelepiped(np.full(3, corner), np.full(3, lattice))
    assert np.allclose(2.0 * frame.local(np.tile(x[:, None], 3))[:, 0] - 1.0, right)


def test_of_three_steps_that_are_called_separable_one_is():
    kappa, change = np.meshgrid(np.linspace(0.1, 2, 5), np.linspace(0.1, 3, 6))
    exponential = np.exp(0.5 * kappa + 0.2 * change)
    inverse = 1.0 / (0.5 * kappa + 0.2 * change) ** 2
    logarithmic = 1.0 / np.log(2.0 + 0.5 * kappa + 0.2 * change)
    ranks = [np.linalg.matrix_rank(s, tol=1e-6) for s in (exponential, inverse, logarithmic)]
    assert ranks[0] == 1
    assert min(ranks[1:]) > 1
    # And without its minus signs the first grows with the curvature.
    assert (np.diff(exponential, axis=1) > 0.0).all()
    assert np.linalg.matrix_rank(np.exp(-0.5 * kappa) * np.exp(-0.2 * change), tol=1e-6) == 1
