from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.explore.grasp.object_frame import mass_properties
from tests.studies import grasping as bench_grasp
from tests.studies.grasping import grasp, grasp_rows, judge_frame
from tests.studies.objects import GRASPED_OBJECTS


@pytest.mark.parametrize("name", GRASPED_OBJECTS)
def test_an_object_is_closed_and_stands_about_the_origin(name):
    vertices, faces = GRASPED_OBJECTS[name]().mesh(3)
    body = mass_properties(vertices, faces)
    assert 2e-5 < body.volume < 4e-4
    assert np.abs(vertices).max() < 0.06


def test_a_tilted_cylinder_is_judged_right():
    c, s = math.cos(0.4), math.sin(0.4)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    outcome = judge_frame(grasp("cylinder", turn, 0.5, 0.0, 0), 60)
    assert outcome.right and not outcome.ambiguous
    assert outcome.axis < 0.5
    assert outcome.centre < 5e-4


def test_a_ball_is_right_if_it_is_reported_to_be_ambiguous():
    outcome = judge_frame(grasp("ball", np.eye(3), 0.5, 0.0, 0), 60)
    assert outcome.right and outcome.ambiguous


def test_the_rows_are_told_apart_and_hold(monkeypatch):
    monkeypatch.setattr(bench_grasp, "GRASPED_OBJECTS", {"cylinder": GRASPED_OBJECTS["cylinder"]})
    monkeypatch.setattr(bench_grasp, "COUNTS", (30,))
    rows = list(grasp_rows(quick=True))
    names = [row.name for row in rows]
    assert len(names) == len(set(names)) == 4 * 6 + 2
    assert all(row.holds for row in rows)
