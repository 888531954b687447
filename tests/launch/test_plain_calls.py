from __future__ import annotations

import numpy as np
import pytest

from palpate.launch.plain_calls import Loop
from palpate.nodes import filter
from palpate.nodes.object import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.sensor import LARGEST_WIDTH, LEAST_WIDTH, PadSpec, SensorSpec
from palpate.nodes.simulator import Params

BALL = ObjectSpec(
    superquadric=SuperquadricSpec(size=(0.03,) * 3, exponents=(1.0, 1.0)),
    pose=PoseSpec(position=(0.0, 0.0, 0.03)),
)


def test_a_contour_is_traced_without_a_bus() -> None:
    contour = Loop(Params(object=BALL)).trace(height=0.03, radius=0.03)
    assert contour.status == "closed"
    middle = np.array([0.0, 0.0, 0.03])
    assert np.allclose(np.linalg.norm(contour.points - middle, axis=1), 0.03, atol=5e-6)


def test_several_contours_follow_each_other() -> None:
    loop = Loop(Params(object=BALL))
    first, second = loop.trace(0.03, 0.03, number=0), loop.trace(0.04, 0.028, number=1)
    assert [first.id, second.id] == [0, 1]
    assert second.robot_time > first.robot_time


def test_two_fingers_have_clocks_and_errors_of_their_own() -> None:
    noisy = Params(object=BALL, effects={"pose_error": {}})
    loop = Loop(noisy, fingers=2)
    first, second = (loop.trace(0.03, 0.03, number, number + 1) for number in (0, 1))
    assert [first.finger, second.finger] == [1, 2]
    assert second.robot_time == pytest.approx(first.robot_time, rel=0.2)
    assert first.points[0] != pytest.approx(second.points[0], abs=1e-6)
    assert Loop(noisy).trace(0.03, 0.03).points == pytest.approx(first.points, abs=0)


@pytest.mark.parametrize("width", [LEAST_WIDTH, LARGEST_WIDTH])
@pytest.mark.parametrize("domed", [False, True])
@pytest.mark.parametrize("exponent", [1.0, 0.1])
def test_the_narrowest_and_the_widest_array_close_contours(
    width: float, domed: bool, exponent: float
) -> None:
    pad = PadSpec(radius=width if domed else None)
    sensor = SensorSpec(pitch=width / 15, pad=pad)
    solid = SuperquadricSpec(size=(0.035, 0.03, 0.04), exponents=(exponent, exponent))
    contour = Loop(Params(object=ObjectSpec(superquadric=solid), sensor=sensor)).trace(0.01, 0.05)
    assert contour.status == "closed"


@pytest.mark.parametrize("effects", [{"transport": {"duplicate": 0.5, "drop": 0.3}}, {"creep": {}}])
def test_a_lossy_link_and_a_lazy_pad_do_not_stop_the_loop(
    effects: dict[str, dict[str, float]],
) -> None:
    contour = Loop(Params(object=BALL, effects=effects)).trace(0.03, 0.03)
    assert contour.status == "closed"


def test_the_filter_is_the_one_that_was_asked_for() -> None:
    salty = Params(object=BALL, effects={"salt_and_pepper": {"rate": 0.02}})
    errors = []
    for order in ("auto", "none"):
        contour = Loop(salty, filter.Params(order=order)).trace(0.03, 0.03)  # type: ignore[arg-type]
        distance = np.linalg.norm(contour.points - np.array([0.0, 0.0, 0.03]), axis=1)
        errors.append(np.sqrt(np.mean((distance - 0.03) ** 2)))
    assert errors[0] < 0.1 * errors[1]
