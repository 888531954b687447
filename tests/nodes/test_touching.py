"""Simulator, filter, curvature and tracer together, as plain calls: what holds of all four."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from palpate.bench.loop import InProcessLoop, LoopNode
from palpate.core.poses import IDENTITY_POSE
from palpate.messages.types.motion import Contour, ContourGoal
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.simulator import Params
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import MAX_WIDTH, MIN_WIDTH, PadSpec, SensorSpec

BALL = ObjectSpec(
    superquadric=SuperquadricSpec(size=(0.03,) * 3, exponents=(1.0, 1.0)),
    pose=PoseSpec(position=(0.0, 0.0, 0.03)),
)
APPROACH = 0.02  # The finger comes from this far outside of the object, m


def loop_of(simulated: Params, order: Any = "auto", fingers: int = 1) -> InProcessLoop:
    return InProcessLoop(
        [
            node
            for finger in range(1, fingers + 1)
            for node in (
                LoopNode(
                    finger, simulator.NODE, replace(simulated, finger=finger, fingers=fingers)
                ),
                LoopNode(finger, filter.NODE, filter.Params(order=order)),
                LoopNode(finger, curvature.NODE, curvature.Params()),
                LoopNode(finger, tracer.NODE, tracer.Params(finger=finger)),
            )
        ]
    )


def trace(loop: InProcessLoop, height: float, radius: float, number: int = 0, finger: int = 1):
    goal = ContourGoal(
        id=number,
        finger=finger,
        frame=IDENTITY_POSE,
        height=height,
        centre=np.zeros(2),
        radius=radius + APPROACH,
        not_before=0.0,
    )
    contour = loop.publish("/contour/goal", goal)["/contour/traced"]
    assert isinstance(contour, Contour)
    return contour


def test_a_contour_is_traced_without_a_bus():
    contour = trace(loop_of(Params(object=BALL)), 0.03, 0.03)
    assert contour.status == "closed"
    distance = np.linalg.norm(contour.points - np.array([0.0, 0.0, 0.03]), axis=1)
    assert np.allclose(distance, 0.03, atol=5e-6)


def test_several_contours_follow_each_other():
    loop = loop_of(Params(object=BALL))
    first, second = trace(loop, 0.03, 0.03, 0), trace(loop, 0.04, 0.028, 1)
    assert [first.id, second.id] == [0, 1]
    assert second.robot_time > first.robot_time


def test_two_fingers_have_clocks_and_errors_of_their_own():
    noisy = Params(object=BALL, effects={"pose_error": {}})
    loop = loop_of(noisy, fingers=2)
    first, second = (trace(loop, 0.03, 0.03, number, number + 1) for number in (0, 1))
    assert [first.finger, second.finger] == [1, 2]
    assert second.robot_time == pytest.approx(first.robot_time, rel=0.2)
    assert first.points[0] != pytest.approx(second.points[0], abs=1e-6)
    assert trace(loop_of(noisy), 0.03, 0.03).points == pytest.approx(first.points, abs=0)


@pytest.mark.parametrize("width", [MIN_WIDTH, MAX_WIDTH])
@pytest.mark.parametrize("domed", [False, True])
@pytest.mark.parametrize("exponent", [1.0, 0.1])
def test_the_narrowest_and_the_widest_array_close_contours(
    width: float, domed: bool, exponent: float
):
    sensor = SensorSpec(pitch=width / 15, pad=PadSpec(radius=width if domed else None))
    solid = SuperquadricSpec(size=(0.035, 0.03, 0.04), exponents=(exponent, exponent))
    loop = loop_of(Params(object=ObjectSpec(superquadric=solid), sensor=sensor))
    assert trace(loop, 0.01, 0.05).status == "closed"


@pytest.mark.parametrize("effects", [{"transport": {"duplicate": 0.5, "drop": 0.3}}, {"creep": {}}])
def test_a_lossy_link_and_a_lazy_pad_do_not_stop_the_loop(effects):
    assert trace(loop_of(Params(object=BALL, effects=effects)), 0.03, 0.03).status == "closed"


def test_the_filter_is_the_one_that_was_asked_for():
    salty = Params(object=BALL, effects={"salt_and_pepper": {"rate": 0.02}})
    errors = []
    for order in ("auto", "none"):
        contour = trace(loop_of(salty, order), 0.03, 0.03)
        distance = np.linalg.norm(contour.points - np.array([0.0, 0.0, 0.03]), axis=1)
        errors.append(np.sqrt(np.mean((distance - 0.03) ** 2)))
    assert errors[0] < 0.1 * errors[1]
