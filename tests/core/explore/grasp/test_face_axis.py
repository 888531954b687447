from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.face_axis import face_axis

UP = np.array([0.0, 0.0, 1.0])
ROUND = np.random.default_rng(0).normal(size=(60, 3))
ROUND /= np.linalg.norm(ROUND, axis=1, keepdims=True)


def leaning(degrees: float) -> Floats:
    lean = math.radians(degrees)
    return np.array([math.sin(lean), 0.0, math.cos(lean)])


def box(degrees: float) -> Floats:
    """Normals of the sides of a box that leans."""
    across, along = leaning(degrees + 90.0), np.array([0.0, 1.0, 0.0])
    return np.concatenate([np.tile(one, (8, 1)) for one in (across, -across, along, -along)])


def test_a_level_face_of_an_object_whose_middles_lean_says_the_vertical() -> None:
    found = face_axis(leaning(20.0), leaning(0.5), ROUND)
    assert found is not None
    assert np.array_equal(found, UP)


def test_the_face_of_a_box_says_its_axis() -> None:
    found = face_axis(UP, leaning(12.0), box(12.0))
    assert found == pytest.approx(leaning(12.0))


def test_the_oblique_top_of_an_upright_column_does_not() -> None:
    assert face_axis(UP, leaning(12.0), box(0.0)) is None


def test_the_flank_of_a_round_object_does_not() -> None:
    assert face_axis(UP, leaning(30.0), ROUND) is None


@pytest.mark.parametrize("degrees", [0.0, 25.0])
def test_a_face_square_to_the_axis_says_nothing_new(degrees: float) -> None:
    assert face_axis(leaning(degrees), leaning(degrees + 0.5), box(degrees)) is None
    assert face_axis(UP, leaning(2.0), box(2.0)) is None
