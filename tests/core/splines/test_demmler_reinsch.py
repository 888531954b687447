from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.basis import PeriodicBasis
from palpate.core.splines.demmler_reinsch import demmler_reinsch


def system(points: Floats, count: int) -> tuple[Floats, Floats, Floats]:
    basis = PeriodicBasis(count).matrix(points).toarray()
    second = np.roll(np.eye(count), 1, 1) - 2 * np.eye(count) + np.roll(np.eye(count), -1, 1)
    weight = basis.T @ basis
    return weight / np.trace(weight) * count, second.T @ second / 6.0, basis


def test_keeping_each_mode_in_part_solves_the_penalised_system() -> None:
    rng = np.random.default_rng(0)
    points, values = rng.random(60), rng.normal(size=60)
    weight, bending, basis = system(points, 12)
    modes = demmler_reinsch(weight, bending, basis)
    scale = np.trace(basis.T @ basis) / 12
    for strength in (1e-8, 0.1, 1e3):
        wanted = np.linalg.solve(weight + strength * bending, basis.T @ values / scale)
        kept = modes.kept(np.array([strength]))[0]
        found = modes.control @ (kept * (modes.shapes.T @ values))
        assert np.allclose(found, wanted, rtol=1e-9, atol=1e-11 * np.abs(wanted).max())


def test_shapes_are_the_basis_times_their_coefficients_and_orthonormal() -> None:
    weight, bending, basis = system(np.random.default_rng(1).random(50), 10)
    modes = demmler_reinsch(weight, bending, basis)
    assert np.allclose(modes.shapes, basis @ modes.control, atol=1e-12)
    assert np.allclose(modes.shapes.T @ modes.shapes, np.eye(10), atol=1e-9)
    assert np.count_nonzero(modes.stiffness < 1e-12) == 1


def test_what_no_point_sees_drops_out() -> None:
    weight, bending, basis = system(np.linspace(0.0, 0.3, 40), 16)
    modes = demmler_reinsch(weight, bending, basis)
    assert modes.shapes.shape[1] < 16
    assert np.isfinite(modes.control).all()


def test_what_is_lost_is_exact_however_little_it_is() -> None:
    weight, bending, basis = system(np.arange(40) / 40, 10)
    modes = demmler_reinsch(weight, bending, basis)
    weak = np.array([1e-30])
    assert np.allclose(modes.lost(weak)[0], 1e-30 * modes.stiffness, rtol=1e-12)
    assert np.allclose(modes.kept(weak) + modes.lost(weak), 1.0)
