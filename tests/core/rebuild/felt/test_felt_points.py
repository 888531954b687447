from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import pose_of
from palpate.core.rebuild.felt.felt_points import (
    FeltPoints,
    checked,
    felt_points,
    stack_points,
)
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.jet_fit import fit_jet
from palpate.core.touch.pad import Pad, press


def test_touched_taxels_lie_on_the_ball_with_its_normals(
    flat: Pad, domed: Pad, ball: Superquadric, rotations: Callable[[int], Floats]
) -> None:
    for pad in (flat, domed):
        for axes in rotations(5):
            end = press(ball, pad, pose_of(-0.05 * axes[:, 2], axes), 0.05, 1e-3)
            touched = end.compression > 0
            surface = -(end.compression + pad.sag())
            fitted = fit_jet(pad, surface, touched)
            assert fitted is not None
            felt = felt_points(pad, end.pose, surface, touched, fitted.jet)
            assert felt.points.shape == np.asarray(felt.normals).shape == (touched.sum(), 3)
            assert np.allclose(np.linalg.norm(felt.points, axis=1), 0.03, rtol=1e-12)
            assert np.allclose(np.asarray(felt.normals), felt.points / 0.03, atol=5e-3)
            assert np.allclose(np.linalg.norm(np.asarray(felt.normals), axis=1), 1.0, atol=1e-14)


def test_without_a_jet_the_normal_is_the_pads(
    flat: Pad, rotations: Callable[[int], Floats]
) -> None:
    axes = rotations(1)[0]
    touched = np.zeros((16, 16), bool)
    touched[3, 4] = True
    felt = felt_points(flat, pose_of(np.ones(3), axes), np.zeros((16, 16)), touched, None)
    assert np.allclose(np.asarray(felt.normals), -axes[:, 2])
    x, y = flat.grid()
    assert np.allclose(felt.points[0], 1.0 + axes @ [x[3, 4], y[3, 4], 0.0])


def test_stacking_keeps_the_order_and_nothing_is_no_points(flat: Pad) -> None:
    touched = np.ones((16, 16), bool)
    pose = pose_of(np.zeros(3), np.eye(3))
    parts = [felt_points(flat, pose, np.full((16, 16), z), touched, None) for z in (0.1, 0.2)]
    both = stack_points(parts)
    assert np.array_equal(both.points[:, 2], np.repeat([0.1, 0.2], 256))
    assert len(np.asarray(both.normals)) == 512
    none = stack_points([])
    assert none.points.shape == np.asarray(none.normals).shape == (0, 3)


def test_no_two_parts_of_a_stack_share_a_touch(flat: Pad) -> None:
    touched = np.ones((16, 16), bool)
    pose = pose_of(np.zeros(3), np.eye(3))
    one = felt_points(flat, pose, np.zeros((16, 16)), touched, None)
    pair = stack_points([one, one])
    assert np.unique(stack_points([pair, one, pair]).touch).tolist() == [0, 1, 2, 3, 4]


def test_a_stack_has_normals_only_if_every_part_has(flat: Pad) -> None:
    touched = np.ones((16, 16), bool)
    pose = pose_of(np.zeros(3), np.eye(3))
    one = felt_points(flat, pose, np.zeros((16, 16)), touched, None)
    assert stack_points([one, one._replace(normals=None)]).normals is None


def test_touches_are_numbered_anew_and_normals_get_length_1() -> None:
    felt = FeltPoints(np.zeros((3, 3)), np.full((3, 3), 2.0), np.array([7, 7, 3], np.int32))
    found = checked(felt)
    assert found.touch.tolist() == [1, 1, 0]
    assert found.normals is not None
    assert np.allclose(np.linalg.norm(found.normals, axis=1), 1.0)
    assert checked(felt._replace(normals=None)).normals is None


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"points": np.zeros((3, 2))}, "patches.points must have shape"),
        ({"points": np.full((3, 3), np.nan)}, "patches.points must be finite"),
        ({"touch": np.zeros(2)}, "patches.touch must have shape"),
        ({"touch": np.array([0.0, 1.0, 1.5])}, "patches.touch must be whole numbers from 0 on"),
        ({"touch": np.array([0, -1, 1])}, "patches.touch must be whole numbers from 0 on, got -1"),
        ({"normals": np.zeros((3, 3))}, "patches.normals must have a length, got 3 of 0"),
        ({"normals": np.ones((2, 3))}, "patches.normals must have shape"),
    ],
)
def test_felt_points_that_cannot_be_used_are_refused(wrong: dict[str, Any], words: str) -> None:
    felt = FeltPoints(np.zeros((3, 3)), np.ones((3, 3)), np.arange(3, dtype=np.int32))
    with pytest.raises(ValueError, match=words):
        checked(felt._replace(**wrong))
