from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.geometry.distances import SAMPLES, compare_surfaces, prepare_surface
from palpate.core.poses import IDENTITY_POSE
from palpate.core.shapes.tessellations import icosphere
from palpate.messages.codec import encode
from palpate.messages.types.model import Score, ShapeModel
from palpate.messages.types.world import Truth
from palpate.nodes.evaluator import EVERY, NODE, Params, State, take_model, take_truth
from palpate.nodes.runtime.node import Finished, resolved
from palpate.nodes.runtime.testing import example

Model = Callable[..., ShapeModel]
RADIUS = 0.04


@pytest.fixture
def truth() -> Truth:
    """A ball of 80 mm."""
    (directions, faces), (coarse, coarse_faces) = icosphere(4), icosphere(3)
    return Truth(
        vertices=RADIUS * directions,
        faces=faces,
        floor_vertices=RADIUS * coarse,
        floor_faces=coarse_faces,
        height=2 * RADIUS,
    )


@pytest.fixture
def model() -> Model:
    """Makes a ball of some radius as a model."""

    def make(radius: float, *, final: bool = False) -> ShapeModel:
        directions, faces = icosphere(4)
        return example(
            ShapeModel,
            number=3,
            contours=(1, 2, 5),
            control=np.zeros((2, 2, 2, 3)),
            undeformed=np.zeros((2, 2, 2, 3)),
            knots_columns=np.zeros(6),
            knots_rows=np.zeros(6),
            knots_layers=np.zeros(6),
            vertices=radius * directions,
            faces=faces,
            frame=IDENTITY_POSE,
            touches=42,
            robot_time=60.5,
            final=final,
        )

    return make


@pytest.fixture
def informed(truth: Truth) -> State:
    state, outputs = take_truth(Params(), None, truth)
    assert outputs == []
    return state


def score_of(state: State, model: ShapeModel) -> Score:
    _, [output, *_] = take_model(Params(), state, model)
    assert not isinstance(output, Finished)
    topic, later = output
    score = resolved(later)
    assert topic == "/score"
    assert isinstance(score, Score)
    return score


def test_a_model_that_is_the_truth_is_at_no_distance(informed: State, model: Model):
    score = score_of(informed, model(RADIUS))
    assert score.hausdorff < 1e-15
    assert (score.volume_error, score.watertight, score.genus) == (0.0, True, 0)


def test_a_ball_that_is_too_large_is_too_large_by_that_much(informed: State, model: Model):
    score = score_of(informed, model(RADIUS * 1.02))
    assert score.chamfer == pytest.approx(0.02 * RADIUS, rel=0.02)
    assert score.volume_error == pytest.approx(1.02**3 - 1, rel=1e-9)
    assert score.p95 <= score.hausdorff
    assert score.chamfer <= score.rms <= score.hausdorff


def test_the_score_tells_what_the_model_cost(informed: State, model: Model):
    score = score_of(informed, model(RADIUS))
    assert (score.number, score.contours, score.touches) == (3, 3, 42)
    assert (score.robot_time, score.size, score.final) == (60.5, 2 * RADIUS, False)


@pytest.mark.parametrize(("final", "samples"), [(True, SAMPLES), (False, SAMPLES // EVERY)])
def test_the_sampling_floor_is_the_distance_of_two_tessellations(
    informed: State, model: Model, truth: Truth, final: bool, samples: int
):
    floor = prepare_surface(truth.floor_vertices, truth.floor_faces)
    whole = prepare_surface(truth.vertices, truth.faces)
    expected = compare_surfaces(whole, floor).chamfer
    found = score_of(informed, model(RADIUS, final=final)).sampling_floor
    assert found == pytest.approx(expected, rel=0.0 if final else 0.05)
    few = compare_surfaces(*(one.thinned(SAMPLES // samples) for one in (whole, floor)))
    assert found == few.chamfer
    assert 0.0 < expected < 0.01 * RADIUS


def test_a_model_on_the_way_is_measured_by_fewer_samples(informed: State, model: Model):
    whole, few = (score_of(informed, model(RADIUS * 1.01, final=final)) for final in (True, False))
    assert few.rms != whole.rms
    assert few.rms == pytest.approx(whole.rms, rel=0.01)


def test_only_the_final_model_ends_the_graph(informed: State, model: Model):
    _, going_on = take_model(Params(), informed, model(RADIUS))
    _, ended = take_model(Params(), informed, model(RADIUS, final=True))
    assert len(going_on) == 1
    assert ended[1:] == [Finished("the final solid was compared with the true one")]
    assert resolved(ended[0][1]).final  # type: ignore[index, attr-defined]


def test_an_open_model_has_no_genus(informed: State, model: Model):
    whole = model(RADIUS)
    score = score_of(informed, replace(whole, faces=whole.faces[1:]))
    assert (score.watertight, score.genus) == (False, -1)


def test_the_same_inputs_give_the_same_bytes(truth: Truth, model: Model):
    bodies = set()
    for _ in range(2):
        state, _ = take_truth(Params(), None, truth)
        bodies.add(encode(score_of(state, model(RADIUS * 1.01))))
    assert len(bodies) == 1


def test_a_model_before_the_truth_is_refused(model: Model):
    with pytest.raises(ValueError, match="model 3 came before the truth"):
        take_model(Params(), None, model(RADIUS))
    assert NODE.needs == ("/truth",)


def test_a_truth_without_volume_is_refused(truth: Truth):
    with pytest.raises(ValueError, match=r"the truth must have a positive volume, got -0\.0002"):
        take_truth(Params(), None, replace(truth, faces=truth.faces[:, ::-1]))


def test_a_model_without_faces_has_no_score(informed: State, model: Model):
    empty = replace(model(RADIUS), faces=np.zeros((0, 3), np.int32))
    assert take_model(Params(), informed, empty)[1] == []


def test_a_final_model_without_faces_ends_the_graph(informed: State, model: Model):
    empty = replace(model(RADIUS, final=True), faces=np.zeros((0, 3), np.int32))
    assert take_model(Params(), informed, empty)[1] == [Finished("nothing could be rebuilt")]


def test_a_model_that_is_no_surface_is_refused(informed: State, model: Model):
    wrong = replace(model(RADIUS), faces=np.array([[0, 1, 99_999]], np.int32))
    with pytest.raises(ValueError, match="faces must name vertices from 0 to 2561, got 99999"):
        score_of(informed, wrong)
