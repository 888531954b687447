from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import pose_of
from palpate.core.rebuild.contours.contacts import (
    STEP,
    ContactPoints,
    checked_contacts,
    contact_points_of,
    edge_slopes,
    normals_as_points,
    stack_points,
    taxel_pitch,
)
from palpate.core.touch.jet import fit_jet
from palpate.core.touch.pad import guarded_move


def test_touched_taxels_lie_on_the_ball_with_its_normals(flat, domed, ball, rotations):
    for pad in (flat, domed):
        for axes in rotations(5):
            end = guarded_move(ball, pad, pose_of(-0.05 * axes[:, 2], axes), 0.05, 1e-3)
            touched = end.compression > 0
            surface = -(end.compression + pad.sag())
            fitted = fit_jet(pad, surface, touched)
            assert fitted is not None
            contacts = contact_points_of(pad, end.pose, surface, touched, fitted.jet)
            assert contacts.points.shape == np.asarray(contacts.normals).shape == (touched.sum(), 3)
            assert np.allclose(np.linalg.norm(contacts.points, axis=1), 0.03, rtol=1e-12)
            assert np.allclose(np.asarray(contacts.normals), contacts.points / 0.03, atol=5e-3)
            assert np.allclose(
                np.linalg.norm(np.asarray(contacts.normals), axis=1), 1.0, atol=1e-14
            )


def test_without_a_jet_the_normal_is_the_pads(flat, rotations):
    axes = rotations(1)[0]
    touched = np.zeros((16, 16), bool)
    touched[3, 4] = True
    contacts = contact_points_of(flat, pose_of(np.ones(3), axes), np.zeros((16, 16)), touched, None)
    assert np.allclose(np.asarray(contacts.normals), -axes[:, 2])
    x, y = flat.grid()
    assert np.allclose(contacts.points[0], 1.0 + axes @ [x[3, 4], y[3, 4], 0.0])


def test_stacking_keeps_the_order_and_nothing_is_no_points(flat):
    touched = np.ones((16, 16), bool)
    pose = pose_of(np.zeros(3), np.eye(3))
    parts = [contact_points_of(flat, pose, np.full((16, 16), z), touched, None) for z in (0.1, 0.2)]
    both = stack_points(parts)
    assert np.array_equal(both.points[:, 2], np.repeat([0.1, 0.2], 256))
    assert len(np.asarray(both.normals)) == 512
    none = stack_points([])
    assert none.points.shape == np.asarray(none.normals).shape == (0, 3)


def test_no_two_parts_of_a_stack_share_a_touch(flat):
    touched = np.ones((16, 16), bool)
    pose = pose_of(np.zeros(3), np.eye(3))
    one = contact_points_of(flat, pose, np.zeros((16, 16)), touched, None)
    pair = stack_points([one, one])
    assert np.unique(stack_points([pair, one, pair]).touch).tolist() == [0, 1, 2, 3, 4]


def test_a_stack_has_normals_only_if_every_part_has(flat):
    touched = np.ones((16, 16), bool)
    pose = pose_of(np.zeros(3), np.eye(3))
    one = contact_points_of(flat, pose, np.zeros((16, 16)), touched, None)
    assert stack_points([one, one._replace(normals=None)]).normals is None


def test_touches_are_numbered_anew_and_normals_get_length_1():
    contacts = ContactPoints(np.zeros((3, 3)), np.full((3, 3), 2.0), np.array([7, 7, 3], np.int32))
    found = checked_contacts(contacts)
    assert found.touch.tolist() == [1, 1, 0]
    assert found.normals is not None
    assert np.allclose(np.linalg.norm(found.normals, axis=1), 1.0)
    assert checked_contacts(contacts._replace(normals=None)).normals is None


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
def test_contact_points_that_cannot_be_used_are_refused(wrong, words):
    contacts = ContactPoints(np.zeros((3, 3)), np.ones((3, 3)), np.arange(3, dtype=np.int32))
    with pytest.raises(ValueError, match=words):
        checked_contacts(contacts._replace(**wrong))


PITCH = 1e-3
ALL = np.ones((16, 16), np.bool_)


def grid() -> tuple[Floats, Floats]:
    steps = PITCH * (np.arange(16) - 7.5)
    return np.meshgrid(steps, steps)


def roof(x: Floats) -> Floats:
    """Two planes that meet in an edge between two columns."""
    return np.minimum(0.2 * x, -0.5 * x)


@pytest.mark.parametrize("noise", [0.0, 5e-6])
def test_next_to_an_edge_each_taxel_leans_as_its_own_side(noise):
    x, _ = grid()
    surface = roof(x) + np.random.default_rng(0).normal(0.0, noise, x.shape)
    smooth = -0.15 * x - 0.04 * x**2 / 1e-2
    found = edge_slopes(surface, smooth, ALL, PITCH)
    near = found.edge & (np.abs(x) < 3e-3)
    assert near.sum() > 30
    assert found.slopes[0][near] == pytest.approx(
        np.where(x < 0, 0.2, -0.5)[near], abs=5 * noise / PITCH + 1e-9
    )
    assert found.slopes[1][near] == pytest.approx(
        np.zeros(near.sum()), abs=5 * noise / PITCH + 1e-9
    )


def test_a_smooth_surface_is_believed():
    x, y = grid()
    smooth = (x**2 - 0.5 * x * y) / 0.03
    rng = np.random.default_rng(1)
    for noise in (0.0, 1e-5, 1e-4):
        found = edge_slopes(smooth + rng.normal(0.0, noise, x.shape), smooth, ALL, PITCH)
        assert not found.edge.any()
        assert found.unknown.mean() < 0.01


def test_a_single_row_beyond_an_edge_leans_nobody_knows_how():
    x, _ = grid()
    touched = x > -1.6e-3
    surface = np.where(x < -1e-3, -1.2e-3, -0.2 * x)
    found = edge_slopes(surface, -0.2 * x - 2e-4, touched, PITCH)
    assert found.unknown[x == x[touched].min()].all()
    assert not found.unknown[x > 2e-3].any()


@pytest.mark.parametrize("noise", [2e-5, 1e-4])
def test_of_a_thin_contact_noise_takes_nothing(noise):
    x, _ = grid()
    touched = np.abs(x) < 1e-3
    surface = np.random.default_rng(2).normal(0.0, noise, x.shape)
    found = edge_slopes(surface, np.zeros(x.shape), touched, PITCH)
    assert touched.sum() == 32
    assert not found.unknown.any()


def test_an_array_without_a_square_tells_nothing():
    found = edge_slopes(np.zeros((1, 12)), np.ones((1, 12)), np.ones((1, 12), np.bool_), PITCH)
    assert not (found.edge.any() or found.unknown.any())


def test_contact_points_have_the_normals_of_both_sides_of_an_edge(flat):
    x, _ = flat.grid()
    surface = roof(x)
    fitted = fit_jet(flat, surface, ALL)
    assert fitted is not None
    contacts = contact_points_of(flat, pose_of(np.zeros(3), np.eye(3)), surface, ALL, fitted.jet)
    expected = np.where(contacts.points[:, 0] < 0, 0.2, -0.5)
    normals = np.asarray(contacts.normals)
    off = np.abs(-normals[:, 0] / normals[:, 2] - expected)
    assert len(off) > 240
    assert (off < 1e-9).mean() > 0.5
    assert off.max() < 0.1  # the jet alone is off by .35 in the middle


TURN = 2 * np.pi * np.arange(12) / 12
OUT = np.column_stack([np.cos(TURN), np.sin(TURN)])


def cone(height: float) -> tuple[Floats, Floats]:
    """A contour of a cone that narrows upwards at 45 degrees, and its normals, not of length 1."""
    points = np.column_stack([(0.1 - height) * OUT, np.full(12, height)])
    return points, np.column_stack([OUT, np.ones(12)])


def test_a_point_with_a_normal_is_three_on_the_surface():
    contours, normals = zip(*(cone(z) for z in (0.0, 0.02, 0.04)), strict=True)
    contacts = normals_as_points(contours, normals)
    assert contacts.normals is not None
    assert len(contacts.points) == 3 * 36
    assert np.allclose(np.hypot(*contacts.points[:, :2].T), 0.1 - contacts.points[:, 2], atol=1e-15)
    apart = np.linalg.norm(contacts.points[2] - contacts.points[0])
    assert apart == pytest.approx(2 * STEP * 0.02)
    assert np.allclose(np.linalg.norm(contacts.normals, axis=1), 1.0)
    assert np.bincount(contacts.touch).tolist() == [3] * 36


def test_points_without_a_use_are_left_out():
    points, normals = cone(0.01)
    normals[0] = 0.0
    normals[1] = [0.0, 0.0, 1.0]
    points[2, 0] = np.nan
    assert len(normals_as_points([points], [normals]).points) == 3 * 9


def test_plane_contours_get_their_heights():
    points, normals = cone(0.01)
    contacts = normals_as_points([points[:, :2]], [normals], [0.01])
    assert np.allclose(contacts.points[1::3], points)


def test_normals_that_do_not_fit_their_contours_are_refused():
    points, normals = cone(0.01)
    with pytest.raises(ValueError, match="normals must be as many as the 2 contours, got 1"):
        normals_as_points([points, points], [normals])
    with pytest.raises(ValueError, match=r"normals of contour 0 must have shape \(12, 3\), got"):
        normals_as_points([points], [normals[:5]])


def test_the_pitch_is_that_of_the_touch_with_most_taxels():
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0), [0.0]), axis=-1).reshape(-1, 3)
    points = np.vstack([0.1e-3 * grid[:9], 0.8e-3 * grid])
    touch = np.repeat([0, 1], [9, len(grid)]).astype(np.int32)
    assert taxel_pitch(ContactPoints(points, None, touch)) == pytest.approx(0.8e-3)
    assert taxel_pitch(ContactPoints(points[:1], None, touch[:1])) == 0.0
