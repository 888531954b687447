from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from palpate.core.rebuild.lattice.body import fit_body_lattice, second_differences, solve_sparse
from palpate.core.rebuild.reconstruction import coarse_patch
from palpate.core.rebuild.recovery.fitting import recover
from palpate.core.rebuild.recovery.report import Recovery
from palpate.core.rebuild.surface.closed import Surface, closed_surface
from palpate.core.shapes.global_deformations import Bend
from palpate.core.splines.lattices import box_lattice


@cache
def ellipsoid() -> Recovery:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(300, 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * [0.3, 0.25, 0.5]
    return recover(points)


def lobed(recovery: Recovery) -> Surface:
    """The superquadric's surface with waves on it."""
    plain = closed_surface((coarse_patch(recovery),))

    class Waves:
        def at(self, v: np.ndarray, turns: np.ndarray, by: tuple[int, int] = (0, 0)) -> np.ndarray:
            wave = 1 + 0.1 * np.cos(6 * np.pi * turns) * np.sin(np.pi * v) ** 3
            return np.asarray(plain.at(v, turns) * wave[:, None])

    return closed_surface((Waves(),))


def test_the_superquadric_itself_needs_no_deformation() -> None:
    prior = replace(ellipsoid(), taper=np.array([0.2, -0.1]), bend=Bend(0.5, 0.3))
    surface = closed_surface((coarse_patch(prior),))
    found = fit_body_lattice(prior, surface)
    assert found.rms < 1e-4
    assert np.abs(found.points - found.targets).max() < 2e-3
    assert (found.folded, found.converged, found.steps) == (0.0, True, 0)


def test_a_superquadric_becomes_a_surface_with_lobes() -> None:
    found = fit_body_lattice(ellipsoid(), lobed(ellipsoid()))
    before = np.sqrt(np.mean(np.sum((found.points - found.targets) ** 2, axis=1)))
    assert found.rms < 0.03 * before
    assert found.folded == 0.0
    assert found.lattice.deform(found.points) == pytest.approx(found.targets, abs=0.01)
    assert 1.0 < found.condition < 1e9


def test_many_control_points_are_solved_for_step_by_step() -> None:
    found = fit_body_lattice(ellipsoid(), lobed(ellipsoid()), (13, 13, 19))
    assert found.converged and found.steps > 0
    assert found.rms < 2e-4
    assert found.folded == 0.0


def test_what_cannot_be_a_lattice_is_refused() -> None:
    surface = lobed(ellipsoid())
    with pytest.raises(ValueError, match=r"counts must be at least 4 each, got \(3, 9, 9\)"):
        fit_body_lattice(ellipsoid(), surface, (3, 9, 9))
    with pytest.raises(ValueError, match="prior must be fitted, got too few points"):
        fit_body_lattice(replace(ellipsoid(), warnings=("too few points",)), surface)


def test_a_surface_through_the_middle_is_refused() -> None:
    class Spindle:
        def at(self, v: np.ndarray, turns: np.ndarray, by: tuple[int, int] = (0, 0)) -> np.ndarray:
            width = np.abs(v - 0.5 - 0.5 / 64) * np.sin(np.pi * v)
            angle = 2 * np.pi * turns
            height = np.abs(v - 0.5 - 0.5 / 64) * np.sign(v - 0.5 - 0.5 / 64)
            return np.column_stack([width * np.cos(angle), width * np.sin(angle), height])

    prior = replace(ellipsoid(), pose=np.array([0.0, 0, 0, 0, 0, 0, 1]))
    with pytest.raises(ValueError, match="surface must not pass through the middle"):
        fit_body_lattice(prior, closed_surface((Spindle(),)))


COUNTS = (5, 6, 7)


def test_second_differences_are_those_of_a_lattice() -> None:
    values = np.random.default_rng(0).normal(size=COUNTS)
    wanted = sum(np.square(np.diff(values, 2, axis=axis)).sum() for axis in range(3))
    for one, other in ((0, 1), (0, 2), (1, 2)):
        wanted += 2 * np.square(np.diff(np.diff(values, axis=one), axis=other)).sum()
    assert np.isclose(values.ravel() @ (second_differences(COUNTS) @ values.ravel()), wanted)


def test_linear_maps_bend_nothing() -> None:
    s, t, u = np.meshgrid(*(np.arange(n) for n in COUNTS), indexing="ij")
    linear = (2.0 * s - t + 0.5 * u + 3.0).ravel()
    assert np.abs(second_differences(COUNTS) @ linear).max() < 1e-12


def test_a_linear_move_is_solved_exactly_but_for_what_holds_it() -> None:
    lattice = box_lattice(np.zeros(3), np.ones(3), COUNTS)
    points = np.random.default_rng(1).random((500, 3))
    moves = points @ np.array([[0.1, 0.2, 0.0], [0.0, -0.1, 0.3], [0.0, 0.0, 0.2]])
    found = solve_sparse(lattice.volume.shares(points), moves, COUNTS)
    moved = lattice.with_control(lattice.control + found.moved.reshape(*COUNTS, 3))
    assert np.allclose(moved.deform(points) - points, moves, rtol=0, atol=1e-4)
    assert found.converged
