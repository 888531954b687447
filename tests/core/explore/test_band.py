from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from palpate.core.explore.aim import PRESS
from palpate.core.explore.band import felt_bands
from palpate.core.explore.crossing import crossings, one_surface
from palpate.core.explore.felt import Felt, feel_slice
from palpate.core.explore.path import Path, path_of
from palpate.core.explore.trace import Slice
from palpate.core.frames import pad_rotation, pose_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.pad import Pad

ROUNDING = 1e-15


def level(pad: Pad, surface: Any, touched: Any, height: float = 0.0, tilt: float = 0.0) -> Felt:
    """A pad that looks along -x, its middle at the origin."""
    felt = feel_slice(
        pad, pose_of(np.zeros(3), pad_rotation(0.0, tilt)), surface, touched, None, height
    )
    assert felt is not None
    return felt


def test_a_flat_wall_is_felt_from_the_first_touched_row_to_the_last(flat: Pad) -> None:
    touched = np.zeros((16, 16), bool)
    touched[3:12] = True
    for height in (0.0, -2.2e-3):
        felt = level(flat, np.zeros((16, 16)), touched, height)
        assert len(felt.points) == 16
        assert np.allclose(felt.low, -3.5e-3, rtol=0, atol=1e-15)  # rows run downwards
        assert np.allclose(felt.high, 4.5e-3, rtol=0, atol=1e-15)


def test_a_tilted_pads_band_is_as_high_as_its_rows_stand(flat: Pad) -> None:
    felt = level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.0, 0.5)
    assert np.allclose(felt.high, 7.5e-3 * math.cos(0.5), rtol=0, atol=1e-15)


def test_a_break_ends_the_band_there_and_in_that_column_alone(flat: Pad) -> None:
    touched = np.ones((16, 16), bool)
    touched[10, 4] = False
    _, y = flat.grid()
    surface = np.zeros((16, 16))
    surface[y < -4e-3] = 2.1e-3  # a step that is more than two pitches deep
    felt = level(flat, surface, touched)
    low = np.full(16, -7.5e-3)
    low[4] = -1.5e-3  # the row before the untouched one
    assert np.allclose(felt.low, low, rtol=0, atol=1e-15)
    assert np.allclose(felt.high, 3.5e-3, rtol=0, atol=1e-15)


def test_where_the_slice_runs_along_a_row_the_band_is_on_both_sides_of_it(flat: Pad) -> None:
    felt = level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.5e-3)
    assert np.allclose(felt.low, -7.5e-3, rtol=0, atol=1e-15)
    assert np.allclose(felt.high, 7.5e-3, rtol=0, atol=1e-15)


def test_a_surface_that_turns_back_is_felt_to_its_highest_place(flat: Pad) -> None:
    _, y = flat.grid()
    above = 4e-3 - np.abs(y - 3.5e-3) + 1e-6
    met = crossings(flat, above, np.zeros((16, 16)), np.ones((16, 16), bool))
    whole = one_surface(flat, np.zeros((16, 16)), np.ones((16, 16), bool))
    _, high = felt_bands(above, whole, met)
    assert np.allclose(high, 4.001e-3, rtol=0, atol=1e-15)


def test_what_the_slice_does_not_meet_has_no_band(flat: Pad) -> None:
    felt = level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.02)
    assert felt.low.shape == felt.high.shape == (0,)


def arc(pad: Pad, places: list[float], low: float, high: float) -> Path:
    points = np.array([[0.03, place, 0.0] for place in places])
    flat = np.zeros(len(places))
    return Path(points, 0.0 * points, flat, flat + low, flat + high)


def test_a_touch_over_felt_points_widens_their_bands_and_no_others(flat: Pad) -> None:
    path = arc(flat, [0.0, 1e-3, 2e-3], -3e-3, 1e-3)
    other = arc(flat, [1.3e-3, 2.3e-3, 3.3e-3], -1e-3, 5e-3)
    felt = Felt(*other, 0.0, np.zeros(3), np.zeros(3), 5, 5)
    wider = path.felt_again(felt, 0.75e-3)
    assert wider.high.tolist() == [1e-3, 5e-3, 5e-3]
    assert wider.low.tolist() == [-3e-3] * 3
    assert np.array_equal(wider.points, path.points)


def test_a_touch_without_an_arc_widens_no_band(flat: Pad) -> None:
    path = arc(flat, [0.0], -1e-3, 1e-3)
    empty = path_of(level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.02))
    felt = Felt(*empty, 0.0, np.zeros(3), np.zeros(3), 5, 5)
    assert path.felt_again(felt, 0.75e-3) is path


@pytest.mark.parametrize("share", [0.0, 0.5, -0.8])
def test_a_traced_ball_is_felt_as_far_as_the_contacts_reach(
    share: float, finger: Any, flat: Pad, domed: Pad, ball: Superquadric
) -> None:
    height = 0.03 * share
    for pad in (flat, domed):
        hand = finger(ball, pad)
        trace, status = hand.contour(Slice(height, np.zeros(2), 0.1, 150))
        path = trace.path
        assert status == "closed"
        assert (path.low <= height).all()
        assert (path.high >= height).all()
        heights = np.concatenate([one.points[:, 2] for one in hand.felt])
        assert heights.min() <= path.low.min() + ROUNDING
        assert heights.max() >= path.high.max() - ROUNDING
        # Half the height of a contact; a flat pad's ends at its edge.
        contact = min(7.5e-3, math.sqrt(2 * PRESS / (1 / 0.03 + pad.dome))) * math.sqrt(
            1 - share**2
        )
        band = np.median(path.high - path.low)
        assert 1.2 * contact < band < 2.1 * contact
