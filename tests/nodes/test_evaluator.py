"""Evaluator node: models against the truth, by the distances of two balls."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.geometry import compare_surfaces, prepare_surface
from palpate.messages import encode
from palpate.messages.types import ShapeModel, Truth
from palpate.nodes.evaluator import NODE
from palpate.nodes.runtime.node import Finished
from palpate.nodes.runtime.testing import drive, example
from palpate.nodes.specs.objects import build_shape
from tests.messages.cases import cases
from tests.nodes.loop import ball_spec

RADIUS = 0.04


@cache
def ball(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a ball of 80 mm."""
    return tuple(build_shape(ball_spec(RADIUS, (0.0, 0.0, 0.0))).mesh(level))


TRUTH = Truth(
    vertices=ball(4)[0],
    faces=ball(4)[1],
    floor_vertices=ball(3)[0],
    floor_faces=ball(3)[1],
    height=2 * RADIUS,
)


def model(scale: float = 1.0, **changes: Any) -> ShapeModel:
    vertices, faces = ball(4)
    fields = {"vertices": scale * vertices, "faces": faces, "contours": (1, 2, 5), "number": 3}
    return example(ShapeModel, **{**fields, "touches": 42, "robot_time": 60.5, **changes})


def judged(*models: ShapeModel) -> list[Any]:
    inputs = [("/truth", TRUTH), *(("/model/shape", one) for one in models)]
    return [one if isinstance(one, Finished) else one[1] for one in drive(NODE, inputs)]


def test_errors_are_those_of_two_balls_and_costs_are_copied():
    result = judged(model())[0]
    assert result.hausdorff < 1e-15 and result.normal < 1e-5
    assert (result.volume_error, result.watertight) == (0, True)
    assert (result.genus, result.true_genus) == (0, 0)
    assert (result.number, result.contours, result.touches) == (3, 3, 42)
    assert (result.robot_time, result.size, result.final) == (60.5, 2 * RADIUS, False)
    result = judged(model(1.02))[0]
    assert result.chamfer == pytest.approx(0.02 * RADIUS, rel=0.02)
    assert result.volume_error == pytest.approx(1.02**3 - 1, rel=1e-9)
    assert result.chamfer <= result.rms <= result.hausdorff and result.p95 <= result.hausdorff


def test_final_model_is_measured_by_all_samples_and_ends_the_graph():
    on_the_way, final, end = judged(model(1.01), model(1.01, final=True))
    assert end == Finished("the final solid was compared with the true one") and final.final
    assert final.rms != on_the_way.rms == pytest.approx(final.rms, rel=0.01)
    whole, floor = (prepare_surface(*ball(level)) for level in (4, 3))
    assert final.sampling_floor == compare_surfaces(whole, floor).chamfer
    assert on_the_way.sampling_floor == pytest.approx(final.sampling_floor, rel=0.05)
    assert 0.0 < on_the_way.sampling_floor < 0.01 * RADIUS


def test_open_surface_has_no_genus_and_a_model_without_faces_no_score():
    assert encode(judged(model(1.01))[0]) == encode(judged(model(1.01))[0])
    opened = judged(model(faces=ball(4)[1][1:]))[0]
    assert (opened.watertight, opened.genus) == (False, -1)
    empty = np.zeros((0, 3), np.int32)
    assert judged(model(faces=empty)) == []
    assert judged(model(faces=empty, final=True)) == [Finished("nothing could be rebuilt")]


ASTRAY = model(faces=np.array([[0, 1, 99]], np.int32) * 1000)


@cases(
    "inputs, words",
    ([("/truth", replace(TRUTH, faces=TRUTH.faces[:, ::-1]))], r"volume, got -0\.0002"),
    ([("/truth", TRUTH), ("/model/shape", ASTRAY)], r"faces must name .* 0 to \d+, got 99000"),
)
def test_mesh_that_is_no_solid_or_surface_is_refused(inputs: list[Any], words: str):
    with pytest.raises(ValueError, match=words):
        drive(NODE, inputs)
    assert drive(NODE, [("/model/shape", model())]) == []  # which waits for the truth
    with pytest.raises(ValueError, match="model 3 came before the truth"):
        NODE.inputs["/model/shape"][1](None, None, model())
