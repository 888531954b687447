from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import DOWN, pose_of, split_pose
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.pad import Pad, press

ABOVE = pose_of(np.array([0.0, 0.0, 0.05]), DOWN)
"""A pad 20 mm over the ball's pole, looking down."""


def test_the_grid_is_centred_with_x_along_columns_and_y_along_rows() -> None:
    x, y = Pad(rows=3, cols=4, pitch=0.002, thickness=0.003, dome=0.0, saturation=0.8).grid()
    assert x.shape == y.shape == (3, 4)
    assert np.allclose(x, np.array([-0.003, -0.001, 0.001, 0.003])[None, :])
    assert np.allclose(y, np.array([-0.002, 0.0, 0.002])[:, None])


def test_a_dome_falls_back_as_a_paraboloid_and_a_flat_pad_not_at_all(flat: Pad, domed: Pad) -> None:
    x, y = domed.grid()
    assert np.allclose(domed.sag(), (x**2 + y**2) / (2 * 0.015))
    assert (flat.sag() == 0.0).all()


@pytest.mark.parametrize("depth", [0.1e-3, 1e-3, 2.2e-3])
def test_a_hit_reaches_the_asked_depth_at_its_deepest_taxel(
    depth: float, flat: Pad, domed: Pad, ball: Superquadric
) -> None:
    for pad in (flat, domed):
        end = press(ball, pad, ABOVE, 0.05, depth)
        assert end.outcome == "hit"
        assert end.compression.max() == pytest.approx(depth, abs=1e-15)
        assert end.compression.min() >= 0.0
        assert np.allclose(end.pose[:2], 0.0)
        assert end.pose[2] == pytest.approx(0.05 - end.advance)


def test_the_touched_face_takes_the_shape_of_the_surface(
    flat: Pad, domed: Pad, ball: Superquadric
) -> None:
    for pad in (flat, domed):
        end = press(ball, pad, ABOVE, 0.05, 1e-3)
        x, y = pad.grid()
        touched = end.compression > 0
        over = end.pose[2] + end.compression + pad.sag()
        assert np.allclose((x**2 + y**2 + over**2)[touched], 0.03**2, rtol=1e-12)
        # Elsewhere the face has not reached the ball yet.
        face = end.pose[2] + pad.sag()
        assert (x**2 + y**2 + face**2 >= 0.03**2 * (1 - 1e-12))[~touched].all()


def test_one_cast_is_as_good_as_many_small_steps(
    flat: Pad, box: Superquadric, rotations: Callable[[int], Floats]
) -> None:
    for axes in rotations(4):
        shape = PosedShape(box, pose_of(np.zeros(3), axes))
        pose, steps = pose_of(np.array([0.0, 0.0, 0.08]), DOWN), 0
        whole = press(shape, flat, pose, 0.08, 1e-3)
        while True:
            step = press(shape, flat, pose, 2e-3, 1e-3)
            if step.outcome != "miss":
                break
            pose, steps = step.pose, steps + 1
            assert steps < 100
        assert whole.outcome == step.outcome == "hit"
        assert np.allclose(step.pose, whole.pose, rtol=0, atol=1e-11)
        assert np.allclose(step.compression, whole.compression, rtol=0, atol=1e-11)


def test_a_miss_ends_where_the_reach_ends_with_an_untouched_pad(
    flat: Pad, ball: Superquadric
) -> None:
    end = press(ball, flat, ABOVE, 0.0199, 1e-3)
    assert end.outcome == "miss"
    assert end.advance == 0.0199
    assert end.pose[2] == pytest.approx(0.05 - 0.0199)
    assert (end.compression == 0.0).all()


def test_reach_counts_to_first_contact_and_depth_comes_after_it(
    flat: Pad, ball: Superquadric
) -> None:
    gap = 0.05 - np.sqrt(0.03**2 - 2 * 0.0005**2)  # the middle four taxels are 0.5 mm off
    assert press(ball, flat, ABOVE, gap - 1e-9, 1e-3).outcome == "miss"
    end = press(ball, flat, ABOVE, gap + 1e-9, 1e-3)
    assert end.outcome == "hit"
    assert end.compression.max() == pytest.approx(1e-3, abs=1e-12)


@pytest.mark.parametrize(("height", "outcome"), [(0.0329, "hit"), (0.0, "inside")])
def test_a_pad_that_starts_in_the_object_does_not_move(
    height: float, outcome: str, flat: Pad, ball: Superquadric
) -> None:
    end = press(ball, flat, pose_of(np.array([0.0, 0.0, height]), DOWN), 0.05, 1e-3)
    assert end.outcome == outcome
    assert (end.advance == 0.0) == (outcome == "inside")


def test_a_face_that_starts_in_the_object_with_its_transducers_outside_is_inside(
    flat: Pad, ball: Superquadric
) -> None:
    start = pose_of(np.array([0.0, 0.0, 0.0299]), DOWN)
    end = press(ball, flat, start, 0.05, 1e-3)
    assert end.outcome == "inside"
    assert np.array_equal(end.pose, start)
    assert (end.compression == 0.0).all()


def test_a_press_beyond_saturation_bottoms(flat: Pad, ball: Superquadric) -> None:
    end = press(ball, flat, ABOVE, 0.05, 2.9e-3)
    assert end.outcome == "bottomed"
    assert end.compression.max() == pytest.approx(0.8 * 3e-3)


def test_a_thin_plate_is_felt_on_the_near_side_even_if_pressed_beyond_the_far_one(
    flat: Pad,
) -> None:
    plate = Superquadric(np.array([0.05, 0.05, 0.0005]), np.full(2, 0.05))
    end = press(plate, flat, ABOVE, 0.06, 2e-3)
    assert end.outcome == "hit"
    assert np.allclose(end.compression, 2e-3, atol=1e-12)


def test_the_pad_moves_along_its_own_normal(
    domed: Pad, ball: Superquadric, rotations: Callable[[int], Floats]
) -> None:
    for axes in rotations(5):
        start = pose_of(-0.05 * axes[:, 2], axes)
        end = press(ball, domed, start, 0.05, 1e-3)
        place, turned = split_pose(end.pose)
        assert end.outcome == "hit"
        assert np.allclose(turned, axes, atol=1e-14)
        assert np.allclose(place, (end.advance - 0.05) * axes[:, 2], atol=1e-15)
        assert np.allclose(end.compression, end.compression[::-1, ::-1], atol=1e-12)
