from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.star_shapes import angle_between
from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.touch.curvature import Patch, fit_patch
from palpate.core.touch.filters import remove_impulses
from palpate.core.touch.pad import Pad, guarded_move

ALONG_X, ALONG_Y = np.eye(3)[:2]
ALL = np.ones((16, 16), bool)


def feel(pad: Pad, height: Floats, direction: Floats = ALONG_Y, noise: float = 0.0) -> Patch:
    return fit_patch(pad, height, np.ones(height.shape, bool), direction, noise)


def touch_ball(pad: Pad, radius: float) -> Patch:
    ball = Superquadric(np.full(3, radius), np.ones(2))
    start = pose_of(np.array([0.0, 0.0, radius + 0.01]), FACING_DOWN)
    end = guarded_move(ball, pad, start, 0.05, 1e-3)
    touched = end.compression > 0
    return fit_patch(pad, -(end.compression + pad.sag()), touched, ALONG_Y, 0.0)


def test_trust_falls_with_the_misfit_and_with_the_share_of_touched_taxels(flat) -> None:
    x, y = flat.grid()
    height = 0.5 * (x**2 + y**2) / 0.02
    clean = feel(flat, height)
    rough = feel(flat, height + 2e-5 * np.random.default_rng(0).normal(size=x.shape))
    half = fit_patch(flat, height, x > 0, ALONG_Y, 0.0)
    assert clean.confidence == pytest.approx(1.0)
    assert half.confidence == pytest.approx(0.5)
    assert rough.confidence < 0.9 * clean.confidence


def test_gaussian_and_mean_curvature_and_direction_belong_to_the_principal_ones(flat) -> None:
    x, y = flat.grid()
    for turn in (0.0, 0.4, 1.9):
        a = x * math.cos(turn) + y * math.sin(turn)
        b = y * math.cos(turn) - x * math.sin(turn)
        patch = feel(flat, 0.5 * (40 * a**2 - 10 * b**2), noise=1e-6)
        k1, k2 = patch.principal
        assert patch.gaussian == pytest.approx(k1 * k2)
        assert patch.mean == pytest.approx(0.5 * (k1 + k2))
        assert not patch.umbilic
        along = patch.principal_direction @ np.array([math.cos(turn), math.sin(turn), 0.0])
        assert abs(along) == pytest.approx(1.0, abs=1e-9)
        again = feel(flat, 0.5 * (40 * a**2 - 10 * b**2), patch.principal_direction)
        assert again.across == pytest.approx(k1, rel=1e-9)


def test_a_direction_is_claimed_only_where_noise_cannot_have_made_it(flat) -> None:
    x, y = flat.grid()
    rng = np.random.default_rng(0)
    claimed = {0.0: 0, 20.0: 0}
    for apart in claimed:
        for _ in range(100):
            height = 0.5 * ((30 + apart) * x**2 + 30 * y**2) + 1e-5 * rng.normal(size=x.shape)
            claimed[apart] += not feel(flat, height, noise=1e-5).umbilic
    assert claimed[0.0] <= 5
    assert claimed[20.0] == 100


@pytest.mark.parametrize("noise", [2e-6, 20e-6])
@pytest.mark.parametrize("told", [True, False])
def test_errors_are_as_large_as_they_are_said_to_be(noise, told, flat) -> None:
    x, y = flat.grid()
    rng = np.random.default_rng(1)
    height = 0.1 * x - 0.2 * y + 0.5 * (40 * x**2 + 10 * x * y - 5 * y**2)
    clean = feel(flat, height)
    found = []
    for _ in range(200):
        patch = feel(flat, height + noise * rng.normal(size=x.shape), noise=noise if told else 0.0)
        found.append(
            [
                angle_between(patch.normal, clean.normal) / patch.normal_error,
                (patch.principal[0] - clean.principal[0]) / patch.principal_error[0],
                (patch.principal[1] - clean.principal[1]) / patch.principal_error[1],
                (patch.across - clean.across) / patch.across_error,
            ]
        )
    spread = np.sqrt(np.mean(np.square(found), axis=0))
    # Shrinking makes them a little smaller or larger than promised.
    assert (spread > 0.6).all()
    assert (spread < 1.5).all()


def test_noise_that_was_not_told_is_seen(flat) -> None:
    x, y = flat.grid()
    height = 0.5 * (x**2 + y**2) / 0.02 + 8e-6 * np.random.default_rng(2).normal(size=x.shape)
    told, untold, less = (feel(flat, height, noise=noise) for noise in (8e-6, 0.0, 4e-6))
    assert told.across_error == pytest.approx(untold.across_error, rel=0.15)
    assert less.across_error == pytest.approx(untold.across_error, rel=1e-9)
    more = feel(flat, height, noise=40e-6)
    assert more.across_error > 2.0 * told.across_error


def test_the_place_lies_on_the_surface_over_the_middle_of_the_contact(flat) -> None:
    x, y = flat.grid()
    touched = (x > 0) & (y < 2e-3)
    patch = fit_patch(flat, 0.1 * x + 20 * y**2, touched, ALONG_Y, 0.0)
    middle = x[touched].mean(), y[touched].mean()
    assert np.allclose(patch.place[:2], middle)
    assert patch.place[2] == pytest.approx(0.1 * middle[0] + 20 * middle[1] ** 2)


def test_weights_of_nothing_leave_taxels_out(flat) -> None:
    x, y = flat.grid()
    height = 0.5 * (x**2 + y**2) / 0.02
    spoiled = np.where((x > 5e-3) & (y > 5e-3), 1e-3, height)
    weights = (spoiled == height).astype(float)
    patch = fit_patch(flat, spoiled, ALL, ALONG_Y, 1e-6, weights)
    assert patch.kind == "smooth"
    # A paraboloid: off its pole it bends a little less.
    assert patch.principal == pytest.approx((50.0, 50.0), rel=1e-3)
    assert patch.residual < 1e-15


def test_eight_percent_of_impulses_cost_little_curvature(flat) -> None:
    x, y = flat.grid()
    height = 0.5 * (x**2 + y**2) / 0.05
    rng = np.random.default_rng(3)
    errors, lost = [], 0
    for _ in range(60):
        frame = 2e-3 - height + 50e-6 * rng.normal(size=x.shape)
        hit, up = rng.random((2, *x.shape))
        frame = np.where(hit < 0.08, np.where(up < 0.5, 0.3e-3, 2.6e-3), frame)
        clean = remove_impulses(flat, frame, 250e-6, 50e-6)
        patch = fit_patch(flat, -frame, ~clean.impulses, ALONG_Y, 50e-6)
        if patch.kind != "smooth":
            lost += 1
            continue
        errors.append(np.array(patch.principal) - 20.0)
    assert lost <= 3  # three impulses of one value in a row pass for a ridge
    # 2e-3 in 1 / pitches, where 88 to 1017 come of splines.
    assert np.sqrt(np.mean(np.square(errors))) < 2.0


def test_one_impulse_that_no_filter_saw_does_not_make_an_edge(flat) -> None:
    x, y = flat.grid()
    height = 0.5 * (x**2 + y**2) / 0.03 + 5e-6 * np.random.default_rng(4).normal(size=x.shape)
    for place in ((8, 8), (0, 15), (3, 12)):
        spoiled = height.copy()
        spoiled[place] += 1e-3
        patch = feel(flat, spoiled, noise=5e-6)
        assert patch.kind == "smooth"
        assert patch.principal == pytest.approx((1 / 0.03, 1 / 0.03), rel=0.05)


@pytest.mark.parametrize("count", [32, 52, 112])
def test_masked_contact_is_within_5_percent_under_noise_from_32_taxels_on(count, flat) -> None:
    x, y = flat.grid()
    height = 0.02 - np.sqrt(0.02**2 - x**2 - y**2)
    touched = np.zeros(256, bool)
    touched[np.argsort((x**2 + y**2).ravel(), kind="stable")[:count]] = True
    mask = touched.reshape(16, 16)
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(60):
        patch = fit_patch(flat, height + 1e-5 * rng.normal(size=x.shape), mask, ALONG_Y, 1e-5)
        assert patch.kind == "smooth"
        errors.append(np.array(patch.principal) * 0.02 - 1.0)
    assert np.sqrt(np.mean(np.square(errors))) < 0.05


def test_a_wall_that_stands_along_the_pads_normal_is_felt_without_overflow(flat) -> None:
    x, _ = flat.grid()
    for steep in (1e3, 1e6, 1e150):
        patch = feel(flat, steep * x)
        assert np.isfinite([*patch.normal, *patch.principal, patch.across]).all()
        assert np.linalg.norm(patch.normal) == pytest.approx(1.0)
        assert math.isfinite(patch.normal_error)
