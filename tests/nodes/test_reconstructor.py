"""Reconstructor node: exactly the sets that it is asked for, of slices, touches and closings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from palpate.core.archive import arrays_from_bytes, tree_from_arrays
from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN, IDENTITY_POSE, Pose
from palpate.core.rebuild import reconstruction
from palpate.core.rebuild.general import rebuild_general
from palpate.core.rebuild.side import DetailSettings, fit_side_spline
from palpate.core.steps import no_steps
from palpate.messages import encode, types
from palpate.messages.types import ContourGoal, GraspContacts, ShapeModel, SpaceMap, Superquadric
from palpate.nodes.rebuilding.placements import contradicted
from palpate.nodes.reconstructor import NODE, Params
from palpate.nodes.runtime.node import Deferred
from palpate.nodes.runtime.testing import example
from palpate.nodes.simulator import Params as Simulated
from tests.core.rebuild.general.test_general import torus_touches
from tests.nodes import patches
from tests.nodes.loop import RADIUS, Published, ball_spec, touching
from tests.nodes.patches import INFO, ball_patches

MIDDLE = np.array([0.02, -0.01, RADIUS])
LEAN = np.deg2rad(25.0)
# A frame about the ball's middle.
TILTED = np.concatenate([MIDDLE, [np.sin(LEAN / 2), 0.0, 0.0, np.cos(LEAN / 2)]])
UPRIGHT = np.array([0.02, -0.01, 0.0, 0.0, 0.0, 0.0, 1.0])


def felt(frame: Floats, low: float, high: float) -> Published:
    """Three slices of a ball along a frame's axis, and touches of its ends but a standing one."""
    goals: Published = []
    for number, height in enumerate(np.linspace(low + 0.006, high - 0.006, 3)):
        goal = {"id": number, "finger": 1, "frame": frame, "height": float(height), "radius": 0.1}
        goals.append(("/contour/goal", example(ContourGoal, **goal)))
    ends = [Pose(np.array([0.001, 0.0, high + 0.05]), FACING_DOWN)]
    ends += [Pose(np.array([0.0, 0.001, low - 0.05]), np.eye(3))] if low < 0.0 else []
    for number, pose in enumerate(ends, 3):
        placed = (Pose.from_array(frame) @ pose).array
        goal = example(types.ProbeGoal, id=number, finger=1, pose=placed, reach=0.15)
        goals.append(("/probe/goal", goal))
    ball = ball_spec(RADIUS, tuple(MIDDLE.tolist()))
    published = touching(goals, Simulated(object=ball, effects={"pose_error": {"sigma": 2e-5}}))
    return [one for one in published if one[0] in NODE.inputs]


def goal(number: int, contours: Sequence[int] = (), probes: Sequence[int] = (), **more: Any) -> Any:
    fields = {"number": number, "contours": tuple(contours), "probes": tuple(probes)}
    return "/model/goal", example(
        types.ModelGoal, **{**fields, "touches": 19, "robot_time": 30.0, **more}
    )


def done(number: int, contours: Sequence[int] = (), probes: Sequence[int] = (), **more: Any) -> Any:
    _, asked = goal(number, contours, probes)
    fields = {name: getattr(asked, name) for name in ("number", "contours", "probes", "touches")}
    return "/plan/done", example(types.PlanDone, **{**fields, "robot_time": 30.0, **more})


@cache
def tilted() -> tuple[tuple[str, Any], ...]:
    """Messages of a ball in a tilted frame, with a goal after each contour but the first."""
    felt_points = felt(TILTED, -RADIUS, RADIUS)
    at = [i for i, (topic, _) in enumerate(felt_points) if topic == "/contour/traced"]
    felt_points.insert(at[2] + 1, goal(2, [1, 0, 2]))
    felt_points.insert(at[1] + 1, goal(1, [1, 0]))
    return (*felt_points, done(3, [1, 0, 2], [3, 4]))


def promised(messages: Iterable[tuple[str, Any]]) -> list[Deferred]:
    """What the node is going to publish of messages in this order."""
    state, _ = NODE.start(Params())
    published: list[Any] = []
    for topic, message in messages:
        state, outputs = NODE.inputs[topic][1](Params(), state, message)
        published += [one[1] for one in outputs]
    return published


def models(messages: Iterable[tuple[str, Any]]) -> list[Any]:
    return [one.make(no_steps) for one in promised(messages) if one.cls is not SpaceMap]


@cache
def told() -> tuple[Any, ...]:
    """What the node publishes of the ball in a tilted frame."""
    return tuple(one.make(no_steps) for one in promised(tilted()))


def shapes() -> list[ShapeModel]:
    return [one for one in told() if isinstance(one, ShapeModel)]


def error(model: ShapeModel, middle: Floats = MIDDLE, radius: float = RADIUS) -> float:
    """Root mean square distance of the vertices from the ball [m]."""
    off = np.linalg.norm(model.vertices - middle, axis=1) - radius
    return float(np.sqrt(np.mean(off**2)))


def test_each_goal_gets_one_model_of_its_set_and_a_map_that_grows():
    goals = [m for t, m in tilted() if t in ("/model/goal", "/plan/done")]
    for name in ("number", "contours", "probes", "touches", "robot_time"):
        assert [getattr(one, name) for one in shapes()] == [getattr(one, name) for one in goals]
    assert [model.final for model in shapes()] == [False, False, True]
    assert [type(one) for one in told()] == [ShapeModel, SpaceMap] * 3
    assert all(encode(one) for one in told())
    maps = [one for one in told() if isinstance(one, SpaceMap)]
    assert [one.number for one in maps] == [1, 2, 3]
    free, touched = ([int((one.states == state).sum()) for one in maps] for state in (1, 2))
    assert 0 < free[0] < free[1] < free[2] and 0 < touched[0] < touched[1] < touched[2]
    last = maps[-1]
    for state, least, most in ((1, RADIUS, np.inf), (2, RADIUS - 0.004, RADIUS + 0.004)):
        places = np.argwhere(last.states == state) * last.step + last.low
        away = np.linalg.norm(places - MIDDLE, axis=1)
        assert least < away.min() and away.max() < most


def test_final_solid_is_closed_covers_its_ends_and_states_its_errors():
    last = shapes()[-1]
    edges = np.sort(last.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert (last.closed, last.genus, last.self_crossings, last.method) == (True, 0, 0, "lattice")
    off = np.linalg.norm(last.vertices - MIDDLE, axis=1) - RADIUS
    assert np.abs(off).max() < 2e-4 and np.array_equal(last.frame, TILTED)
    along = last.uncertainty_height
    assert -RADIUS <= along.min() < -0.02 and 0.02 < along.max() <= RADIUS
    assert np.linalg.norm(last.control.reshape(-1, 3) - MIDDLE, axis=1).max() < 3.0 * RADIUS
    solid = tree_from_arrays(arrays_from_bytes(last.archive))
    assert np.array_equal(solid.frame, TILTED)
    assert np.array_equal(solid.control_lattice.control, last.control)
    _, without, both = shapes()
    names = ("uncovered_below", "uncovered_above")
    assert all(without.health[name] > 0.0 == both.health[name] for name in names)
    assert error(both) / 4.0 < both.deviation < without.deviation
    first, _, last = shapes()
    assert first.predicted == {} and set(last.predicted) == {"lattice"}
    assert 0.0 < last.predicted["lattice"] < RADIUS
    assert len(last.vertex_errors) == len(last.vertex_distances) == len(last.vertices)
    assert (last.vertex_bounds >= last.vertex_errors).all()


@pytest.mark.slow
def test_standing_object_is_touched_by_its_platform():
    [model] = models([*felt(UPRIGHT, 0.0, 2.0 * RADIUS), done(1, [0, 1, 2], [3])])
    assert model.health["uncovered_below"] == 0.0 and np.array_equal(model.frame, UPRIGHT)
    assert model.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_order_of_goals_and_touches_and_height_of_platform_change_nothing():
    lower = [(t, replace(m, platform=-0.02) if t == "/world" else m) for t, m in tilted()]
    first = [one for one in lower if one[0] in NODE.needs]
    goals = [one for one in lower if one[0] in ("/model/goal", "/plan/done")]
    touches = [one for one in lower if one[0] == "/touch/patch"]
    rest = [one for one in lower if one not in first and one not in goals and one not in touches]
    late = models([*first, *goals, *rest, *touches, *goals])
    assert [encode(one) for one in late] == [encode(one) for one in shapes()]


def test_set_that_lacks_a_touch_is_not_fitted_and_models_follow_their_numbers():
    last = max(i for i, (topic, _) in enumerate(tilted()) if topic == "/touch/patch")
    without = tilted()[:last] + tilted()[last + 1 :]
    assert len(promised(without)) == len(told()) - 2
    assert len(promised([*without, tilted()[last]])) == len(told())
    published = promised(
        [*tilted()[:2], goal(0, closings=2), *tilted()[2:], *map(contacts, (0, 1))]
    )
    kinds = [one.cls for one in published if one.cls is not SpaceMap]
    assert kinds == [Superquadric, *[ShapeModel] * 3]
    assert NODE.fan_in == ("/touch/patch", "/contour/traced", "/probe/traced")


@pytest.mark.slow
def test_probe_that_missed_touches_no_end():
    probe = next(m for t, m in tilted() if t == "/probe/traced" and m.id == 3)
    missed = replace(probe, outcome="miss", point=MIDDLE + [0.0, 0.0, 0.2])
    last = models([(t, missed if m is probe else m) for t, m in tilted()])[-1]
    assert np.linalg.norm(last.vertices - MIDDLE, axis=1).max() < 1.2 * RADIUS


@pytest.mark.slow
def test_slices_of_two_frames_give_way_to_a_general_solid():
    asked = [one for one in tilted() if one[0] not in ("/model/goal", "/plan/done")]
    odd = next(m for t, m in asked if t == "/contour/traced" and m.id == 2)
    turned = [(t, replace(m, frame=IDENTITY_POSE) if m is odd else m) for t, m in asked]
    [last] = models([*turned, goal(3, [1, 0, 2], [3, 4])])
    assert last.dropped == (1, 0, 2) and encode(last)
    words = "one slicing frame, but that of contour 2 is not that of contour 1"
    assert all(words in one for one in last.dropped_reasons)
    assert last.method == "general" and error(last) < 2e-3


BALL = patches.RADIUS  # Radius of the ball that touches alone feel [m]
HELD = types.World(platform=-0.05, held=True, reach=0.06, fingers=1, seed=0)
TOUCHES = 24


def single(count: int = TOUCHES, **changes: Any) -> Published:
    """Single touches of a ball in mixed order, each a goal of its own."""
    order = np.random.default_rng(0).permutation(TOUCHES)[:count]
    inputs: Published = [("/world", HELD), INFO]
    for number, which in enumerate(order):
        _, patch = ball_patches(TOUCHES)[which]
        inputs.append(("/touch/patch", replace(patch, goal=number, touch=0)))
        inputs.append(probe(number))
    return inputs


def probe(number: int, outcome: str = "hit") -> tuple[str, Any]:
    return "/probe/traced", example(types.Probe, id=number, outcome=outcome, touches=1)


def of_touches(number: int, count: int, ask: Any = goal, **more: Any) -> tuple[str, Any]:
    return ask(number, (), range(count), general=True, **more)


@cache
def general() -> tuple[ShapeModel, ...]:
    """Drafts of most touches and of all, and the final solid."""
    goals = [of_touches(1, TOUCHES - 2), of_touches(2, TOUCHES), of_touches(3, TOUCHES, done)]
    later = [one for one in promised([*single(), *goals]) if one.cls is ShapeModel]
    return tuple(one.make(no_steps) for one in reversed(later))[::-1]


def test_draft_with_touches_more_is_nearly_the_final_solid_in_any_order():
    first, draft, final = general()
    errors = [error(one, np.zeros(3), BALL) for one in general()]
    assert errors[1] < 2.0 * errors[2] + 1e-6 and errors[2] < 2e-5
    assert final.final and final.closed and final.genus == 0 and not final.rejected
    assert first.predicted == {} and set(draft.predicted) == {"general"}
    assert len(draft.vertex_errors) == len(draft.vertices) and (draft.vertex_errors > 0.0).all()
    goals = [of_touches(1, TOUCHES - 2), of_touches(2, TOUCHES)]
    made = models([*single(), *goals])  # the first first; `general` makes the last first
    assert [encode(one) for one in made] == [encode(one) for one in general()[:2]]


def test_solid_that_is_not_sound_is_rejected_and_the_one_before_stands():
    near = [(t, replace(m, reach=0.004) if t == "/world" else m) for t, m in single()]
    [model] = models([*near, of_touches(1, TOUCHES, done)])
    assert "beyond the space that was explored" in model.rejected[0] and not len(model.faces)
    fields = {"goal": TOUCHES, "outcome": "miss", "kind": "miss", "advance": 0.03}
    pose = np.array([0.0, 0.0, 0.004, 0.0, 0.0, 0.0, 1.0])
    image = {"height": np.zeros((16, 16)), "mask": np.zeros((16, 16), bool), "pose": pose}
    through = ("/touch/patch", example(types.SurfacePatch, **fields, **image))
    inputs = [*single(), of_touches(1, TOUCHES - 2), through, probe(TOUCHES, "miss")]
    before, after = models([*inputs, of_touches(2, TOUCHES, done, missed=(TOUCHES,))])
    assert "a finger has passed through" in after.rejected[0]
    middles = (after.vertices.mean(axis=0), before.vertices.mean(axis=0))  # of other triangles
    assert after.final and np.allclose(*middles, atol=5e-4)
    assert error(after, np.zeros(3), BALL) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("bound", [1e-9, 1e-3])
def test_final_solid_off_its_draft_by_more_than_the_bound_is_rejected(bound: float, monkeypatch):
    # The final solid has all coefficients around, its draft has few.
    whole = partial(fit_side_spline, settings=DetailSettings(max_ratio=np.inf))
    monkeypatch.setattr(reconstruction, "fit_side_spline", whole)
    last = done(3, [1, 0, 2], [3, 4], rms_bound_95=bound)
    final = promised([*tilted()[:-1], last])[-2].make(no_steps)
    reasons = ["rms distance from the last draft" in one for one in final.rejected]
    assert reasons == [True] * (bound < 1e-6)
    assert ("lattice_rms" in final.health) is (bound > 1e-6)  # A draft has none
    assert error(final) < 2e-4


def contacts(number: int, count: int = 12) -> tuple[str, GraspContacts]:
    normals = np.random.default_rng(number).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    met = {"points": MIDDLE + RADIUS * normals, "normals": normals, "robot_time": 1.0}
    fingers = np.zeros(count, np.int32)
    return "/hand/contacts", example(GraspContacts, number=number, fingers=fingers, **met)


def test_closings_alone_give_the_superquadric_of_the_hand_in_any_order():
    asked = goal(0, closings=4)
    [coarse] = models([asked, *map(contacts, range(4))])
    assert isinstance(coarse, Superquadric) and encode(coarse)
    assert coarse.size == pytest.approx([RADIUS] * 3, rel=0.02)
    assert coarse.pose[:3] == pytest.approx(MIDDLE, abs=5e-4)
    assert coarse.residuals.shape == (48,) and coarse.residual < 1e-5
    assert (coarse.number, coarse.bend) == (0, 0.0)
    mixed = list(map(contacts, (5, 3, 1, 0, 2)))  # a later closing does not count
    for messages in ([*mixed, asked], [*mixed[:2], asked, *mixed[2:]]):
        assert [encode(one) for one in models(messages)] == [encode(coarse)]
    assert promised([asked, *map(contacts, (3, 1, 2))]) == []


def test_hand_alone_gives_a_solid_to_touch_where_the_first_slice_met_nothing():
    missed = "/contour/traced", example(types.Contour, id=7, status="no_contact", touches=0)
    asked = goal(1, arcs=(7,), failed=True, general=True, closings=4)
    scene = ("/world", HELD), INFO
    [model] = models([*scene, *map(contacts, range(4)), missed, asked])
    assert error(model) < 2e-3 and (model.method, len(model.faces) > 0) == ("general", True)
    assert len(model.vertex_bounds) == len(model.vertices)
    assert 0.0 < model.vertex_distances.max() < RADIUS
    # Without contacts there is none.
    [empty] = models([contacts(0, 0), missed, goal(1, arcs=(7,), failed=True, closings=1)])
    assert len(empty.vertices) == 0


def test_sets_of_nothing_give_empty_models():
    [coarse] = models([contacts(0, 0), goal(0, closings=1)])
    assert coarse.warnings == ("too few points",) and encode(coarse)
    [model] = models([done(1)])
    assert (len(model.vertices), model.final, model.touches) == (0, True, 19)
    assert np.array_equal(model.frame, IDENTITY_POSE) and model.deviation == 0.0
    assert model.predicted == {} and len(model.vertex_errors) == 0 and encode(model)


@pytest.mark.slow  # two fits of a torus
def test_pose_that_touches_contradict_is_named_and_counts_in_the_error():
    touched = torus_touches(2, 1e-4)
    placement = (np.arange(90) % 2).astype(np.int32)
    for off in (0.2e-3, 2.5e-3):  # of the pose that contacts gave
        later = off * (placement[touched.touch] == 1)[:, None] * [0.0, 0.0, 1.0]
        moved = touched._replace(points=touched.points + later)
        solid = rebuild_general(moved, cell=5e-3, pose=1e-4, placement=placement)
        mistaken, sentences = contradicted(solid)
        assert len(sentences) == (off > 1e-3) == (mistaken > 0.3 * off)
        assert all("contradict the pose that contacts gave" in one for one in sentences)
