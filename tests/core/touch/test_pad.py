from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN, pose_of, split_pose
from palpate.core.shapes.protocol import PosedShape
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.touch.effects.rubber import HalfSpace, Tenting
from palpate.core.touch.pad import Calibration, FaceModel, Pad, contact_mask, guarded_move

# A pad 20 mm over the ball's pole, looking down.
ABOVE = pose_of(np.array([0.0, 0.0, 0.05]), FACING_DOWN)


def test_the_grid_is_centred_with_x_along_columns_and_y_along_rows():
    x, y = Pad(rows=3, cols=4, pitch=0.002, thickness=0.003, dome=0.0, saturation=0.8).grid()
    assert x.shape == y.shape == (3, 4)
    assert np.allclose(x, np.array([-0.003, -0.001, 0.001, 0.003])[None, :])
    assert np.allclose(y, np.array([-0.002, 0.0, 0.002])[:, None])


def test_a_dome_falls_back_as_a_paraboloid_and_a_flat_pad_not_at_all(flat, domed):
    x, y = domed.grid()
    assert np.allclose(domed.sag(), (x**2 + y**2) / (2 * 0.015))
    assert (flat.sag() == 0.0).all()


@pytest.mark.parametrize("depth", [0.1e-3, 1e-3, 2.2e-3])
def test_a_hit_reaches_the_asked_depth_at_its_deepest_taxel(depth, flat, domed, ball):
    for pad in (flat, domed):
        end = guarded_move(ball, pad, ABOVE, 0.05, depth)
        assert end.outcome == "hit"
        assert end.compression.max() == pytest.approx(depth, abs=1e-15)
        assert end.compression.min() >= 0.0
        assert np.allclose(end.pose[:2], 0.0)
        assert end.pose[2] == pytest.approx(0.05 - end.advance)


def test_the_touched_face_takes_the_shape_of_the_surface(flat, domed, ball):
    for pad in (flat, domed):
        end = guarded_move(ball, pad, ABOVE, 0.05, 1e-3)
        x, y = pad.grid()
        touched = end.compression > 0
        over = end.pose[2] + end.compression + pad.sag()
        assert np.allclose((x**2 + y**2 + over**2)[touched], 0.03**2, rtol=1e-12)
        # Elsewhere the face has not reached the ball yet.
        face = end.pose[2] + pad.sag()
        assert (x**2 + y**2 + face**2 >= 0.03**2 * (1 - 1e-12))[~touched].all()


def test_one_cast_is_as_good_as_many_small_steps(flat, box, rotations):
    for axes in rotations(4):
        shape = PosedShape(box, pose_of(np.zeros(3), axes))
        pose, steps = pose_of(np.array([0.0, 0.0, 0.08]), FACING_DOWN), 0
        whole = guarded_move(shape, flat, pose, 0.08, 1e-3)
        while True:
            step = guarded_move(shape, flat, pose, 2e-3, 1e-3)
            if step.outcome != "miss":
                break
            pose, steps = step.pose, steps + 1
            assert steps < 100
        assert whole.outcome == step.outcome == "hit"
        assert np.allclose(step.pose, whole.pose, rtol=0, atol=1e-11)
        assert np.allclose(step.compression, whole.compression, rtol=0, atol=1e-11)


def test_a_miss_ends_where_the_reach_ends_with_an_untouched_pad(flat, ball):
    end = guarded_move(ball, flat, ABOVE, 0.0199, 1e-3)
    assert end.outcome == "miss"
    assert end.advance == 0.0199
    assert end.pose[2] == pytest.approx(0.05 - 0.0199)
    assert (end.compression == 0.0).all()


def test_reach_counts_to_first_contact_and_depth_comes_after_it(flat, ball):
    gap = 0.05 - np.sqrt(0.03**2 - 2 * 0.0005**2)  # the middle four taxels are 0.5 mm off
    assert guarded_move(ball, flat, ABOVE, gap - 1e-9, 1e-3).outcome == "miss"
    end = guarded_move(ball, flat, ABOVE, gap + 1e-9, 1e-3)
    assert end.outcome == "hit"
    assert end.compression.max() == pytest.approx(1e-3, abs=1e-12)


@pytest.mark.parametrize(("height", "outcome"), [(0.0329, "hit"), (0.0, "inside")])
def test_a_pad_that_starts_in_the_object_does_not_move(height, outcome, flat, ball):
    end = guarded_move(ball, flat, pose_of(np.array([0.0, 0.0, height]), FACING_DOWN), 0.05, 1e-3)
    assert end.outcome == outcome
    assert (end.advance == 0.0) == (outcome == "inside")


def test_a_face_that_starts_in_object_with_its_transducers_outside_is_inside(flat, ball):
    start = pose_of(np.array([0.0, 0.0, 0.0299]), FACING_DOWN)
    end = guarded_move(ball, flat, start, 0.05, 1e-3)
    assert end.outcome == "inside"
    assert np.array_equal(end.pose, start)
    assert (end.compression == 0.0).all()


def test_a_press_beyond_saturation_bottoms(flat, ball):
    end = guarded_move(ball, flat, ABOVE, 0.05, 2.9e-3)
    assert end.outcome == "bottomed"
    assert end.compression.max() == pytest.approx(0.8 * 3e-3)


def test_a_thin_plate_is_touched_on_the_near_side_even_if_pressed_beyond_the_far_one(flat):
    plate = Superquadric(np.array([0.05, 0.05, 0.0005]), np.full(2, 0.05))
    end = guarded_move(plate, flat, ABOVE, 0.06, 2e-3)
    assert end.outcome == "hit"
    assert np.allclose(end.compression, 2e-3, atol=1e-12)


def test_the_pad_moves_along_its_own_normal(domed, ball, rotations):
    for axes in rotations(5):
        start = pose_of(-0.05 * axes[:, 2], axes)
        end = guarded_move(ball, domed, start, 0.05, 1e-3)
        place, turned = split_pose(end.pose)
        assert end.outcome == "hit"
        assert np.allclose(turned, axes, atol=1e-14)
        assert np.allclose(place, (end.advance - 0.05) * axes[:, 2], atol=1e-15)
        assert np.allclose(end.compression, end.compression[::-1, ::-1], atol=1e-12)


LEAST = 50e-6
SURFACES: dict[str, Callable[[Floats, Floats], Floats]] = {
    "ball": lambda x, y: 1e-3 - (x * x + y * y) / 0.04,
    "cylinder": lambda x, y: 1e-3 - (0.6 * x + 0.8 * y) ** 2 / 0.04,
    "ridge": lambda x, y: 1e-3 - np.abs(x + 0.2e-3),
    "corner": lambda x, y: 1.5e-3 - np.maximum(np.abs(x), np.abs(y + 0.3e-3)),
    "two balls": lambda x, y: 0.8e-3 - ((np.abs(x) - 4e-3) ** 2 + y * y) / 0.01,
}


def pressed(effect, finger, make_touch, surface):
    """The pad as a subscriber knows it, what it reads, and where it is really touched."""
    field = SURFACES[surface](*finger.pad.grid())
    springs = np.maximum(field, 0.0)
    touch = make_touch(field=field, compression=springs, pressure=2e8 * springs)
    stage = effect.prepare(finger)
    stage.apply(touch, stage.state)
    assert stage.face is not None
    return replace(finger.pad, face=stage.face), touch.compression, touch.pressure > 0.0


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("effect", [HalfSpace(), Tenting(), Tenting(decay=2e-3)], ids=repr)
def test_the_skirt_about_a_contact_is_not_contact(effect, surface, make_finger, make_touch):
    pad, reading, truly = pressed(effect, make_finger(), make_touch, surface)
    found = contact_mask(pad, reading, LEAST, 0.0)
    assert ((reading > LEAST) & ~truly).sum() > 5  # there is a skirt to be taken in by
    assert not (found & ~truly).any()
    # A taxel at the rim that the surface touches without pressing it is given up: of the two
    # rows on a ridge's back the deeper one carries a stiff skin alone.
    least = 0.5 if surface == "ridge" else 0.6
    assert found.sum() >= least * (truly & (reading > LEAST)).sum()
    assert found[np.unravel_index(reading.argmax(), reading.shape)]


def test_on_springs_what_is_compressed_is_touched(make_finger):
    pad = make_finger().pad
    reading = SURFACES["ball"](*pad.grid())
    assert np.array_equal(contact_mask(pad, reading, LEAST, 0.0), reading > LEAST)


@pytest.mark.parametrize("face", [FaceModel("membrane", 1e-3), FaceModel("half_space")])
def test_noise_over_nothing_is_not_a_contact(face, make_finger):
    pad = replace(make_finger().pad, face=face)
    rng = np.random.default_rng(0)
    noise = 10e-6 * rng.standard_normal((200, pad.rows, pad.cols))
    assert not any(contact_mask(pad, frame, LEAST, 10e-6).any() for frame in noise)


@pytest.mark.parametrize("face", [FaceModel("membrane", 1e-3), FaceModel("half_space")])
def test_noise_beside_a_contact_is_not_a_contact(face, make_finger, make_touch):
    effect = HalfSpace() if face.kind == "half_space" else Tenting()
    pad, reading, truly = pressed(effect, make_finger(), make_touch, "ball")
    rng = np.random.default_rng(1)
    for _ in range(50):
        found = contact_mask(
            pad, reading + 10e-6 * rng.standard_normal(reading.shape), LEAST, 10e-6
        )
        assert not (found & ~truly).any()
        assert found.sum() >= 0.6 * truly.sum()


ECHO = Calibration("time", thickness=3e-3, sound_speed=1000.0, taxel_stiffness=200.0)
FORCE = Calibration("force", thickness=3e-3, sound_speed=1000.0, taxel_stiffness=200.0)


def test_an_untouched_pad_echoes_after_twice_its_thickness():
    assert np.allclose(ECHO.encode(np.zeros((2, 2))), 6e-6, rtol=1e-15)


def test_a_micrometre_of_compression_saves_two_nanoseconds():
    times = ECHO.encode(np.array([0.0, 1e-6]))
    assert np.isclose(times[0] - times[1], 2e-9, rtol=1e-6)


def test_the_difference_of_two_times_is_the_compression_of_1_1():
    t1, t2 = ECHO.encode(np.array([0.0, 0.7e-3]))
    assert 0.5 * 1000.0 * (t1 - t2) == pytest.approx(0.7e-3, rel=1e-12)


def test_force_is_stiffness_times_compression_as_in_1_2():
    assert FORCE.encode(np.array([0.7e-3]))[0] == pytest.approx(200.0 * 0.7e-3, rel=1e-15)


@pytest.mark.parametrize("sheet", [ECHO, FORCE])
def test_compression_survives_the_way_through_the_signal(sheet):
    compression = np.random.default_rng(0).uniform(0.0, 2.4e-3, (16, 16))
    back = sheet.decode(sheet.encode(compression))
    assert np.allclose(back, compression, rtol=0, atol=2e-18)


def test_gain_and_offset_of_each_taxel_correct_what_it_says():
    gain, offset = np.array([[1.1, 0.9]]), np.array([[1e-5, -2e-5]])
    found = Calibration("time", 3e-3, 1000.0, 200.0, gain=gain, offset=offset)
    read = (np.array([[1e-3, 1e-3]]) - offset) / gain
    assert np.allclose(found.decode(ECHO.encode(read)), 1e-3, rtol=1e-12)


def test_a_wrong_speed_of_sound_is_an_error_of_thickness():
    slow = Calibration("time", 3e-3, 985.0, 200.0)
    seen = slow.decode(ECHO.encode(np.array([1e-3])))[0]
    assert seen == pytest.approx(3e-3 - 2e-3 * 985.0 / 1000.0, rel=1e-12)
