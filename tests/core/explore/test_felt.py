from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.felt import LEAN, Felt, feel_slice
from palpate.core.frames import pad_rotation, pose_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.jet_fit import fit_jet
from palpate.core.touch.pad import Pad, press

RADIUS = 0.03
ROW_BIAS = 0.2e-6
"""What a cubic through four rows misses on a ball, m; a straight line cuts off 4.2 um."""


def touch(pad: Pad, shape: Superquadric, heading: float, tilt: float, height: float) -> Felt | None:
    """A pad pressed straight towards the middle of a ball, and the slice at a height."""
    axes = pad_rotation(heading, tilt)
    end = press(shape, pad, pose_of(-0.05 * axes[:, 2], axes), 0.05, 1e-3)
    touched = end.compression > 0
    surface = np.where(touched, -(end.compression + pad.sag()), 0.0)
    fitted = fit_jet(pad, surface, touched)
    return feel_slice(pad, end.pose, surface, touched, fitted.jet if fitted else None, height)


def level_pad(surface: Floats, touched: Bools, pad: Pad, height: float) -> Felt | None:
    """A pad that looks along -x, its middle at the origin."""
    pose = pose_of(np.zeros(3), pad_rotation(0.0, 0.0))
    return feel_slice(pad, pose, surface, touched, None, height)


@pytest.mark.parametrize("heading", [0.0, 2.0, -1.3])
@pytest.mark.parametrize(
    ("tilt", "height"), [(0.0, 0.0), (0.0, 2e-3), (0.6, 0.018), (-0.6, -0.0165)]
)
def test_the_arc_lies_on_the_ball_and_in_the_slice(
    heading: float, tilt: float, height: float, flat: Pad, domed: Pad, ball: Superquadric
) -> None:
    for pad in (flat, domed):
        felt = touch(pad, ball, heading, tilt, height)
        assert felt is not None
        assert len(felt.points) >= 6
        assert np.allclose(felt.points[:, 2], height, rtol=0, atol=1e-17)
        depth = RADIUS - np.linalg.norm(felt.points, axis=1)
        assert np.abs(depth).max() < ROW_BIAS
        assert np.allclose(felt.normals, felt.points / RADIUS, atol=2e-3)
        assert np.allclose(np.linalg.norm(felt.normals, axis=1), 1.0, atol=1e-14)
        assert np.allclose(felt.across, 1 / RADIUS, rtol=0.05)


def test_the_arc_leads_counter_clockwise(flat: Pad, ball: Superquadric) -> None:
    for heading in (0.0, 2.0, -3.0):
        felt = touch(flat, ball, heading, 0.0, 0.0)
        assert felt is not None
        azimuth = np.unwrap(np.arctan2(felt.points[:, 1], felt.points[:, 0]))
        assert (np.diff(azimuth) > 0.0).all()
        assert math.remainder(azimuth.mean() - heading, 2 * math.pi) == pytest.approx(0, abs=1e-9)


def test_a_slice_that_the_pad_does_not_cover_has_no_arc_but_a_slope(
    flat: Pad, ball: Superquadric
) -> None:
    felt = touch(flat, ball, 0.0, 0.0, 0.012)
    assert felt is not None
    assert felt.points.shape == felt.normals.shape == (0, 3)
    assert felt.across.shape == (0,)
    assert felt.above == 0
    assert felt.below > 100
    # The contact of a press of 1 mm is 7.7 mm high on either side: its upper end is nearest.
    assert felt.nearest[2] == pytest.approx(7.5e-3, abs=1e-6)
    assert np.linalg.norm(felt.nearest) == pytest.approx(RADIUS)
    assert felt.slope == pytest.approx(-7e-3 / RADIUS, rel=0.1)


def test_the_slope_says_how_the_surface_leans_against_the_pad(flat: Pad) -> None:
    _, y = flat.grid()
    touched = np.ones((16, 16), bool)
    felt = level_pad(0.25 * y, touched, flat, 0.02)
    assert felt is not None
    assert len(felt.points) == 0
    assert felt.slope == pytest.approx(0.25)


@pytest.mark.parametrize(("row", "sign"), [(0, 1.0), (15, -1.0)])
def test_where_one_row_touches_the_slope_is_a_guess_of_the_right_sign(
    row: int, sign: float, flat: Pad
) -> None:
    touched = np.zeros((16, 16), bool)
    touched[row, 3:9] = True
    felt = level_pad(np.zeros((16, 16)), touched, flat, 0.0)
    assert felt is not None
    assert felt.slope == sign * LEAN
    assert (felt.above, felt.below) == ((6, 0) if row == 0 else (0, 6))


def test_untouched_taxels_bear_no_arc(flat: Pad) -> None:
    touched = np.ones((16, 16), bool)
    touched[:, 5:9] = False
    felt = level_pad(np.zeros((16, 16)), touched, flat, 0.0)
    assert felt is not None
    assert len(felt.points) == 12


def test_a_jump_between_two_rows_is_not_one_surface(flat: Pad) -> None:
    x, y = flat.grid()
    surface = np.where((y > 0) & (x > 0), 2.1e-3, 0.0)
    felt = level_pad(surface, np.ones((16, 16), bool), flat, 0.0)
    assert felt is not None
    assert len(felt.points) == 8


def test_each_column_gives_the_crossing_nearest_to_the_middle(flat: Pad) -> None:
    _, y = flat.grid()
    # Seen from 45 degrees above, a wave in y passes the slice three times.
    pose = pose_of(np.zeros(3), pad_rotation(0.0, math.pi / 4))
    surface = 1.2e-3 * np.sin(2 * math.pi * y / 6e-3) - 0.9 * y
    felt = feel_slice(flat, pose, surface, np.ones((16, 16), bool), None, 0.0)
    assert felt is not None
    assert len(felt.points) == 16
    assert np.allclose(felt.points[:, [0, 2]], 0.0, atol=0.2e-3)


def test_without_a_jet_the_pads_own_normal_stands_in(flat: Pad) -> None:
    felt = level_pad(np.zeros((16, 16)), np.ones((16, 16), bool), flat, 0.0)
    assert felt is not None
    assert np.allclose(felt.normals, [1.0, 0.0, 0.0], atol=1e-15)
    assert (felt.across == 0.0).all()


def test_nothing_touched_is_nothing_felt(flat: Pad) -> None:
    assert level_pad(np.zeros((16, 16)), np.zeros((16, 16), bool), flat, 0.0) is None
