from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import pose_of
from palpate.core.rebuild.felt.felt_points import felt_points, stack_points
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
            assert felt.points.shape == felt.normals.shape == (touched.sum(), 3)
            assert np.allclose(np.linalg.norm(felt.points, axis=1), 0.03, rtol=1e-12)
            assert np.allclose(felt.normals, felt.points / 0.03, atol=5e-3)
            assert np.allclose(np.linalg.norm(felt.normals, axis=1), 1.0, atol=1e-14)


def test_without_a_jet_the_normal_is_the_pads(
    flat: Pad, rotations: Callable[[int], Floats]
) -> None:
    axes = rotations(1)[0]
    touched = np.zeros((16, 16), bool)
    touched[3, 4] = True
    felt = felt_points(flat, pose_of(np.ones(3), axes), np.zeros((16, 16)), touched, None)
    assert np.allclose(felt.normals, -axes[:, 2])
    x, y = flat.grid()
    assert np.allclose(felt.points[0], 1.0 + axes @ [x[3, 4], y[3, 4], 0.0])


def test_stacking_keeps_the_order_and_nothing_is_no_points(flat: Pad) -> None:
    touched = np.ones((16, 16), bool)
    pose = pose_of(np.zeros(3), np.eye(3))
    parts = [felt_points(flat, pose, np.full((16, 16), z), touched, None) for z in (0.1, 0.2)]
    both = stack_points(parts)
    assert np.array_equal(both.points[:, 2], np.repeat([0.1, 0.2], 256))
    assert len(both.normals) == 512
    none = stack_points([])
    assert none.points.shape == none.normals.shape == (0, 3)
