from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import Conic
from palpate.core.rebuild.ends.ends import End
from palpate.core.rebuild.felt.end_middle import with_felt_middle
from palpate.core.rebuild.felt.felt_points import FeltPoints

RIM, HEIGHT, RADIUS = 0.06, 0.07, 0.008
TURNS = 2.0 * np.pi * np.arange(48) / 48
ROW = RADIUS * np.column_stack([np.cos(TURNS), np.sin(TURNS)])


def _end(middle: Floats) -> End:
    return End("conic", RIM, HEIGHT, 0.0, Conic(0.0), middle, True)


def _felt(lean: Floats, turns: Floats = TURNS) -> FeltPoints:
    """Half an ellipsoid on the row, sheared by a lean."""
    way, at = (one.ravel() for one in np.meshgrid(np.linspace(0.1, 0.95, 9), turns))
    out = np.column_stack([np.cos(at), np.sin(at)])
    share = np.sqrt(1.0 - way**2)
    places = RADIUS * share[:, None] * out + way[:, None] * lean
    # The gradient of (|xy - way lean| / RADIUS)^2 + way^2.
    level = 2.0 * share[:, None] * out / RADIUS
    upward = (2.0 * way - level @ lean) / (HEIGHT - RIM)
    normals = np.column_stack([level, upward])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = np.column_stack([places, RIM + way * (HEIGHT - RIM)])
    return FeltPoints(points, normals, np.zeros(len(points), np.intp))


@pytest.mark.parametrize("told", [[0.0, 0.0], [0.006, -0.004]])
def test_an_end_leans_as_it_was_felt_and_not_as_the_contours_do(told: list[float]) -> None:
    lean = np.array([-0.003, 0.002])
    found = with_felt_middle(_end(np.array(told)), ROW, _felt(lean))
    assert found.middle == pytest.approx(lean, abs=0.6e-3)


def test_one_side_alone_tells_of_its_own_direction() -> None:
    lean = np.array([-0.003, 0.002])
    found = with_felt_middle(_end(np.zeros(2)), ROW, _felt(lean, np.linspace(-0.2, 0.2, 9)))
    assert found.middle[0] == pytest.approx(lean[0], abs=1e-3)
    assert abs(found.middle[1]) < abs(lean[1])


def test_an_end_that_nobody_felt_stays_where_it_is() -> None:
    felt = _felt(np.zeros(2))
    below = FeltPoints(felt.points - np.array([0.0, 0.0, 0.02]), felt.normals, felt.touch)
    told = _end(np.array([0.004, 0.0]))
    assert with_felt_middle(told, ROW, below) is told
    level = replace(told, height=RIM)
    assert with_felt_middle(level, ROW, felt) is level


def test_a_middle_far_outside_is_not_believed() -> None:
    told = _end(np.zeros(2))
    assert with_felt_middle(told, ROW, _felt(np.array([0.03, 0.0]))) is told
