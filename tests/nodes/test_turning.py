"""An object that is turned over: what simulator, planner and reconstructor make of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.explore import Lying
from palpate.core.poses import Pose
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general import rebuild_general
from palpate.core.robot_time import ROBOT_PRESETS, MoveGeometry, move_durations
from palpate.core.shapes import Superquadric
from palpate.messages.types import ShapeModel, TouchGoal, TurnGoal
from palpate.nodes.planning.knowledge import lying_of
from palpate.nodes.rebuilding.candidates import Placements
from palpate.nodes.rebuilding.placements import mistaken_error
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.simulator import NODE, Params
from palpate.nodes.specs.objects import ObjectSpec, SuperquadricSpec
from tests.nodes.test_simulator import goal, grasp

BRICK = ObjectSpec(superquadric=SuperquadricSpec(size=(0.03, 0.02, 0.012), exponents=(0.2, 0.2)))
ON_ITS_SIDE = Pose(np.array([0.0, 0.0, 0.02]), np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
TURN = TurnGoal(placement=1, pose=ON_ITS_SIDE.array, not_before=50.0)
FROM_ABOVE = np.array([0.0, 0.0, 0.06, 1.0, 0.0, 0.0, 0.0])


def published(*inputs: tuple[str, Any], **params: Any) -> list[tuple[str, Any]]:
    return drive(NODE, inputs, Params(object=BRICK, **params))


def touch(**changes: Any) -> tuple[str, TouchGoal]:
    return "/finger/goal", goal(pose=FROM_ABOVE, reach=0.1, **changes)


def test_touch_meets_the_object_as_it_lies_and_waits_for_its_turn():
    turn, asked = ("/hand/turn", TURN), touch(placement=1)
    before, after = messages_on(published(touch(), turn, touch(touch=1, placement=1)), "/touch/raw")
    # It stands on its platform 12 mm below its middle, and is 24 mm high, then 40.
    assert before.pose[2] == pytest.approx(0.012 - 1e-3, abs=1e-4)
    assert after.pose[2] == pytest.approx(-0.012 + 0.04 - 1e-3, abs=3e-4)
    outputs = published(turn, asked, ("/hand/goal", grasp()))
    [turned], [contacts] = (messages_on(outputs, f"/hand/{one}") for one in ("turned", "contacts"))
    placements = [one.placement for one in (before, after, turned, contacts)]
    assert placements == [0, 1, 1, 1]
    first, late = (messages_on(one, "/touch/raw") for one in (outputs, published(asked, turn)))
    assert len(first) == len(late) == 1 and np.array_equal(first[0].array, late[0].array)
    assert messages_on(published(asked), "/touch/raw") == []
    assert turned.move[0] == 50.0  # it waited for the decision
    moves = MoveGeometry.of_rows(turned.move[None])
    spent = float(move_durations(moves, ROBOT_PRESETS["modern"]).total()[0])
    assert turned.robot_time == pytest.approx(spent) and spent > 55.0
    assert published(turn, finger=2, fingers=2) == []  # only the first finger tells


def model(**changes: Any) -> ShapeModel:
    return replace(example(ShapeModel), placements=np.zeros((0, 7)), **changes)


def test_planner_takes_the_pose_of_the_last_placement_or_says_why_there_is_none():
    lying = Lying(1, None)
    located = lying_of(replace(model(), placements=ON_ITS_SIDE.array[None]), lying)
    assert located.pose is not None and located.pose.array == pytest.approx(ON_ITS_SIDE.array)
    why = lying_of(model(placement_faults=("contacts fit the solid nowhere",)), lying)
    assert why.pose is None and why.fault.endswith("turned: contacts fit the solid nowhere")
    assert lying_of(model(), Lying()) == Lying()
    assert lying_of(model(), Lying(1, None, is_turning=True)).fault == ""


def test_looking_alike_costs_nothing_unless_later_touches_would_be_misplaced():
    mesh = Superquadric(np.array([0.028, 0.02, 0.016]), np.array([1.0, 1.0])).mesh(4)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(mesh.vertices), 60, replace=False)
    away = np.linalg.norm(mesh.vertices - mesh.vertices[chosen][:, None], axis=2)
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.vertices)
    np.add.at(normals, mesh.faces.ravel(), np.repeat(across, 3, axis=0))
    parts = [np.flatnonzero(one < 5e-3) for one in away]
    number = np.repeat(np.arange(60, dtype=np.int32), [len(one) for one in parts])
    points = np.concatenate(parts)
    solid = rebuild_general(ContactPoints(mesh.vertices[points], normals[points], number))
    unturned = Pose(np.zeros(3), np.eye(3))
    half_turn = Pose(np.zeros(3), np.diag([-1.0, -1.0, 1.0]))
    quarter = Pose(np.zeros(3), np.array([[0, -1.0, 0], [1.0, 0, 0], [0, 0, 1.0]]))
    errors = [
        mistaken_error(solid, Placements((unturned,), (1e-4,), (), (others,)))
        for others in ((), (half_turn,), (quarter,), (half_turn, quarter))
    ]
    assert errors[0] == 0.0 and errors[1] < 0.1e-3
    assert errors[2] == pytest.approx(errors[3]) and 2e-3 < errors[2] < 6e-3
