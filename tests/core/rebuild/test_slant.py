from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.slant import Slant, straight

SLANT = Slant(np.array([0.01, -0.02]), np.array([0.2, -0.1]), np.array([1.5, 0.8]))
STEP = 1e-6


def ball(v: Floats, turns: Floats) -> Floats:
    """A ball of 30 mm, (n, 3)."""
    polar, around = np.pi * v, 2.0 * np.pi * turns
    level = 0.03 * np.sin(polar)
    z = 0.05 - 0.03 * np.cos(polar)
    return np.column_stack([level * np.cos(around), level * np.sin(around), z])


def differences(v: Floats, turns: Floats, by: tuple[int, int]) -> Floats:
    """Derivatives of the ball by central differences, which are linear in it."""
    if by == (0, 0):
        return ball(v, turns)
    one = (1, 0) if by[0] else (0, 1)
    rest = by[0] - one[0], by[1] - one[1]
    ahead = differences(v + STEP * one[0], turns + STEP * one[1], rest)
    behind = differences(v - STEP * one[0], turns - STEP * one[1], rest)
    return (ahead - behind) / (2.0 * STEP)


@pytest.fixture
def places() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(0)
    return rng.uniform(0.1, 0.9, 40), rng.uniform(0.0, 1.0, 40)


def test_points_come_back_from_the_straight_space(places: tuple[Floats, Floats]) -> None:
    points = ball(*places)
    assert SLANT.slanted(SLANT.straightened(points)) == pytest.approx(points, abs=1e-15)
    assert SLANT.straightened(SLANT.slanted(points)) == pytest.approx(points, abs=1e-15)
    assert np.array_equal(SLANT.slanted(points)[:, :2], points[:, :2])


def test_what_is_level_in_the_straight_space_is_as_steep_as_it_says() -> None:
    level = np.column_stack(
        [np.random.default_rng(1).normal(0.0, 0.02, (30, 2)), np.full(30, 0.04)]
    )
    slanted = SLANT.slanted(level)
    rows = np.column_stack([np.ones(30), level[:, :2]])
    plane, left = np.linalg.lstsq(rows, slanted[:, 2], rcond=None)[:2]
    assert left == pytest.approx(0.0, abs=1e-28)
    assert plane[1:] == pytest.approx(SLANT.slopes + 0.04 * SLANT.change)
    assert np.hypot(*plane[1:]) == pytest.approx(SLANT.steepness(0.04))


@pytest.mark.parametrize("by", [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
def test_derivatives_are_those_of_the_slanted_surface(
    places: tuple[Floats, Floats], by: tuple[int, int]
) -> None:
    found = SLANT.carried(lambda order: differences(*places, order), by)
    one = (1, 0) if by[0] else (0, 1)
    rest = by[0] - one[0], by[1] - one[1]

    def below(sign: float) -> Floats:
        v, turns = places[0] + sign * STEP * one[0], places[1] + sign * STEP * one[1]
        return SLANT.carried(lambda order: differences(v, turns, order), rest)

    expected = (below(1.0) - below(-1.0)) / (2.0 * STEP)
    assert found == pytest.approx(expected, abs=1e-9 if sum(by) == 1 else 2e-3)


def test_normals_are_square_to_the_surface_on_both_sides(places: tuple[Floats, Floats]) -> None:
    tangents = [
        SLANT.carried(lambda order: differences(*places, order), by) for by in ((1, 0), (0, 1))
    ]
    normals = np.cross(tangents[1], tangents[0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    felt = FeltPoints(SLANT.slanted(ball(*places)), normals, np.zeros(40, np.int32))
    found = straight(SLANT, felt)
    assert found.points == pytest.approx(ball(*places), abs=1e-15)
    outwards = (ball(*places) - [0.0, 0.0, 0.05]) / 0.03
    assert np.asarray(found.normals) == pytest.approx(outwards, abs=1e-8)


def test_nothing_changes_without_a_slant_or_without_normals(places: tuple[Floats, Floats]) -> None:
    felt = FeltPoints(ball(*places), None, np.zeros(40, np.int32))
    assert straight(None, felt) is felt
    assert straight(SLANT, felt).normals is None
