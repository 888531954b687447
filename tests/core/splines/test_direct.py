from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines.direct import pull_points
from palpate.core.splines.lattice import Lattice, box_lattice

COUNTS = (5, 4, 6)
RNG = np.random.default_rng(0)
WEIGHTS = RNG.uniform(0.3, 3.0, COUNTS)


def plain() -> Lattice:
    return box_lattice(np.array([-1.0, 2.0, 0.0]), np.array([2.0, 1.0, 3.0]), COUNTS)


def weighted() -> Lattice:
    lattice = plain()
    return lattice.with_control(lattice.control + 0.02 * RNG.normal(size=(*COUNTS, 3)), WEIGHTS)


def places(count: int) -> Floats:
    return np.asarray(
        [-1.0, 2.0, 0.0] + [2.0, 1.0, 3.0] * np.random.default_rng(1).random((count, 3))
    )


@pytest.mark.parametrize("make", [plain, weighted])
@pytest.mark.parametrize("count", [1, 2, 12])
def test_points_go_to_their_targets(make: Callable[[], Lattice], count: int) -> None:
    points = places(count)
    targets = points + 0.1 * RNG.normal(size=(count, 3))
    pulled = pull_points(make(), points, targets)
    assert np.allclose(pulled.lattice.deform(points), targets, rtol=0, atol=1e-10)
    assert pulled.residual.max() < 1e-10
    assert pulled.rank == count
    assert pulled.condition >= 1.0


def test_no_smaller_change_of_the_control_points_would_do() -> None:
    lattice, points = weighted(), places(5)
    targets = points + 0.1 * RNG.normal(size=(5, 3))
    change = (pull_points(lattice, points, targets).lattice.control - lattice.control).reshape(
        -1, 3
    )
    shares = lattice.volume.shares(lattice.local(points)).toarray()
    wanted = np.linalg.pinv(shares) @ (targets - lattice.deform(points))
    assert np.allclose(change, wanted, rtol=0, atol=1e-12)


def test_only_control_points_that_reach_a_point_move() -> None:
    lattice = box_lattice(np.zeros(3), np.ones(3), (8, 4, 4))
    pulled = pull_points(lattice, np.array([[0.05, 0.5, 0.5]]), np.array([[0.05, 0.5, 0.6]]))
    moved = np.abs(pulled.lattice.control - lattice.control).max(axis=(1, 2, 3))
    assert (moved[:4] > 0.0).all()
    assert not moved[4:].any()


def test_a_point_pulled_two_ways_goes_between_them_and_that_is_said() -> None:
    points = np.repeat(places(1), 2, axis=0)
    pulled = pull_points(plain(), points, points + [[0, 0, 0.2], [0, 0, -0.1]])
    assert pulled.rank == 1
    assert np.allclose(pulled.residual, 0.15, rtol=0, atol=1e-12)
    assert np.allclose(pulled.lattice.deform(points[:1]), points[:1] + [0, 0, 0.05], atol=1e-12)


def test_more_points_than_control_points_are_met_as_well_as_can_be() -> None:
    lattice, points = plain(), places(600)
    targets = points + 0.05 * np.sin(9 * points)
    pulled = pull_points(lattice, points, targets)
    assert pulled.rank <= lattice.control[..., 0].size
    assert pulled.residual.max() > 1e-6
    shares = lattice.volume.shares(lattice.local(points)).toarray()
    left = pulled.lattice.deform(points) - targets
    assert np.abs(shares.T @ left).max() < 1e-10  # nothing is left that control points could do


def test_targets_where_the_points_are_move_nothing() -> None:
    lattice, points = weighted(), places(4)
    pulled = pull_points(lattice, points, lattice.deform(points))
    assert np.allclose(pulled.lattice.control, lattice.control, rtol=0, atol=1e-14)


def test_no_points_move_nothing() -> None:
    lattice = plain()
    pulled = pull_points(lattice, np.zeros((0, 3)), np.zeros((0, 3)))
    assert pulled.lattice is lattice
    assert (pulled.rank, pulled.condition, len(pulled.residual)) == (0, 1.0, 0)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_pull_is_the_same_in_any_unit(scale: float) -> None:
    points = places(4)
    targets = points + 0.1 * RNG.normal(size=(4, 3))
    low, extent = scale * np.array([-1.0, 2.0, 0.0]), scale * np.array([2.0, 1.0, 3.0])
    here = pull_points(plain(), points, targets)
    there = pull_points(box_lattice(low, extent, COUNTS), scale * points, scale * targets)
    assert there.rank == here.rank
    assert np.allclose(there.lattice.control, scale * here.lattice.control, atol=1e-12 * scale)


@pytest.mark.parametrize(
    ("points", "targets", "words"),
    [
        (np.zeros((1, 2)), np.zeros((1, 3)), r"points must have shape \(any, 3\)"),
        (np.zeros((1, 3)), np.zeros((2, 3)), r"targets must have shape \(1, 3\)"),
        (np.zeros((1, 3)), np.full((1, 3), math.nan), "targets must be finite"),
        (np.zeros((1, 3)), np.zeros((1, 3)), "points must lie in the lattice"),
    ],
)
def test_points_and_targets_that_are_none_are_refused(
    points: Floats, targets: Floats, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        pull_points(plain(), points, targets)
