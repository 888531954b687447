"""The tracer with the nodes that touch: the goal of a slice in, its contour out."""

import numpy as np

from palpate.messages.types import ContourGoal
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.testing import drive, drive_together, example, messages_on

BALL = {"sphere": {"radius": 0.03}, "pose": {"position": [0.0, 0.0, 0.03]}}
NODES = [(simulator.NODE, {"object": BALL}), (filter.NODE, {}), (curvature.NODE, {})]


def goal(height: float, **more: object) -> tuple[str, ContourGoal]:
    frame = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # so that slices are level
    fields = {"finger": 1, "frame": frame, "height": height, "radius": 0.08, **more}
    return "/contour/goal", example(ContourGoal, **fields)


def test_contour_of_a_ball_is_a_circle():
    published = drive_together([*NODES, (tracer.NODE, {})], [goal(0.042)])
    [contour] = messages_on(published, "/contour/traced")
    assert contour.status == "closed" and 10 < contour.touches < 40
    radii = np.hypot(*contour.points[:, :2].T)
    assert np.abs(radii - np.sqrt(0.03**2 - 0.012**2)).max() < 20e-6
    assert np.allclose(contour.points[:, 2], 0.042)


def test_touches_stay_within_the_budget():
    published = drive_together([*NODES, (tracer.NODE, {})], [goal(0.03, most_touches=4)])
    [contour] = messages_on(published, "/contour/traced")
    assert (contour.status, contour.touches) == ("budget", 4)


def test_first_touch_starts_outside_at_the_height_of_the_slice():
    published = drive_together(NODES)  # sensor and world
    known = [(topic, message) for topic, message in published if topic in tracer.NODE.inputs]
    [touch] = messages_on(drive(tracer.NODE, [*known, goal(0.042)]), "/finger/goal")
    assert abs(np.hypot(*touch.pose[:2]) - 0.08) < 0.02 and abs(touch.pose[2] - 0.042) < 0.01
