from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import IDENTITY_POSE, transform_points
from palpate.launch.files.points_file import MESSAGE_TYPES, RecordedContours, contours_of
from palpate.launch.files.source_map import InputError
from palpate.messages.types.model import PlanDone
from palpate.messages.types.motion import Contour, ContourStatus, Probe
from palpate.messages.types.world import World
from palpate.nodes.reconstructor import NODE
from palpate.nodes.specs.sensors import SensorSpec, info_of, pad_of_info

PATH = Path("topics.mcap")
WORLD = World(platform=-0.3, reach=0.15, fingers=1, seed=0)
TILTED = np.array([0.01, 0.0, 0.05, 0.6, 0.0, 0.0, 0.8])  # Leaning by 73.7 degrees


def contour(
    number: int, status: ContourStatus = "closed", frame: Floats = IDENTITY_POSE
) -> Contour:
    return Contour(
        id=number,
        finger=1,
        frame=frame,
        height=0.1 * number,
        points=np.full((4, 3), 0.1 * number),
        normals=np.tile([1.0, 0.0, 0.0], (4, 1)),
        curvature=np.zeros(4),
        status=status,
        contact_low=np.full(4, 0.1 * number),
        contact_high=np.full(4, 0.1 * number),
        gap_starts=np.zeros((0, 3)),
        gap_ends=np.zeros((0, 3)),
        gap_reasons=(),
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
        reason="enough", tolerance_met=None, rms_bound_95=None, largest_untouched=None,
        uncovered=0.0,
    )  # fmt: skip


def test_a_recording_gives_the_contours_that_the_plan_ended_with():
    traced = [contour(1), contour(2), contour(3)]
    probes = [probe(4, hit=True), probe(5, hit=False), probe(6, hit=True)]
    found = contours_of(PATH, RecordedContours(traced, probes, done=done((1, 3), (4, 5))))
    assert found.places == ("contour 1", "contour 3")
    assert [one[0, 0] for one in found.contours] == pytest.approx([0.1, 0.3])
    assert found.tops is not None and found.tops.tolist() == [[0.0, 0.0, 4.0]]
    assert found.normals is not None and len(found.normals) == 2


def test_contours_that_were_not_closed_are_left_out_and_told():
    assert "stuck" in get_args(ContourStatus)
    found = contours_of(PATH, RecordedContours([contour(1), contour(2, "stuck")]))
    assert found.places == ("contour 1",)
    assert found.tops is None
    assert "left out 1 contours that were not closed" in found.notes


def test_a_recording_without_closed_contours_is_refused():
    with pytest.raises(InputError, match="holds no closed contour, of 1 that were traced"):
        contours_of(PATH, RecordedContours([contour(1, "stuck")]))


def test_the_topics_are_those_of_the_reconstructor():
    others = ("/model/goal", "/hand/contacts")
    inputs = {topic: kind for topic, (kind, _) in NODE.inputs.items() if topic not in others}
    assert inputs == MESSAGE_TYPES


def test_the_platform_is_a_touch_of_an_upright_object_alone():
    heights = {}
    for name, frame in (("upright", IDENTITY_POSE), ("tilted", TILTED)):
        found = contours_of(
            PATH, RecordedContours([contour(1, frame=frame), contour(2, frame=frame)], world=WORLD)
        )
        assert found.frame is not None and np.array_equal(found.frame, frame)
        heights[name] = None if found.tops is None else found.tops.tolist()
        notes = " ".join(found.notes)
        assert ("stands on its platform" in notes) == (name == "upright")
        assert ("sliced along an axis that leans by 73.7 deg" in notes) == (name == "tilted")
    assert heights == {"upright": [[0.0, 0.0, -0.3]], "tilted": None}


def test_contours_of_two_frames_are_refused():
    with pytest.raises(InputError, match=r"topics\.mcap: contours must be traced in one slicing"):
        contours_of(PATH, RecordedContours([contour(1), contour(2, frame=TILTED)]))


def test_probes_touch_the_ends_along_the_axis():
    traced = [contour(1, frame=TILTED), contour(2, frame=TILTED)]
    up, down = (transform_points(TILTED, np.array([[0.0, 0.0, z]]))[0] for z in (0.4, -0.2))
    probes = [replace(probe(i, hit=True), point=one) for i, one in enumerate((up, down), 4)]
    found = contours_of(PATH, RecordedContours(traced, probes))
    assert found.tops is not None and found.tops == pytest.approx(np.array([up, down]))


def test_a_frame_has_the_unit_of_its_points():
    found = contours_of(PATH, RecordedContours([contour(1, frame=TILTED)])).scaled(1000.0)
    assert found.frame == pytest.approx([10.0, 0.0, 50.0, 0.6, 0.0, 0.0, 0.8])


def test_taxels_have_normals_of_the_jet_or_else_of_the_pad():
    sensor = info_of(SensorSpec(), 1e-5)
    x, _ = pad_of_info(sensor).grid()
    jets = {0: (), 1: (0.0, 1e-4, 0.0, 0.0, 0.0, 0.0)}
    patches = [
        SimpleNamespace(
            goal=1, touch=touch, pose=IDENTITY_POSE, height=0.1 * x, mask=np.ones(x.shape, bool),
            jet=np.array(jet), jet_scale=1e-3,
        )
        for touch, jet in jets.items()
    ]  # fmt: skip
    found = contours_of(PATH, RecordedContours([contour(1)], patches=patches, sensor=sensor))
    of_pad, of_jet = (found.taxels.normals[found.taxels.touch == touch] for touch in jets)
    assert len(of_pad) == x.size and np.allclose(np.abs(of_pad[:, 2]), 1.0)
    assert np.allclose(np.abs(of_jet[:, 0] / of_jet[:, 2]), 0.1)
    assert f"{2 * x.size} taxels of 2 touches" in found.notes
