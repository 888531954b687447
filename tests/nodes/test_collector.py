"""The collector: touches of a sequence become one goal, and its model is judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import pad_rotation, pose_of
from palpate.messages.types import PlanDone, SequenceEnd, ShapeModel, TactileFrame
from palpate.nodes import collector, curvature, filter, reconstructor
from palpate.nodes.runtime.node import Finished
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.specs.frames import (
    FRAMES_A_GOAL,
    MOST_FRAMES,
    SensorParams,
    sensor_info,
    tactile_frame,
)
from palpate.nodes.specs.sensors import PadSpec, SensorSpec

SENSING = SensorParams(sensor=SensorSpec(pad=PadSpec(radius=None)))
INFO = ("/touch/info", sensor_info(SENSING))
RADIUS, DEPTH = 0.02, 0.5e-3
Published = list[Any]


def frames(places: Iterable[tuple[Floats, Floats]], image: Callable[..., Floats]) -> Published:
    """What filter and curvature make of frames at places, each with axes of the pad."""
    raw = [
        ("/touch/raw", tactile_frame(SENSING, touch, 0.1 * touch, pose_of(place, axes), image()))
        for touch, (place, axes) in enumerate(places)
    ]
    images = drive(filter.NODE, [INFO, *raw])
    return drive(curvature.NODE, [INFO, *images])


def ball_image() -> Floats:
    side = (np.arange(16) - 7.5) * 1e-3
    x, y = np.meshgrid(side, side)
    image: Floats = np.maximum(DEPTH - (RADIUS - np.sqrt(RADIUS**2 - x**2 - y**2)), 0.0)
    return image


def around(count: int, lowest: float = -1.0, centre: Floats | None = None) -> Any:
    """Places evenly about a ball, down to a height of its unit sphere."""
    middle = np.zeros(3) if centre is None else centre
    for number in range(count):
        height = 1.0 - (1.0 - lowest) * (number + 0.5) / count
        axes = pad_rotation(2.4 * number, float(np.arcsin(height)))
        yield middle + (DEPTH - RADIUS) * axes[:, 2], axes


def end(count: int) -> tuple[str, SequenceEnd]:
    return "/touch/end", SequenceEnd(frames=count, robot_time=9.0)


def solid(patches: Published, **params: Any) -> tuple[Any, PlanDone]:
    """The model of all patches, and how it was judged."""
    told = [INFO, *patches, end(len(patches))]
    asked = drive(collector.NODE, told, params)
    world = [one for one in asked if one[0] == "/world"]
    rest = [one for one in asked if one[0] != "/world"]
    made = drive(reconstructor.NODE, [*world, INFO, *patches, *rest])
    (model,) = messages_on(made, "/model/shape")
    judged = drive(collector.NODE, [*told, ("/model/shape", model)], params)
    assert isinstance(judged[-1], Finished)
    return model, messages_on(judged, "/plan/done")[0]


def test_touches_from_all_sides_become_the_ball_wherever_it_is_held():
    centre = np.array([0.7, -0.4, 0.3])
    model, done = solid(frames(around(60, centre=centre), ball_image), tolerance=1e-4)
    off = np.abs(np.linalg.norm(model.vertices - centre, axis=1) - RADIUS)
    assert off.max() < 1e-5
    assert done.reached
    assert done.rms_bound_95 is not None and off.max() < done.rms_bound_95 < 1e-4
    assert done.reason == "all 60 frames were used, 60 of which show a contact"


def test_what_was_not_touched_is_told_with_its_place_and_whence_to_touch_it():
    model, done = solid(frames(around(40, lowest=0.0), ball_image), tolerance=1e-4)
    assert model.final and not done.reached
    assert done.open_share is not None and done.open_share > 0.2
    place = done.open_places[0]
    assert place[2] < -0.5 * RADIUS and done.open_normals[0] @ place > 0.0
    assert done.findings["unknown_share"] == done.open_share > done.limits["unknown_share"]


def test_a_ball_that_stands_is_cut_off_at_its_platform():
    centre = np.array([0.0, 0.0, RADIUS])
    model, done = solid(frames(around(60, -0.7, centre), ball_image), platform=0.0)
    assert model.vertices[:, 2].min() > -1e-9
    assert done.reached is None and done.under_share


def test_frames_without_a_contact_end_with_the_reason():
    patches = frames(around(30), lambda: np.zeros((16, 16)))
    *_, done, finished = drive(collector.NODE, [INFO, *patches, end(30)])
    assert isinstance(finished, Finished)
    assert done[1].reason == "none of the 30 frames shows a contact"
    assert done[1].missed == (0, 1) and done[1].probes == ()


def test_touches_too_far_apart_for_one_object_end_with_the_reason():
    patches = frames(((1000.0 * place, axes) for place, axes in around(30)), ball_image)
    asked = drive(collector.NODE, [INFO, *patches, end(30)])
    done = messages_on(asked, "/plan/done")[0]
    assert "m from their middle, more than 0.6 m: are the poses in m" in done.reason
    assert done.probes == () and messages_on(asked, "/model/goal") == []
    assert messages_on(asked, "/world")[0].reach <= 0.6


def test_what_was_told_to_be_no_solid_is_not_judged_again():
    patches = frames(around(30), lambda: np.zeros((16, 16)))
    nothing = (
        "/model/shape",
        example(ShapeModel, number=1, final=True, faces=np.zeros((0, 3), np.int32)),
    )
    told = drive(collector.NODE, [INFO, *patches, end(30), nothing])
    assert len(messages_on(told, "/plan/done")) == 1


def test_touches_of_one_plane_are_no_solid():
    places = [(np.array([0.02 * number, 0.0, 0.0]), np.eye(3)) for number in range(4)]
    model, done = solid(frames(places, lambda: np.full((16, 16), DEPTH)))
    assert not len(model.faces)
    assert done.reason == "what 4 of 4 frames touched lies in one plane: touch other sides, too"


def test_nothing_is_asked_for_before_all_frames_have_come():
    patches = frames(around(30), ball_image)
    asked = drive(collector.NODE, [INFO, *patches[:29], end(30)])
    assert [topic for topic, _ in asked] == ["/probe/traced"]
    assert asked[0][1].touches == FRAMES_A_GOAL
    late = drive(collector.NODE, [INFO, end(30), *patches])
    assert [topic for topic, _ in late] == ["/probe/traced"] * 2 + ["/world", "/model/goal"]
    assert [one.touches for one in messages_on(late, "/probe/traced")] == [25, 5]
    assert messages_on(late, "/model/goal")[0].probes == (0, 1)


def test_more_frames_than_a_message_can_list_are_refused():
    image = ball_image()
    place = pose_of(np.zeros(3), np.eye(3))
    last: TactileFrame = tactile_frame(SENSING, MOST_FRAMES - 1, 0.0, place, image)
    assert last.goal == MOST_FRAMES // FRAMES_A_GOAL - 1
    with pytest.raises(ValueError, match="frame 100000: a sequence has 100000 frames at most"):
        tactile_frame(SENSING, MOST_FRAMES, 0.0, place, image)
