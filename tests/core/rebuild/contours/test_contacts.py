"""Contact points of touches: places, normals, edges, stacks, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.core.rebuild import contours
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.shapes import Superquadric
from palpate.core.touch import Pad, fit_jet, guarded_move, surface_points
from tests.core.rebuild.objects import at_height, circle, contacts

FLAT = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
DOMED = replace(FLAT, dome=1 / 0.015)
BALL = Superquadric(np.full(3, 0.03), np.ones(2))
ALL = np.ones((16, 16), np.bool_)
HERE = Pose(np.zeros(3), np.eye(3))


def touched_surface(surface: Floats, touched: Floats = ALL, pad: Pad = FLAT, pose: Pose = HERE):
    """Contacts of a pad with a surface over it."""
    fitted = fit_jet(pad, surface, touched)
    return surface_points(pad, pose, surface, touched, fitted.jet)


def slopes(touched: ContactPoints) -> Floats:
    normals = np.asarray(touched.normals)
    return -normals[:, :2] / normals[:, 2:]


def test_touched_taxels_lie_on_ball_with_its_normals(rotations):
    for pad in (FLAT, DOMED):
        for axes in rotations(5):
            end = guarded_move(BALL, pad, Pose(-0.05 * axes[:, 2], axes), 0.05, 1e-3)
            touched = end.compression > 0
            result = touched_surface(-end.compression - pad.sag(), touched, pad, end.pose)
            normals = np.asarray(result.normals)
            assert result.points.shape == normals.shape == (touched.sum(), 3)
            assert np.allclose(np.linalg.norm(result.points, axis=1), 0.03, rtol=1e-12)
            assert np.allclose(normals, result.points / 0.03, atol=5e-3)
            assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-14)


@pytest.mark.parametrize("noise", [0.0, 5e-6])
def test_taxels_beside_edge_have_normals_of_their_side(noise):
    x, _ = FLAT.grid()
    roof = np.minimum(0.2 * x, -0.5 * x)  # Two planes that meet between two columns
    touched = touched_surface(roof + np.random.default_rng(0).normal(0.0, noise, x.shape))
    expected = np.where(touched.points[:, 0] < 0, 0.2, -0.5)
    off = np.abs(slopes(touched)[:, 0] - expected)
    assert len(off) > 240
    assert off.max() < 0.1  # The jet alone is off by 0.35 in the middle
    assert np.median(off) < 5 * noise / 1e-3 + 1e-9


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-4])
def test_smooth_surface_keeps_normals_of_its_jet(noise):
    x, y = FLAT.grid()
    smooth = (x**2 - 0.5 * x * y) / 0.03
    result = touched_surface(smooth + np.random.default_rng(1).normal(0.0, noise, x.shape))
    assert len(result.points) > 253  # one taxel in a hundred may be left out
    at = result.points[:, :2]
    expected = np.column_stack([2.0 * at[:, 0] - 0.5 * at[:, 1], -0.5 * at[:, 0]]) / 0.03
    off = np.abs(slopes(result) - expected)
    assert off.max() < 1e-9 + 400.0 * noise  # at the rim of 256 taxels


def test_taxels_beyond_edge_are_left_out():
    x, _ = FLAT.grid()
    touched = x > -1.6e-3
    surface = np.where(x < -1e-3, -1.2e-3, -0.2 * x)
    result = touched_surface(surface, touched)
    assert result.points[:, 0].min() > x[touched].min()
    assert (result.points[:, 0] > 2e-3).sum() == (x > 2e-3).sum()


def test_stacked_contacts_keep_order_and_separate_touches():
    first = contacts(np.zeros((2, 3)), np.ones((2, 3)))
    second = first._replace(points=np.ones((2, 3)))
    both = contours.stack_points([first, second])
    assert both.points[:, 0].tolist() == [0.0, 0.0, 1.0, 1.0]
    assert both.touch.tolist() == [0, 0, 1, 1]
    assert np.unique(contours.stack_points([both, first, both]).touch).tolist() == [0, 1, 2, 3, 4]
    assert contours.stack_points([first, first._replace(normals=None)]).normals is None
    none = contours.stack_points([])
    assert none.points.shape == np.asarray(none.normals).shape == (0, 3)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"points": np.zeros((3, 2))}, "patches.points must have shape"),
        ({"points": np.full((3, 3), np.nan)}, "patches.points must be finite"),
        ({"touch": np.zeros(2)}, "patches.touch must have shape"),
        ({"touch": np.array([0.0, 1.0, 1.5])}, "patches.touch must be whole numbers from 0 on"),
        ({"touch": np.array([0, -1, 1])}, "patches.touch must be whole numbers from 0 on, got -1"),
        ({"normals": np.zeros((3, 3))}, "patches.normals must have a length, got 3 of 0"),
    ],
)
def test_invalid_contact_points_are_rejected(wrong, words):
    valid = contacts(np.zeros((3, 3)), np.ones((3, 3)), np.arange(3))
    with pytest.raises(ValueError, match=words):
        contours.checked_contacts(valid._replace(**wrong))
    checked = contours.checked_contacts(valid._replace(touch=np.array([7, 7, 3])))
    assert checked.touch.tolist() == [1, 1, 0]
    assert np.linalg.norm(np.asarray(checked.normals), axis=1) == pytest.approx(np.ones(3))


def cone(height: float) -> tuple[Floats, Floats]:
    """A contour of a cone that narrows upwards at 45 degrees, and its normals, not of length 1."""
    return at_height((0.1 - height) * circle(12), height), at_height(circle(12), 1.0)


def test_point_with_normal_gives_three_points_on_surface():
    rings, normals = zip(*(cone(z) for z in (0.0, 0.02, 0.04)), strict=True)
    result = contours.normals_as_points(rings, normals)
    assert len(result.points) == 3 * 36
    assert np.allclose(np.hypot(*result.points[:, :2].T), 0.1 - result.points[:, 2], atol=1e-15)
    assert np.allclose(np.linalg.norm(np.asarray(result.normals), axis=1), 1.0)
    assert np.bincount(result.touch).tolist() == [3] * 36
    # Their distance is a fraction of the spacing of the contours.
    apart = np.linalg.norm(result.points[2] - result.points[0])
    assert 5e-4 < apart < 5e-3
    assert np.allclose(0.5 * (result.points[2] + result.points[0]), result.points[1], atol=1e-15)
    # Useless points and normals are left out.
    points, normals = cone(0.01)
    plane = contours.normals_as_points([points[:, :2]], [normals], [0.01])
    assert np.allclose(plane.points[1::3], points)
    normals[0] = 0.0
    normals[1] = [0.0, 0.0, 1.0]
    points[2, 0] = np.nan
    assert len(contours.normals_as_points([points], [normals]).points) == 3 * 9
