"""Collector node: touches of a sequence become one goal, and its model is judged."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.core.poses import Pose, rotation_angle, rotations_from_vectors
from palpate.messages.types import PlanDone, SequenceEnd, ShapeModel
from palpate.nodes import collector, reconstructor
from palpate.nodes.runtime.node import Finished
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.specs.frames import FRAMES_PER_GOAL
from tests.nodes.patches import (
    BLOCK_MIDDLE,
    BLOCK_NORMALS,
    BLOCK_OFFSETS,
    DEPTH,
    INFO,
    RADIUS,
    Patches,
    ball_patches,
    block_frames,
    patches_at,
    patches_of,
)


def collected(patches: Patches, *more: Any, count: int | None = None, **params: Any) -> list[Any]:
    """What the collector publishes of patches and the end of their sequence."""
    frames = len(patches) if count is None else count
    end = ("/touch/end", SequenceEnd(frames=frames, robot_time=9.0))
    return drive(collector.NODE, [INFO, *patches, end, *more], params)


def solid(patches: Patches, **params: Any) -> tuple[Any, PlanDone]:
    """The model of all patches, and how it was judged."""
    asked = collected(patches, **params)
    world = [one for one in asked if one[0] == "/world"]
    rest = [one for one in asked if one[0] != "/world"]
    made = drive(reconstructor.NODE, [*world, INFO, *patches, *rest])
    model = messages_on(made, "/model/shape")[-1]
    judged = collected(patches, ("/model/shape", model), **params)
    assert isinstance(judged[-1], Finished)
    return model, messages_on(judged, "/plan/done")[0]


def test_touches_from_all_sides_become_the_ball_wherever_it_is_held():
    centre = (0.7, -0.4, 0.3)
    model, done = solid(ball_patches(60, centre=centre), tolerance=1e-4)
    off = np.abs(np.linalg.norm(model.vertices - centre, axis=1) - RADIUS)
    assert done.reached and done.rms_bound_95 is not None
    assert off.max() < 1e-5 and off.max() < done.rms_bound_95 < 1e-4
    assert done.reason == "all 60 frames were used, 60 of which show a contact"


@pytest.mark.slow
def test_surface_that_was_not_touched_is_told_with_place_and_direction():
    model, done = solid(ball_patches(40, lowest=0.0), tolerance=1e-4)
    assert model.final and not done.reached
    assert done.open_share is not None and done.open_share > 0.2
    place = done.open_places[0]
    assert place[2] < -0.5 * RADIUS and done.open_normals[0] @ place > 0.0
    assert done.findings["unknown_share"] == done.open_share > done.limits["unknown_share"]


@pytest.mark.slow
def test_ball_that_stands_is_cut_off_at_its_platform():
    model, done = solid(ball_patches(60, -0.7, (0.0, 0.0, RADIUS)), platform=0.0)
    assert model.vertices[:, 2].min() > -1e-9
    assert done.reached is None and done.under_share
    assert "turn the object over" in done.reason and "with placement 1" in done.reason


def test_touches_that_make_no_solid_or_lack_a_platform_end_with_the_reason():
    places = [(np.array([0.02 * number, 0.0, 0.0]), np.eye(3)) for number in range(4)]
    model, done = solid(patches_at(places, np.full((16, 16), DEPTH)))
    assert not len(model.faces)
    assert done.reason == "all contacts, of 4 of 4 frames, lie in one plane: touch other sides"
    patches = patches_at([(np.zeros(3), np.eye(3))] * 30, np.zeros((16, 16)))
    *_, (_, done), finished = collected(patches)
    assert isinstance(finished, Finished)
    assert done.reason == "none of the 30 frames shows a contact"
    assert done.missed == (0, 1) and done.probes == ()
    # Where it has ended already, an empty model changes nothing.
    nothing = example(ShapeModel, number=1, final=True, faces=np.zeros((0, 3), np.int32))
    published = collected(patches, ("/model/shape", nothing))
    assert len(messages_on(published, "/plan/done")) == 1
    axes = [np.eye(3), np.diag([1.0, -1.0, -1.0])]
    asked = collected(patches_at([(np.array([0, 0, 5.0 * n]), axes[n]) for n in range(2)]))
    [done] = messages_on(asked, "/plan/done")
    assert "m from their middle, more than 0.6 m: are the poses in m" in done.reason
    assert done.probes == () and messages_on(asked, "/model/goal") == []
    assert messages_on(asked, "/world")[0].reach <= 0.6
    _, patches = turned_block(3)
    [done] = messages_on(collected(patches), "/plan/done")
    assert "the height of its platform is unknown: give it, as platform:=0" in done.reason
    [goal, last] = messages_on(collected(patches, platform=0.0), "/model/goal")
    assert (goal.final, last.final, goal.probes) == (False, True, last.probes)


def test_nothing_is_asked_before_all_frames_have_come():
    patches = ball_patches(30)
    asked = collected(patches[:29], count=30)
    assert [topic for topic, _ in asked] == ["/probe/traced"]
    assert asked[0][1].touches == FRAMES_PER_GOAL
    end = ("/touch/end", SequenceEnd(frames=30, robot_time=9.0))
    late = drive(collector.NODE, [INFO, end, *patches])
    assert [topic for topic, _ in late] == ["/probe/traced"] * 2 + ["/world", "/model/goal"]
    assert [one.touches for one in messages_on(late, "/probe/traced")] == [25, 5]
    [goal] = messages_on(late, "/model/goal")
    assert goal.general and goal.final
    assert (goal.probes, goal.missed, goal.touches, goal.robot_time) == ((0, 1), (), 30, 9.0)


@pytest.mark.parametrize(("platform", "held"), [(None, True), (-0.03, False)])
def test_world_is_the_room_about_the_touches(platform: float | None, held: bool):
    asked = collected(ball_patches(30, centre=(0.7, -0.4, 0.0)), platform=platform)
    [world] = messages_on(asked, "/world")
    assert world.fingers == 1
    assert world.centre == pytest.approx([0.7, -0.4], abs=2e-3)
    # The pads stay half a millimetre inside the ball; 20 mm are left about them.
    low = platform if platform is not None else DEPTH - RADIUS - 0.02
    assert (world.held, world.platform) == (held, pytest.approx(low, abs=1e-3))
    aside, up = np.hypot(1, 1) * (RADIUS - DEPTH + 0.02), RADIUS - DEPTH + 0.02 - low
    assert world.reach == pytest.approx(max(aside, up), rel=0.05)


def turned_block(count: int) -> tuple[Pose, Patches]:
    """How a block lay after it was set on its top, and touches of both placements."""
    turn = rotations_from_vectors(np.array([[0.0, 0.0, 0.7], [np.pi, 0.0, 0.0]]))
    lies = Pose(np.array([0.004, -0.003, 2.0 * BLOCK_MIDDLE[2]]), turn[0] @ turn[1])
    frames = block_frames(60, Pose(np.zeros(3), np.eye(3)))
    return lies, patches_of([*frames, *block_frames(count, lies, placement=1)])


@pytest.mark.slow  # two fits, that of the second placement from nothing
def test_touches_since_it_was_turned_over_tell_how_it_lies_and_what_it_stood_on():
    lies, patches = turned_block(40)
    model, done = solid(patches, platform=0.0, tolerance=5e-4)
    (pose,) = map(Pose.from_array, model.placements)
    assert np.degrees(rotation_angle(pose.axes, lies.axes)) < 1.0
    off = ((model.vertices - BLOCK_MIDDLE) @ BLOCK_NORMALS.T - BLOCK_OFFSETS).max(axis=1)
    assert np.median(np.abs(off)) < 0.15e-3 and model.placement_faults == ()
    assert done.rms_bound_95 is not None and np.sqrt(np.mean(off**2)) < done.rms_bound_95
    assert not done.under_share and done.open_share is not None and done.open_share < 0.02
    assert done.reason.startswith("all ") and "turn the object over" not in done.reason


@pytest.mark.slow
def test_touches_that_fit_nowhere_since_it_was_turned_over_are_left_out():
    frames = block_frames(60, Pose(np.zeros(3), np.eye(3)))
    swollen = [(Pose(1.4 * pose.position, pose.axes), image, 1) for pose, image, _ in frames]
    model, done = solid(patches_of([*frames, *swollen]), platform=0.0, tolerance=5e-4)
    assert len(model.faces) and not len(model.placements)
    assert done.reason.startswith("those since it was turned over once are left out: its ")
