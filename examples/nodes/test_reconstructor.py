"""The reconstructor with what touches for it: contours go in, a closed solid comes out."""

from functools import cache

import numpy as np
import pytest

from palpate.messages.types import ContourGoal, PlanDone, ShapeModel
from palpate.nodes import curvature, filter, reconstructor, simulator, tracer
from palpate.testing import drive, drive_together, example, messages_on

BALL = {"sphere": {"radius": 0.03}, "pose": {"position": [0.0, 0.0, 0.03]}}
NODES = [(simulator.NODE, {"object": BALL}), (filter.NODE, {}), (curvature.NODE, {})]
UPRIGHT = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
HEIGHTS = (0.01, 0.02, 0.03, 0.04, 0.05)


@cache
def touched() -> list[tuple[str, object]]:
    """All that a reconstructor hears of five slices of the ball."""
    goals = [
        example(ContourGoal, id=n, finger=1, frame=UPRIGHT, height=height, radius=0.08)
        for n, height in enumerate(HEIGHTS)
    ]
    published = drive_together(
        [*NODES, (tracer.NODE, {})], [("/contour/goal", goal) for goal in goals]
    )
    return [one for one in published if one[0] in reconstructor.NODE.inputs]


def rebuilt(**params: object) -> ShapeModel:
    done = example(PlanDone, number=1, contours=tuple(range(len(HEIGHTS))), touches=100)
    published = drive(reconstructor.NODE, [*touched(), ("/plan/done", done)], params)
    [model] = messages_on(published, "/model/shape")
    return model


@pytest.mark.parametrize(("method", "most"), [("best", 0.1e-3), ("thesis", 3e-3)])
def test_solid_is_closed_and_where_the_ball_is(method, most):
    model = rebuilt(method=method, quality="draft")
    assert (model.closed, model.genus, model.self_crossings, model.final) == (True, 0, 0, True)
    side = model.vertices[(model.vertices[:, 2] > 0.012) & (model.vertices[:, 2] < 0.048)]
    off = np.linalg.norm(side - [0.0, 0.0, 0.03], axis=1) - 0.03
    assert np.sqrt(np.mean(off**2)) < most


def test_its_own_error_is_stated_but_by_the_thesis():
    assert 0.0 < rebuilt(quality="draft").deviation < 3e-3
    assert rebuilt(method="thesis", quality="draft").deviation is None
