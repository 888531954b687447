from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.poses import IDENTITY_POSE, pose_of, transform_points
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric, largest_curvature
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.protocol import PosedShape, PosedSolid
from palpate.core.shapes.superquadrics import Superquadric

Draw = Callable[[int], Floats]


def test_rays_move_with_the_shape(box, rotations):
    rng = np.random.default_rng(4)
    for axes in rotations(20):
        pose = pose_of(rng.normal(size=3), axes)
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        origins = rng.uniform(-0.05, 0.05, (50, 3)) - 0.1 * direction
        found = PosedShape(box, pose).cast(transform_points(pose, origins), axes @ direction, 0.3)
        wanted = box.cast(origins, direction, 0.3)
        met = np.isfinite(wanted)
        assert np.array_equal(found[~met], wanted[~met])
        # A grazing ray feels the rounding of its origin most.
        assert np.allclose(found[met], wanted[met], rtol=0, atol=1e-10)


@settings(max_examples=60, deadline=None)
@given(
    exponents=st.tuples(st.floats(0.02, 2.0), st.floats(0.02, 2.0)),
    share=st.floats(-0.9, 0.9),
    seed=st.integers(0, 1 << 30),
)
def test_casts_at_a_posed_solid_are_posed_casts(
    exponents: tuple[float, float], share: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    base = Superquadric(np.array([0.03, 0.02, 0.04]), np.array(exponents))
    taper = rng.uniform(-0.8, 0.8, 2)
    bend = Bend(share * largest_curvature(base, taper, 0.3), 0.3)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes[:, 0] *= np.linalg.det(axes)
    pose = pose_of(rng.normal(size=3), axes)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    origins = rng.uniform(-0.04, 0.04, (30, 3)) - 0.1 * direction
    for shape in (base, DeformedSuperquadric(base, taper, bend)):
        wanted = shape.cast(origins, direction, 0.3)
        found = PosedShape(shape, pose).cast(transform_points(pose, origins), axes @ direction, 0.3)
        met = np.isfinite(wanted) & np.isfinite(found)
        # Where rounding of the pose decides, the ray only grazes: it is on the surface.
        astray = np.isfinite(wanted) != np.isfinite(found)
        assert astray.sum() <= 1
        at = origins[met] + found[met, None] * direction
        assert np.allclose(shape.gauge(at), 1.0, rtol=0, atol=1e-12)


def test_the_mesh_moves_with_the_shape(box, rotations):
    pose = pose_of(np.array([0.1, 0.2, 0.3]), rotations(1)[0])
    vertices, faces = PosedShape(box, pose).mesh(2)
    assert np.allclose(vertices, transform_points(pose, box.mesh(2).vertices), atol=1e-15)
    assert np.array_equal(faces, box.mesh(2).faces)


def test_the_bounds_of_an_upright_shape_are_exact(box):
    shift = np.array([0.1, -0.2, 0.3])
    posed = PosedShape(box, np.concatenate([shift, IDENTITY_POSE[3:]]))
    assert np.array_equal(posed.bounds(), box.bounds() + shift)


def test_the_bounds_of_a_turned_shape_are_those_of_what_it_looks_like(ball, rotations):
    shift = np.array([0.1, -0.2, 0.3])
    posed = PosedShape(ball, pose_of(shift, rotations(1)[0]))
    # The tessellation's corners lie some 0.5 % of the radius apart.
    assert np.allclose(posed.bounds(), [shift - 0.03, shift + 0.03], rtol=0, atol=1e-5)
    assert (np.abs(posed.bounds() - shift) <= 0.03).all()


DOWN = np.array([0.0, 0.0, -1.0])


def test_a_posed_solid_is_where_it_stands():
    turn = np.array([0.0, np.sin(0.4), 0.0, np.cos(0.4)])
    egg = Superquadric(np.array([0.02, 0.03, 0.05]), np.array([0.7, 1.2]))
    posed = PosedSolid(egg, np.concatenate([[0.1, 0.2, 0.3], turn]))
    vertices, _ = posed.mesh(3)
    low, high = posed.enclosure()
    assert ((vertices >= low) & (vertices <= high)).all()
    value, slope = posed.inside_out(vertices, vertices - [0.1, 0.2, 0.3])
    assert np.abs(value).max() < 1e-12
    assert np.allclose(slope, 1.0)  # the gauge grows evenly from the middle
    spans = posed.spans(np.array([[0.1, 0.2, 1.0]]), DOWN)[0, 0]
    assert np.allclose(posed.inside_out(np.array([[0.1, 0.2, 1.0 - s] for s in spans]),
                                        np.zeros((2, 3)))[0], 0.0, atol=1e-12)  # fmt: skip
