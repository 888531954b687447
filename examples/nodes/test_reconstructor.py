"""The reconstructor with the nodes that touch: contours in, a closed solid out."""

from functools import cache

import numpy as np
import pytest

from palpate.messages.types import ContourGoal, PlanDone, ShapeModel
from palpate.nodes import curvature, filter, reconstructor, simulator, tracer
from palpate.testing import drive, drive_together, example, messages_on

BALL = {"sphere": {"radius": 0.03}, "pose": {"position": [0.0, 0.0, 0.03]}}
NODES = [(simulator.NODE, {"object": BALL}), (filter.NODE, {}), (curvature.NODE, {})]


@cache
def touched() -> list[tuple[str, object]]:
    """Messages to a reconstructor from five slices of the ball."""
    frame = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    goals = [
        example(ContourGoal, id=i, finger=1, frame=frame, height=height, radius=0.08)
        for i, height in enumerate((0.01, 0.02, 0.03, 0.04, 0.05))
    ]
    published = drive_together(
        [*NODES, (tracer.NODE, {})], [("/contour/goal", goal) for goal in goals]
    )
    return [(topic, message) for topic, message in published if topic in reconstructor.NODE.inputs]


def rebuilt(**params: object) -> ShapeModel:
    done = example(PlanDone, number=1, contours=tuple(range(5)), touches=100)
    published = drive(reconstructor.NODE, [*touched(), ("/plan/done", done)], params)
    [model] = messages_on(published, "/model/shape")
    return model


@pytest.mark.parametrize(("method", "max_error"), [("best", 0.1e-3), ("thesis", 3e-3)])
def test_solid_is_closed_and_close_to_the_ball(method, max_error):
    model = rebuilt(method=method, quality="draft")
    assert (model.closed, model.genus, model.self_crossings, model.final) == (True, 0, 0, True)
    side = model.vertices[(model.vertices[:, 2] > 0.012) & (model.vertices[:, 2] < 0.048)]
    errors = np.linalg.norm(side - [0.0, 0.0, 0.03], axis=1) - 0.03
    assert np.sqrt(np.mean(errors**2)) < max_error


def test_only_the_thesis_states_no_deviation():
    assert 0.0 < rebuilt(quality="draft").deviation < 3e-3
    assert rebuilt(method="thesis", quality="draft").deviation is None
