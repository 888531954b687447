from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.archive import arrays_from_bytes, tree_from_arrays
from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN, IDENTITY_POSE, compose_poses, pose_of, transform_points
from palpate.core.rebuild.general.solid import FARTHEST
from palpate.messages.codec import encode
from palpate.messages.types.model import ModelGoal, PlanDone, ShapeModel, Superquadric
from palpate.messages.types.motion import ContourGoal, GraspContacts, ProbeGoal
from palpate.messages.types.touch import no_move
from palpate.messages.types.world import SpaceMap
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.reconstructor import NODE, Params
from palpate.nodes.runtime.node import resolved
from palpate.nodes.runtime.testing import example
from palpate.nodes.runtime.work import CpuSteps
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec

RADIUS = 0.03
MIDDLE = np.array([0.02, -0.01, RADIUS])
LEAN = np.deg2rad(25.0)
# A frame about the ball's middle.
TILTED = np.concatenate([MIDDLE, [np.sin(LEAN / 2), 0.0, 0.0, np.cos(LEAN / 2)]])
UPRIGHT = np.array([0.02, -0.01, 0.0, 0.0, 0.0, 0.0, 1.0])
Heard = list[tuple[str, Any]]


def contour_goal(number: int, frame: Floats, height: float) -> ContourGoal:
    return ContourGoal(
        id=number, finger=1, frame=frame, height=height, centre=np.zeros(2), radius=0.1,
        not_before=0.0,
    )  # fmt: skip


def probe_goal(number: int, frame: Floats, pose: Floats) -> ProbeGoal:
    return ProbeGoal(
        id=number, finger=1, pose=compose_poses(frame, pose), reach=0.15, not_before=0.0
    )  # fmt: skip


def along(frame: Floats, low: float, high: float) -> list[ContourGoal | ProbeGoal]:
    """Three slices, and a touch from each end along the axis, but that on which it stands."""
    heights = np.linspace(low + 0.006, high - 0.006, 3)
    goals: list[ContourGoal | ProbeGoal] = [
        contour_goal(number, frame, float(height)) for number, height in enumerate(heights)
    ]
    goals.append(probe_goal(3, frame, pose_of(np.array([0.001, 0.0, high + 0.05]), FACING_DOWN)))
    if low < 0.0:
        goals.append(probe_goal(4, frame, pose_of(np.array([0.0, 0.001, low - 0.05]), np.eye(3))))
    return goals


def felt_by(goals: Iterable[ContourGoal | ProbeGoal]) -> Heard:
    """Everything that a finger says while it feels a ball, one goal after the other."""
    ball = ObjectSpec(
        superquadric=SuperquadricSpec(size=(RADIUS,) * 3, exponents=(1.0, 1.0)),
        pose=PoseSpec(position=(MIDDLE[0], MIDDLE[1], MIDDLE[2])),
    )
    effects = {"pose_error": {"sigma": 2e-5}}
    params = {module: module.NODE.params() for module in (filter, curvature, tracer)}
    params[simulator] = simulator.Params(object=ball, effects=effects)
    states, waiting, published = {}, deque[tuple[str, Any]](), []
    for module in (simulator, filter, curvature, tracer):
        states[module], outputs = module.NODE.start(params[module])
        waiting.extend(outputs)
    asked = deque(goals)
    while waiting or asked:
        if not waiting:
            goal = asked.popleft()
            topic = "/contour/goal" if isinstance(goal, ContourGoal) else "/probe/goal"
            waiting.append((topic, goal))
        topic, message = waiting.popleft()
        published.append((topic, message))
        for module in states:
            if topic in module.NODE.inputs:
                handler = module.NODE.inputs[topic][1]
                states[module], outputs = handler(params[module], states[module], message)
                waiting.extend((where, resolved(one)) for where, one in outputs)  # type: ignore[misc]
    return [one for one in published if one[0] in NODE.inputs]


def model_goal(number: int, contours: Sequence[int], probes: Sequence[int]) -> ModelGoal:
    return ModelGoal(
        number=number, contours=tuple(contours), probes=tuple(probes), closings=0, touches=19,
        robot_time=30.0,
    )  # fmt: skip


def plan_done(number: int, contours: Sequence[int], probes: Sequence[int]) -> PlanDone:
    return PlanDone(
        number=number, contours=tuple(contours), probes=tuple(probes), touches=19,
        robot_time=30.0, reason="enough", reached=None, rms_bound_95=None,
        largest_untouched=None, uncovered=0.0,
    )  # fmt: skip


@cache
def tilted() -> tuple[tuple[str, Any], ...]:
    """Messages of a ball in a tilted frame, with a goal after each contour but the first."""
    felt = felt_by(along(TILTED, -RADIUS, RADIUS))
    at = [i for i, (topic, _) in enumerate(felt) if topic == "/contour/traced"]
    felt.insert(at[2] + 1, ("/model/goal", model_goal(2, [1, 0, 2], [])))
    felt.insert(at[1] + 1, ("/model/goal", model_goal(1, [1, 0], [])))
    return (*felt, ("/plan/done", plan_done(3, [1, 0, 2], [3, 4])))


@cache
def told() -> tuple[Any, ...]:
    """What the node says to it."""
    return tuple(models(tilted()))


def test_the_steps_of_a_model_are_told_one_after_the_other(inputs: Heard):
    steps = CpuSteps()
    state, _ = NODE.start(Params())
    for topic, message in inputs:
        state, outputs = NODE.inputs[topic][1](Params(), state, message)
        later = [one for where, one in outputs if where == "/model/shape"]  # type: ignore[misc]
        if later:
            break
    later[0].make(steps)
    wanted = {"contours", "radial spline", "ends", "loft", "bound", "mesh"}
    assert wanted <= set(steps.seconds)
    assert all(seconds > 0.0 for seconds in steps.seconds.values())


@pytest.fixture
def inputs() -> Heard:
    return list(tilted())


def models(messages: Iterable[tuple[str, Any]]) -> list[Any]:
    """The models that the node publishes of these messages, in this order."""
    return [one for one in everything(messages) if not isinstance(one, SpaceMap)]


def everything(messages: Iterable[tuple[str, Any]]) -> list[Any]:
    """What the node says to these messages, in this order."""
    state, _ = NODE.start(Params())
    published: list[Any] = []
    for topic, message in messages:
        state, outputs = NODE.inputs[topic][1](Params(), state, message)
        for where, model in outputs:  # type: ignore[misc]
            published.append(resolved(model))
            assert type(published[-1]) is NODE.outputs[where]
    return published


def contacts(number: int, count: int = 12) -> GraspContacts:
    rng = np.random.default_rng(number)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return example(
        GraspContacts,
        number=number,
        points=MIDDLE + RADIUS * normals,
        normals=normals,
        fingers=np.zeros(count, np.int32),
        move=no_move(),
        robot_time=1.0,
    )


def grasps(closings: int, *order: int) -> Heard:
    goal = replace(model_goal(0, [], []), closings=closings)
    return [("/model/goal", goal), *(("/hand/contacts", contacts(number)) for number in order)]


def test_each_goal_gets_one_model_of_exactly_its_set(inputs: Heard):
    goals = [m for t, m in inputs if t in ("/model/goal", "/plan/done")]
    published = told()
    assert [model.number for model in published] == [goal.number for goal in goals]
    assert [model.contours for model in published] == [goal.contours for goal in goals]
    assert [model.final for model in published] == [False, False, True]


def test_a_model_can_be_sent_and_is_closed():
    last = told()[-1]
    assert encode(last)
    edges = np.sort(last.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_a_solid_sliced_along_a_tilted_axis_is_where_the_object_is():
    last = told()[-1]
    off = np.linalg.norm(last.vertices - MIDDLE, axis=1) - RADIUS
    assert np.abs(off).max() < 2e-4
    assert np.array_equal(last.frame, TILTED)
    along_axis = last.uncertainty_height
    assert -RADIUS <= along_axis.min() < -0.02 and 0.02 < along_axis.max() <= RADIUS
    away = np.linalg.norm(last.control.reshape(-1, 3) - MIDDLE, axis=1)
    assert away.max() < 3.0 * RADIUS


def test_both_ends_of_a_tilted_axis_are_those_that_were_probed():
    without, both = told()[1:]
    assert (without.health["uncovered_below"], without.health["uncovered_above"]) > (0.0, 0.0)
    assert both.health["uncovered_below"] == both.health["uncovered_above"] == 0.0
    rms = float(np.sqrt(np.mean((np.linalg.norm(both.vertices - MIDDLE, axis=1) - RADIUS) ** 2)))
    assert rms / 4.0 < both.deviation < without.deviation


def test_an_upright_object_is_touched_by_the_platform_on_which_it_stands():
    felt = felt_by(along(UPRIGHT, 0.0, 2.0 * RADIUS))
    [model] = models([*felt, ("/plan/done", plan_done(1, [0, 1, 2], [3]))])
    assert model.health["uncovered_below"] == 0.0
    assert model.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert np.array_equal(model.frame, UPRIGHT)


def test_the_platform_tells_nothing_of_a_tilted_axis(inputs: Heard):
    lower = replace(next(m for t, m in inputs if t == "/world"), platform=-0.02)
    moved = [(t, lower if t == "/world" else m) for t, m in inputs]
    for one, other in zip(models(moved), told(), strict=True):
        assert one.method == other.method == "lattice"
        assert np.array_equal(one.vertices, other.vertices)
        assert np.array_equal(one.control, other.control)


def test_a_map_goes_with_each_model_and_grows(inputs: Heard):
    maps = [one for one in everything(inputs) if isinstance(one, SpaceMap)]
    assert [one.number for one in maps] == [1, 2, 3]
    free, touched = ([int((one.states == state).sum()) for one in maps] for state in (1, 2))
    assert 0 < free[0] < free[1] < free[2] and 0 < touched[0] < touched[1] < touched[2]
    last = maps[-1]
    for state, least, most in ((1, RADIUS, np.inf), (2, RADIUS - 0.004, RADIUS + 0.004)):
        places = np.argwhere(last.states == state) * last.step + last.low
        away = np.linalg.norm(places - MIDDLE, axis=1)
        assert least < away.min() and away.max() < most


def test_touches_are_predicted_before_they_are_used():
    first, _, last = told()
    assert first.predicted == {} and set(last.predicted) == {"lattice"}
    assert all(0.0 < one <= FARTHEST for one in last.predicted.values())
    assert len(last.vertex_errors) == len(last.vertex_distances) == len(last.vertices)
    assert (last.vertex_bounds >= last.vertex_errors).all()


def test_a_probe_that_missed_touches_no_end(inputs: Heard):
    probe = next(m for t, m in inputs if t == "/probe/traced" and m.id == 3)
    missed = replace(
        probe, outcome="miss", point=transform_points(TILTED, np.array([[0, 0, 0.2]]))[0]
    )
    others = [(t, missed if m is probe else m) for t, m in inputs]
    last = models(others)[-1]
    assert np.linalg.norm(last.vertices - MIDDLE, axis=1).max() < 1.2 * RADIUS


def test_the_archive_of_the_final_model_is_the_solid():
    last = told()[-1]
    solid = tree_from_arrays(arrays_from_bytes(last.archive))
    assert np.array_equal(solid.frame, TILTED)
    grid = solid.control_lattice.control
    assert np.array_equal(grid, last.control)


def test_contours_of_two_frames_are_refused_with_a_sentence(inputs: Heard):
    others = [
        (t, replace(m, frame=IDENTITY_POSE) if t == "/contour/traced" and m.id == 2 else m)
        for t, m in inputs
    ]
    last = models(others)[-1]
    assert last.method == "general" and last.dropped == (1, 0, 2)
    assert np.abs(np.linalg.norm(last.vertices - MIDDLE, axis=1) - RADIUS).max() < 5e-3
    assert set(last.dropped_reasons) == {
        "contours must be traced in one slicing frame, but that of contour 2 is not that of "
        "contour 1"
    }
    assert encode(last)


def test_goals_before_their_touches_wait_for_them(inputs: Heard):
    info = [one for one in inputs if one[0] in ("/world", "/touch/info")]
    goals = [one for one in inputs if one[0] in ("/model/goal", "/plan/done")]
    rest = [one for one in inputs if one[0] not in NODE.needs and one not in goals]
    early = models(info + goals + rest)
    assert [encode(one) for one in early] == [encode(one) for one in told()]


def test_touches_after_everything_else_complete_the_sets(inputs: Heard):
    patches = [one for one in inputs if one[0] == "/touch/patch"]
    before = [one for one in inputs if one[0] != "/touch/patch"]
    late = models(before + patches)
    assert [encode(one) for one in late] == [encode(one) for one in told()]


def test_a_set_that_lacks_a_touch_is_not_fitted(inputs: Heard):
    last = max(i for i, (topic, _) in enumerate(inputs) if topic == "/touch/patch")
    assert len(models(inputs[:last] + inputs[last + 1 :])) == 2


def test_nothing_to_rebuild_gives_an_empty_model():
    [model] = models([("/plan/done", plan_done(1, [], []))])
    assert (len(model.vertices), model.final, model.touches) == (0, True, 19)
    assert np.array_equal(model.frame, IDENTITY_POSE) and model.deviation == 0.0
    assert model.predicted == {} and len(model.vertex_errors) == 0
    assert encode(model)


def test_a_goal_without_contours_gets_the_superquadric_of_the_hand():
    [coarse] = models(grasps(4, 0, 1, 2, 3))
    assert isinstance(coarse, Superquadric) and encode(coarse)
    assert coarse.size == pytest.approx([RADIUS] * 3, rel=0.02)
    assert coarse.pose[:3] == pytest.approx(MIDDLE, abs=5e-4)
    assert coarse.residuals.shape == (48,) and coarse.residual < 1e-5
    assert (coarse.number, coarse.bend) == (0, 0.0)


def test_closings_may_be_received_in_any_order_and_all_are_waited_for():
    wanted = [encode(one) for one in models(grasps(4, 0, 1, 2, 3))]
    goal, *closings = grasps(4, 3, 1, 0, 2)
    assert [encode(one) for one in models([*closings, goal])] == wanted
    assert [encode(one) for one in models([*closings[:2], goal, *closings[2:]])] == wanted
    assert models(grasps(4, 3, 1, 2)) == []


def test_later_closings_do_not_count():
    wanted = [encode(one) for one in models(grasps(3, 0, 1, 2))]
    assert [encode(one) for one in models(grasps(3, 3, 2, 1, 0))] == wanted


def test_a_hand_that_met_nothing_tells_so():
    nothing = ("/hand/contacts", contacts(0, 0))
    goal = grasps(1)[0]
    [coarse] = models([nothing, goal])
    assert coarse.warnings == ("too few points",) and encode(coarse)


def test_models_follow_their_numbers_whatever_they_are_of(inputs: Heard):
    goal, *closings = grasps(2, 0, 1)
    published = models([*inputs[:2], goal, *inputs[2:], *closings])
    assert [type(one) for one in published] == [Superquadric, *[ShapeModel] * 3]
    assert [one.number for one in published] == [0, 1, 2, 3]


def test_each_finger_has_its_own_touches_but_the_hand_is_one():
    assert NODE.fan_in == ("/touch/patch", "/contour/traced", "/probe/traced")
