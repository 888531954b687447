"""Sets of touches: fitted as a whole or continued, openings of them, and slices that are hollow."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import trimesh

from palpate.core import no_steps
from palpate.core.arrays import Floats
from palpate.core.explore import empty_map
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.shapes import Mesh
from palpate.core.shapes.tessellations import icosphere
from palpate.core.touch import Pad
from palpate.messages.types.model import ModelGoal, PlanDone
from palpate.nodes.rebuilding import State, fitted_solids, published_solid, spanned_by
from palpate.nodes.rebuilding.candidates import HOLLOW, openings
from palpate.nodes.rebuilding.fitting import MORE
from palpate.nodes.rebuilding.soundness import SoundnessSettings, faults_of, lacks, missing_error
from palpate.nodes.rebuilding.volume import MeshVolume

RADIUS, MIDDLE = 0.02, np.array([0.0, 0.0, 0.05])
PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=6e-3, dome=0.0, saturation=0.5)
TOUCHES = 30


def touch_of(number: int, count: int = TOUCHES) -> ContactPoints:
    """What one of even touches of a ball has touched."""
    height = 1.0 - (2.0 * number + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * number
    level = np.sqrt(1.0 - height**2)
    normal = np.array([level * np.cos(turn), level * np.sin(turn), height])
    around = normal + 0.12 * np.random.default_rng(number).normal(size=(30, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    return ContactPoints(MIDDLE + RADIUS * around, around, np.zeros(30, np.int32))


def state_of(touches: int) -> State:
    """What has been received after so many single touches."""
    space = empty_map(0.1, 0.0)
    order = np.random.default_rng(0).permutation(TOUCHES)[:touches]
    received = {number: {0: touch_of(int(which))} for number, which in enumerate(order)}
    return replace(State(), pad=PAD, space=space, touches=received)


def goal_of(kind: Any, touches: int) -> Any:
    """A general solid of the first touches."""
    told: dict[str, Any] = {"reason": "", "reached": False, "uncovered": 0.0}
    told |= {"rms_bound_95": None, "largest_untouched": None}
    return kind(
        number=touches,
        contours=(),
        probes=tuple(range(touches)),
        touches=touches,
        robot_time=0.0,
        closings=0,
        general=True,
        **(told if kind is PlanDone else {}),
    )


asked = partial(goal_of, ModelGoal)


def error_of(general: Any) -> float:
    off = np.linalg.norm(general.mesh(1).vertices - MIDDLE, axis=1) - RADIUS
    return float(np.sqrt(np.mean(off**2)))


def test_a_set_with_a_touch_more_is_continued_and_the_last_one_fitted_as_a_whole():
    state = state_of(TOUCHES)
    before = asked(TOUCHES - 2)
    first = fitted_solids(state, before, no_steps)
    state = replace(state, history=(before,))
    then = fitted_solids(state, asked(TOUCHES), no_steps)
    assert then.whole == first.whole == TOUCHES - 2
    assert len(then.general.fit.displacements) == TOUCHES
    final = fitted_solids(replace(state, fitted={}), goal_of(PlanDone, TOUCHES), no_steps)
    assert final.whole == TOUCHES
    assert error_of(then.general) < 2.0 * error_of(final.general)


def test_many_more_touches_are_fitted_as_a_whole():
    state, before = state_of(TOUCHES), asked(int(TOUCHES / MORE) - 2)
    fitted_solids(state, before, no_steps)
    state = replace(state, history=(before,))
    assert fitted_solids(state, asked(TOUCHES), no_steps).whole == TOUCHES


def test_a_touch_beside_the_band_is_fitted_as_a_whole():
    state, before = state_of(TOUCHES), asked(TOUCHES - 1)
    fitted_solids(state, before, no_steps)
    beside = touch_of(0)._replace(points=touch_of(0).points + [0.0, 0.0, 0.03])
    received = {**state.touches, TOUCHES - 1: {0: beside}}
    state = replace(state, history=(before,), touches=received)
    assert fitted_solids(state, asked(TOUCHES), no_steps).whole == TOUCHES


def ball_mesh() -> Mesh:
    directions, faces = icosphere(3)
    return Mesh(MIDDLE + RADIUS * directions, faces)


def faults(vertices: Floats, touched: ContactPoints, deepest: float, deviation: float = 1e-5):
    """What contradicts a ball's mesh after a finger came down to so far over it [m]."""
    space = empty_map(0.1, 0.0)
    down = np.linspace(RADIUS + 0.02, RADIUS + deepest, 40)
    way = MIDDLE + down[:, None] * np.array([0.0, 0.0, 1.0])
    space = space.marked(space.numbers(way), np.zeros(0, np.int64))
    return faults_of(MeshVolume(ball_mesh()._replace(vertices=vertices)), deviation, touched, space)


SWEPT = SoundnessSettings().max_swept_depth


def all_touches() -> ContactPoints:
    return stack_points([touch_of(number) for number in range(TOUCHES)])


def spiked(height: float) -> Floats:
    vertices = ball_mesh().vertices.copy()
    vertices[vertices[:, 2].argmax(), 2] += height
    return vertices


def test_a_solid_that_nothing_contradicts_has_no_faults():
    assert faults(ball_mesh().vertices, all_touches(), -0.3 * SWEPT) == ()


@pytest.mark.parametrize(
    ("vertices", "off", "deepest", "deviation", "sentence"),
    [
        (spiked(0.5), 0.0, 0.0, 1e-5, "beyond the space that was explored"),
        (spiked(0.03), 0.0, 0.0, 1e-5, "beyond the space that was explored"),
        (ball_mesh().vertices, 0.0, -2.0 * SWEPT, 1e-5, "a finger has passed through"),
        (ball_mesh().vertices, 0.003, 0.0, 1e-5, "of the touches lie over 1.0 mm off it"),
        (ball_mesh().vertices, 0.0, 0.0, np.nan, "is not finite"),
        (spiked(np.nan), 0.0, 0.0, 1e-5, "is not finite"),
    ],
)
def test_a_solid_is_rejected_for_what_contradicts_it(
    vertices: Floats, off: float, deepest: float, deviation: float, sentence: str
):
    touched = all_touches()
    astray = touched.points + off * np.asarray(touched.normals) * (touched.touch < 3)[:, None]
    found = faults(vertices, touched._replace(points=astray), deepest, deviation)
    assert len(found) == 1 and sentence in found[0]


def test_touches_far_off_a_solid_tell_of_what_it_lacks():
    volume, touched = MeshVolume(ball_mesh()), all_touches()
    assert missing_error(volume, touched) == 0.0
    away = 0.04 * (touched.touch < 5)[:, None] * np.asarray(touched.normals)
    astray = touched._replace(points=touched.points + away)
    found = missing_error(volume, astray)
    assert lacks(volume, astray, 1.01 * found) == ()
    assert "touches show that it lacks surface" in lacks(volume, astray, 0.99 * found)[0]
    assert found == pytest.approx(np.sqrt(5 * 0.04**2 * 1e-4 / (4.0 * np.pi * RADIUS**2)), rel=0.05)


def test_a_finger_counts_only_where_it_has_been_said_to_count():
    swept = MIDDLE + np.array([[0.0, 0.0, 0.5 * RADIUS]])
    volume, touched = MeshVolume(ball_mesh()), all_touches()
    assert len(faults_of(volume, 1e-5, touched, None, swept=swept)) == 1
    assert faults_of(volume, 1e-5, touched, None, swept=swept[:0]) == ()


@pytest.mark.parametrize("bound", [1e-9, 1e-3])
def test_a_final_solid_off_its_draft_by_more_than_the_bound_is_rejected(bound: float):
    draft, final = asked(TOUCHES - 1), goal_of(PlanDone, TOUCHES)
    final = replace(final, probes=draft.probes, rms_bound_95=bound)
    state = replace(state_of(TOUCHES), history=(draft,))
    found = published_solid(state, final, no_steps)
    stands = fitted_solids(state, draft if bound < 1e-6 else final, no_steps)
    assert found.solid is stands.general
    assert bool(found.rejected) is (bound < 1e-6)


def test_where_no_solid_is_sound_the_one_before_stands():
    draft, later = asked(TOUCHES - 2), goal_of(PlanDone, TOUCHES)
    state = replace(state_of(TOUCHES), history=(draft,))
    assert state.space is not None
    before = published_solid(state, draft, no_steps)
    # The finger of the last touch went through the middle.
    middle = {TOUCHES - 1: (state.space.numbers(MIDDLE[None]),)}
    found = published_solid(replace(state, swept=middle), later, no_steps)
    assert found.solid is before.solid
    assert "a finger has passed through" in found.rejected[0]


def places(*spanned: Floats) -> Floats:
    state = replace(state_of(TOUCHES), spanned={0: spanned})
    return spanned_by(state, asked(TOUCHES))


def test_what_pads_spanned_counts_until_it_is_touched():
    beyond = MIDDLE + np.array([[0.0, 0.0, RADIUS + 0.01], [0.0, 0.0, RADIUS + 0.02]])
    assert np.array_equal(places(beyond), beyond)
    assert not len(places(touch_of(7).points + 1e-4))
    assert not len(places())


def test_an_opening_is_where_the_solid_says_that_a_pad_would_have_touched_it():
    depths = np.array([-2.0, 0.5, 1.5, 3.0]) * HOLLOW
    spanned = MIDDLE + (RADIUS - depths)[:, None] * np.array([0.6, 0.0, 0.8])
    assert np.array_equal(openings(spanned, MeshVolume(ball_mesh())), spanned[2:])
    assert openings(spanned[:0], MeshVolume(ball_mesh())).shape == (0, 3)


def test_who_stands_over_the_nearest_face_is_outside_and_rays_tell_of_the_others():
    ball = MeshVolume(ball_mesh())
    out = np.array([0.6, 0.0, 0.8])
    over = MIDDLE + np.outer([1.1, 2.0], RADIUS * out)
    assert not ball.depths(over).any()
    assert "shape" not in vars(ball)  # Nothing was made ready for rays
    within = MIDDLE + np.outer([0.5, 1.1], RADIUS * out)
    np.testing.assert_allclose(ball.depths(within), [0.5 * RADIUS, 0.0], atol=0.01 * RADIUS)


def test_a_place_in_a_bore_is_outside_however_near_its_rim():
    low, high = np.array([-0.03, -0.03, 0.0]), np.array([0.03, 0.03, 0.03])
    drilled = trimesh.creation.box(bounds=[low, high]).difference(
        trimesh.creation.cylinder(0.01, 0.1, sections=64)
    )
    volume = MeshVolume(Mesh(np.asarray(drilled.vertices), np.asarray(drilled.faces, np.int32)))
    grid = np.stack(np.meshgrid(*[np.linspace(-0.0347, 0.0353, 15)] * 3), axis=-1).reshape(-1, 3)
    away = np.hypot(*grid[:, :2].T)
    solid = (grid > low).all(axis=1) & (grid < high).all(axis=1) & (away > 0.01)
    assert np.array_equal(volume.depths(grid) > 0.0, solid)
