from __future__ import annotations

import numpy as np

from palpate.core.rebuild.lattice.sparse_solve import second_differences, solve_sparse
from palpate.core.splines.lattice import box_lattice

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
