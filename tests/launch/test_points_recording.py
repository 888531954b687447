from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from palpate.core.frames import IDENTITY
from palpate.launch.located import InputError
from palpate.launch.points_recording import KINDS, Heard, found_in
from palpate.messages.types import Contour, PlanDone, Probe
from palpate.messages.types.motion import Status
from palpate.nodes.reconstructor import NODE

PATH = Path("topics.mcap")


def contour(number: int, status: Status = "closed") -> Contour:
    return Contour(
        id=number,
        finger=1,
        frame=IDENTITY,
        height=0.1 * number,
        points=np.full((4, 3), 0.1 * number),
        normals=np.tile([1.0, 0.0, 0.0], (4, 1)),
        curvature=np.zeros(4),
        status=status,
        felt_low=np.full(4, 0.1 * number),
        felt_high=np.full(4, 0.1 * number),
        gap_starts=np.zeros((0, 3)),
        gap_ends=np.zeros((0, 3)),
        gap_whys=(),
        touches=4,
        robot_time=1.0,
    )


def probe(number: int, *, hit: bool) -> Probe:
    return Probe(
        id=number,
        finger=1,
        outcome="hit" if hit else "miss",
        point=np.array([0.0, 0.0, float(number)]),
        normal=np.array([0.0, 0.0, 1.0]),
        touches=1,
        robot_time=2.0,
    )


def done(contours: tuple[int, ...], probes: tuple[int, ...]) -> PlanDone:
    return PlanDone(
        number=1, contours=contours, probes=probes, touches=9, robot_time=3.0,
        reason="enough", within=None, bound=None, unfelt=None, uncovered=0.0,
    )  # fmt: skip


def test_a_recording_gives_the_contours_that_the_plan_ended_with() -> None:
    traced = [contour(1), contour(2), contour(3)]
    probes = [probe(4, hit=True), probe(5, hit=False), probe(6, hit=True)]
    found = found_in(PATH, Heard(traced, probes, done=done((1, 3), (4, 5))))
    assert found.places == ("contour 1", "contour 3")
    assert [one[0, 0] for one in found.contours] == pytest.approx([0.1, 0.3])
    assert found.tops is not None and found.tops.tolist() == [[0.0, 0.0, 4.0]]
    assert found.normals is not None and len(found.normals) == 2


def test_contours_that_were_not_closed_are_left_out_and_told() -> None:
    assert "stuck" in get_args(Status)
    found = found_in(PATH, Heard([contour(1), contour(2, "stuck")]))
    assert found.places == ("contour 1",)
    assert found.tops is None
    assert "left out 1 contours that were not closed" in found.notes


def test_a_recording_without_closed_contours_is_refused() -> None:
    with pytest.raises(InputError, match="holds no closed contour, of 1 that were traced"):
        found_in(PATH, Heard([contour(1, "stuck")]))


def test_the_topics_are_those_of_the_reconstructor() -> None:
    heard = {topic: kind for topic, (kind, _) in NODE.inputs.items() if topic != "/model/goal"}
    assert heard == KINDS
