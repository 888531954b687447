from __future__ import annotations

import numpy as np
import pytest

from palpate.launch.plain_calls import Loop
from palpate.nodes import filter
from palpate.nodes.object import ObjectSpec, PoseSpec, SuperquadricSpec
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
