import math

import numpy as np
import pytest

from palpate.core.splines.bases import clamped_basis
from palpate.core.splines.composite_lattices import NOWHERE, CompositeLattice, shared_faces
from palpate.core.splines.lattices import Lattice, box_lattice
from palpate.core.splines.spline_volumes import Parallelepiped, SplineVolume

LOWER = box_lattice(np.zeros(3), np.ones(3), (4, 4, 5))
UPPER = box_lattice(np.array([0, 0, 1.0]), np.array([1, 1, 2.0]), (4, 4, 6))
RNG = np.random.default_rng(0)


def wave(points):
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([x + 0.1 * np.sin(2 * z), y + 0.05 * x * z, z + 0.1 * x * y], axis=-1)


def bent(lattice):
    return lattice.with_control(wave(lattice.control))


def ring(start, turns):
    """A part of a ring of square section about the z axis, undeformed."""
    bases = clamped_basis(3, 2), clamped_basis(2, 1), clamped_basis(2, 1)
    half = math.pi * turns
    angles = start + np.array([0.0, half, 2 * half])
    reach = np.array([1.0, 1.0 / math.cos(half), 1.0])
    arc = np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=-1)
    control = np.zeros((3, 2, 2, 3))
    control[:, 0, :, :2], control[:, 1, :, :2] = arc[:, None], 2.0 * arc[:, None]
    control[:, :, 1, 2] = 1.0
    weights = np.ones((3, 2, 2))
    weights[1] = math.cos(half)
    volume = SplineVolume(control, bases, weights)
    return Lattice(volume, volume)


def test_a_body_over_two_lattices_is_deformed_by_the_one_that_holds_each_point():
    body = CompositeLattice((bent(LOWER), bent(UPPER)))
    points = RNG.random((200, 3)) * [1, 1, 3]
    moved = body.deform(points)
    assert moved.held.all()
    low = points[:, 2] < 1.0
    assert np.array_equal(moved.points[low], bent(LOWER).deform(points[low]))
    assert np.array_equal(moved.points[~low], bent(UPPER).deform(points[~low]))


def test_the_deformation_is_continuous_across_a_shared_face():
    body = CompositeLattice((bent(LOWER), bent(UPPER)))
    assert [(one.first, one.second) for one in body.joints] == [(0, 1)]
    below = np.column_stack([RNG.random((50, 2)), np.full(50, 1.0 - 1e-9)])
    above = below + [0.0, 0.0, 2e-9]
    assert body.embed(below).lattice.tolist() == [0] * 50
    assert body.embed(above).lattice.tolist() == [1] * 50
    assert np.abs(body.deform(below).points - body.deform(above).points).max() < 1e-8


def test_points_in_no_lattice_stay_and_are_reported():
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 3.1], [-7.0, 0.0, 0.0], [0.5, 0.5, 2.9]])
    body = CompositeLattice((bent(LOWER), bent(UPPER)))
    moved = body.deform(points)
    assert moved.held.tolist() == [True, False, False, True]
    assert np.array_equal(moved.points[1:3], points[1:3])
    assert body.embed(points).lattice.tolist() == [0, NOWHERE, NOWHERE, 1]


def test_curved_volumes_hold_the_points_of_their_curve():
    quarter = ring(0.0, 0.25)
    lifted = quarter.volume.control.copy()
    lifted[..., 2] += lifted[..., 0]
    body = CompositeLattice(
        (
            Lattice(
                SplineVolume(lifted, quarter.volume.bases, quarter.volume.weights), quarter.volume
            ),
        )
    )
    angles, radii = RNG.uniform(0.0, math.pi / 2, 60), RNG.uniform(1.0, 2.0, 60)
    points = np.column_stack([radii * np.cos(angles), radii * np.sin(angles), RNG.random(60)])
    moved = body.deform(points)
    assert moved.held.all()
    assert np.allclose(moved.points, points + points[:, :1] * [0, 0, 1], rtol=0, atol=1e-8)
    inside_the_box_only = np.array([[0.5, 0.5, 0.5], [1.9, 1.9, 0.5]])
    assert not body.deform(inside_the_box_only).held.any()


def test_four_quarters_make_a_ring_with_four_joints():
    body = CompositeLattice(tuple(ring(k * math.pi / 2, 0.25) for k in range(4)))
    pairs = {(one.first, one.second) for one in body.joints}
    assert pairs == {(0, 1), (1, 2), (2, 3), (0, 3)}
    angles = RNG.uniform(-math.pi, math.pi, 40)
    points = np.column_stack([1.5 * np.cos(angles), 1.5 * np.sin(angles), RNG.random(40)])
    assert np.allclose(body.deform(points).points, points, rtol=0, atol=1e-8)


def test_shared_faces_are_found_whichever_way_they_run():
    control, bases = UPPER.control, UPPER.volume.bases
    turned = SplineVolume(control.transpose(1, 0, 2, 3)[::-1], (bases[1], bases[0], bases[2]))
    joints = shared_faces([LOWER, Lattice(turned, turned)])
    assert [(one.first, one.second, one.gap) for one in joints] == [(0, 1, 0.0)]


def test_volumes_that_do_not_touch_share_nothing():
    far = box_lattice(np.array([0, 0, 5.0]), np.ones(3), (4, 4, 5))
    assert CompositeLattice((LOWER, far)).joints == ()
    assert CompositeLattice(()).joints == ()
    assert not CompositeLattice(()).deform(np.zeros((2, 3))).held.any()


def test_a_deformation_that_tears_a_shared_face_is_refused():
    with pytest.raises(ValueError, match=r"lattices 0 and 1 share a face .* a gap of 0.1\d* m"):
        CompositeLattice((bent(LOWER), UPPER))


def test_other_knots_or_weights_on_a_shared_face_are_refused():
    heavy = np.ones((4, 4, 6))
    heavy[1, 1, 0] = 2.0
    with pytest.raises(ValueError, match="lattices 0 and 1 share a face, where their weights"):
        CompositeLattice((LOWER, UPPER.with_control(UPPER.control, heavy)))
    cubic, quadratic = clamped_basis(5), clamped_basis(5, 2)
    below, above = (
        Parallelepiped(np.array([0, 0, z]), np.eye(3)).even_control((5, 5, 5)) for z in (0, 1.0)
    )
    lower, upper = SplineVolume(below, (cubic,) * 3), SplineVolume(above, (quadratic, cubic, cubic))
    with pytest.raises(ValueError, match="share a face, where their knots must be the same"):
        CompositeLattice((Lattice(lower, lower), Lattice(upper, upper)))


def test_points_that_are_none_are_refused():
    with pytest.raises(ValueError, match="points must be finite"):
        CompositeLattice((LOWER,)).deform(np.full((1, 3), np.nan))
