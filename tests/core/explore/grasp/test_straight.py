from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.straight import straight_axis
from palpate.core.rotation import rotations_of_vectors

UP = np.array([0.0, 0.0, 1.0])
GUESS = np.array([math.sin(0.05), 0.0, math.cos(0.05)])


def _sides(turns: ArrayLike, lean: float = 0.0) -> Floats:
    """Normals that lean up and down by as much."""
    turns = np.asarray(turns, np.float64)
    leans = lean * np.linspace(-1.0, 1.0, len(turns))
    level = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.column_stack([np.cos(leans)[:, None] * level, np.sin(leans)])


def _box(count: int = 24) -> Floats:
    sides = _sides(0.5 * np.pi * (np.arange(count) % 4))
    corners = _sides(np.arange(6.0), lean=0.3)
    return np.concatenate([sides, corners, np.tile(UP, (6, 1))])


def test_the_axis_of_a_box_is_found_beside_a_guess() -> None:
    turn = rotations_of_vectors(np.array([[0.4, -0.7, 0.2]]))[0]
    found = straight_axis(_box() @ turn.T, turn @ GUESS)
    assert found is not None
    assert found == pytest.approx(turn @ UP, abs=2e-3)


def test_a_round_surface_has_no_straight_sides() -> None:
    assert straight_axis(_sides(np.arange(40.0), lean=1.2), GUESS) is None


def test_sides_that_taper_evenly_are_not_straight() -> None:
    turns = 0.5 * np.pi * (np.arange(24) % 4)
    tapered = np.column_stack([np.cos(turns), np.sin(turns), np.full(24, 0.1)])
    tapered /= np.linalg.norm(tapered, axis=1)[:, None]
    assert straight_axis(tapered, UP) is None


def test_two_opposite_faces_leave_the_axis_free_to_turn() -> None:
    assert straight_axis(_sides(np.pi * np.arange(24)), UP) is None


def test_a_few_contacts_say_nothing() -> None:
    assert straight_axis(_box(8), GUESS) is None
