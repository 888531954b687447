from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import DOWN, pose_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.curvature import Patch, feel_patch
from palpate.core.touch.pad import Pad, press

ALONG_X, ALONG_Y = np.eye(3)[:2]
ALL = np.ones((16, 16), bool)


def feel(pad: Pad, height: Floats, direction: Floats = ALONG_Y, noise: float = 0.0) -> Patch:
    return feel_patch(pad, height, np.ones(height.shape, bool), direction, noise)


def touch_ball(pad: Pad, radius: float) -> Patch:
    ball = Superquadric(np.full(3, radius), np.ones(2))
    start = pose_of(np.array([0.0, 0.0, radius + 0.01]), DOWN)
    end = press(ball, pad, start, 0.05, 1e-3)
    touched = end.compression > 0
    return feel_patch(pad, -(end.compression + pad.sag()), touched, ALONG_Y, 0.0)


@pytest.mark.parametrize(
    ("radius", "error"), [(0.01, 0.03), (0.02, 0.01), (0.03, 0.005), (0.1, 1e-4), (1.0, 1e-6)]
)
def test_a_ball_has_its_curvature_in_all_directions(
    radius: float, error: float, flat: Pad, domed: Pad
) -> None:
    for pad in (flat, domed):
        patch = touch_ball(pad, radius)
        assert patch.kind == "smooth"
        # A quartic leaves out the sixth power, which goes with (width / radius)^4.
        assert patch.principal == pytest.approx((1 / radius, 1 / radius), rel=error)
        assert patch.across == pytest.approx(1 / radius, rel=error)
        assert np.allclose(patch.normal, [0, 0, -1], atol=1e-9)


@pytest.mark.parametrize("degrees", [0, 20, 45, 90, 130])
def test_a_cylinder_has_one_curvature_whichever_way_it_lies(degrees: int, flat: Pad) -> None:
    turn = math.radians(degrees)
    x, y = flat.grid()
    off = -x * math.sin(turn) + y * math.cos(turn)
    height = 0.02 - np.sqrt(0.02**2 - off**2)
    k1, k2 = feel(flat, height).principal
    assert k1 == pytest.approx(50.0, rel=0.01)
    assert k2 == pytest.approx(0.0, abs=0.05)  # a thousandth of the other
    along = np.array([math.cos(turn), math.sin(turn), 0.0])
    around = np.array([-math.sin(turn), math.cos(turn), 0.0])
    assert feel(flat, height, along).across == pytest.approx(0.0, abs=0.05)
    assert feel(flat, height, around).across == pytest.approx(50.0, rel=0.01)
    # Euler: the curvature between the two goes with the square of the sine.
    between = math.cos(0.5) * along + math.sin(0.5) * around
    assert feel(flat, height, between).across == pytest.approx(50 * math.sin(0.5) ** 2, rel=0.01)


def test_a_saddle_keeps_both_signs_and_a_hollow_is_negative(flat: Pad) -> None:
    x, y = flat.grid()
    saddle = feel(flat, 0.5 * (30 * x**2 - 20 * y**2))
    assert saddle.principal == pytest.approx((30.0, -20.0), rel=1e-9)
    assert saddle.across == pytest.approx(-20.0, rel=1e-9)
    assert feel(flat, 15 * (x**2 - y**2)).principal == pytest.approx((30.0, -30.0), rel=1e-9)
    assert feel(flat, -5 * (x**2 + y**2)).principal == pytest.approx((-10.0, -10.0), rel=1e-9)


def test_principal_curvatures_do_not_depend_on_how_the_pad_is_turned(flat: Pad) -> None:
    x, y = flat.grid()
    for turn in np.linspace(0.0, math.pi, 7):
        a = x * math.cos(turn) - y * math.sin(turn)
        b = x * math.sin(turn) + y * math.cos(turn)
        patch = feel(flat, 0.1 * a + 0.5 * (40 * a**2 + 25 * a * b - 10 * b**2))
        if turn == 0.0:
            wanted = patch.principal
        assert patch.principal == pytest.approx(wanted, rel=1e-9)


def test_an_umbilic_is_exactly_that(flat: Pad) -> None:
    x, y = flat.grid()
    for radius in np.geomspace(0.02, 1e6, 30):
        k1, k2 = feel(flat, 0.5 * (x**2 + y**2) / radius).principal
        assert k1 >= k2
        assert k1 - k2 < 1e-10 / radius + 1e-12
        assert feel(flat, 0.5 * (x**2 + y**2) / radius).umbilic


def test_a_tilted_plane_is_flat_and_its_normal_is_tilted(flat: Pad) -> None:
    x, y = flat.grid()
    patch = feel(flat, 0.3 * x - 0.4 * y)
    assert patch.kind == "smooth"
    assert patch.principal == pytest.approx((0.0, 0.0), abs=1e-9)
    assert np.allclose(patch.normal * math.sqrt(1.25), [0.3, -0.4, -1.0], atol=1e-12)
    assert patch.umbilic


def test_a_tilted_balls_curvature_is_measured_on_the_surface_not_on_the_pad(flat: Pad) -> None:
    x, y = flat.grid()
    height = -np.sqrt(0.05**2 - (x - 0.01) ** 2 - (y + 0.02) ** 2)
    patch = feel(flat, height)
    assert patch.principal == pytest.approx((20.0, 20.0), rel=0.01)
    assert patch.across == pytest.approx(20.0, rel=0.01)


def test_a_direction_out_of_the_pads_plane_counts_by_its_part_in_it(flat: Pad) -> None:
    x, y = flat.grid()
    height = 0.5 * (30 * x**2 + 10 * y**2)
    assert feel(flat, height, np.array([0.6, 0.0, 0.8])).across == pytest.approx(30.0)
    assert feel(flat, height, np.array([0.0, 0.0, 1.0])).across == 0.0


def test_an_edge_a_corner_and_a_step_are_that_and_have_no_curvature(flat: Pad) -> None:
    x, y = flat.grid()
    roof, corner = np.abs(x), np.maximum(np.abs(x), np.abs(y))
    step = np.where(x > 0, 1e-3, 0.0)
    for height, kind in ((roof, "edge"), (corner, "corner"), (step, "edge"), (-roof, "edge")):
        patch = feel(flat, height, noise=10e-6)
        assert patch.kind == kind
        assert patch.jet is not None
        assert patch.principal == patch.principal_error == (0.0, 0.0)
        assert patch.across == patch.across_error == patch.gaussian == patch.mean == 0.0
        assert patch.umbilic
        assert patch.shape is patch.shape_covariance is None
        assert (patch.principal_direction == 0.0).all()
        assert 0.0 <= patch.trust < 0.5
        assert patch.residual > 40e-6
        assert 0.0 < patch.normal_error < math.pi


def test_what_curves_within_two_pitches_is_an_edge(flat: Pad) -> None:
    x, _ = flat.grid()
    patch = feel(flat, 0.5 * 501.0 * x**2)
    assert patch.residual < 1e-12
    assert patch.kind == "edge"
    assert feel(flat, 0.5 * 499.0 * x**2).kind == "smooth"


def test_nothing_touched_is_a_miss(flat: Pad) -> None:
    patch = feel_patch(flat, np.zeros((16, 16)), ~ALL, ALONG_Y, 0.0)
    assert patch == Patch("miss")
    assert patch.jet is None
    assert patch.normal_error == math.pi
    assert patch.normal.tolist() == [0.0, 0.0, -1.0]


@pytest.mark.parametrize("count", [1, 4, 7])
def test_a_few_taxels_are_insufficient(count: int, flat: Pad) -> None:
    touched = np.zeros((16, 16), bool)
    touched.ravel()[118 : 118 + count] = True
    patch = feel_patch(flat, np.zeros((16, 16)), touched, ALONG_Y, 0.0)
    assert patch.kind == "insufficient"
    assert patch.jet is None
    assert patch.trust == 0.0


def test_what_is_enough_for_a_plane_has_a_normal_and_no_curvature(flat: Pad) -> None:
    x, y = flat.grid()
    touched = (np.abs(x) < 1.8e-3) & (np.abs(y) < 1.2e-3)
    assert touched.sum() == 8
    patch = feel_patch(flat, 0.2 * x, touched, ALONG_Y, 0.0)
    assert patch.kind == "insufficient"
    assert patch.jet is not None
    assert patch.principal == (0.0, 0.0)
    assert np.allclose(patch.normal[:2] / -patch.normal[2], [0.2, 0.0], atol=1e-12)


@pytest.mark.parametrize("radius", [3.5, 5.0, 8.0])
def test_partial_contact_is_not_read_as_flat(radius: float, flat: Pad) -> None:
    x, y = flat.grid()
    height = 0.02 - np.sqrt(0.02**2 - x**2 - y**2)
    touched = np.hypot(x, y) < radius * 1e-3
    # 32 taxels or more: within 4 % on a ball of 20 mm.
    patch = feel_patch(flat, np.where(touched, height, 0.0), touched, ALONG_Y, 0.0)
    assert patch.principal == pytest.approx((50.0, 50.0), rel=0.04)


def test_noise_costs_little_curvature_and_is_not_taken_for_an_edge(flat: Pad) -> None:
    x, y = flat.grid()
    height = 0.5 * (x**2 + y**2) / 0.02
    rng = np.random.default_rng(0)
    found = [
        feel(flat, height + rng.normal(scale=1e-5, size=x.shape), noise=1e-5) for _ in range(50)
    ]
    assert {patch.kind for patch in found} == {"smooth"}
    errors = np.array([patch.principal for patch in found]) - 50.0
    assert np.abs(errors).mean() < 0.5  # 0.5e-3 in 1 / pitches
