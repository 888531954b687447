from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.explore.tracing.contour_path import Gap
from palpate.core.poses import pose_of
from palpate.core.touch.pad import guarded_move
from tests.studies import tracing as bench_tracing
from tests.studies.objects import TRACED_OBJECTS, carved
from tests.studies.tracing import (
    DOMED,
    FLAT,
    TouchNoise,
    outline_distances,
    trace_figures,
    unreachable_chord,
)


@pytest.mark.parametrize("name", sorted(TRACED_OBJECTS))
def test_every_object_has_the_outline_that_its_rays_meet(name):
    target = TRACED_OBJECTS[name]
    height = 0.4 * target.half
    outline = target.outline(height)
    for number in range(0, len(outline), len(outline) // 7):
        away = outline[number] / np.linalg.norm(outline[number])
        start = np.array([[0.1 * away[0], 0.1 * away[1], height]])
        met = target.shape.cast(start, np.array([-away[0], -away[1], 0.0]), 0.1)
        assert 0.1 - met[0] == pytest.approx(np.linalg.norm(outline[number]), abs=1e-8)


def test_a_ray_of_a_radial_solid_says_where_it_is():
    star = TRACED_OBJECTS["star"].shape
    starts = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.01, 0.3]])
    found = star.cast(starts, np.array([0.0, 0.0, -1.0]), 0.15)
    assert found.tolist() == pytest.approx([0.055, -np.inf, np.inf, np.inf])


def test_a_radial_solid_has_no_mesh():
    with pytest.raises(NotImplementedError, match="no mesh"):
        TRACED_OBJECTS["star"].shape.mesh(3)


def test_points_off_a_polygon_are_measured_to_its_sides():
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    off = outline_distances(np.array([[0.9, 0.0], [1.3, 1.4], [-0.5, 1.25]]), square)
    assert off.tolist() == pytest.approx([0.1, 0.5, 0.25])


def test_a_ball_is_traced_whole_and_exactly():
    for pad, most in ((FLAT, 20), (DOMED, 26)):
        found = trace_figures(TRACED_OBJECTS["sphere"], 0.3, pad)
        assert (found.status, found.gaps, found.covered) == ("closed", (), 1.0)
        assert found.touches <= most
        assert found.worst < 10e-6


def test_noise_moves_the_points_as_far_as_the_pose():
    found = trace_figures(TRACED_OBJECTS["box"], 0.0, FLAT, TouchNoise(), seed=1)
    assert found.status == "closed"
    assert 50e-6 < found.rms < 200e-6
    assert found == trace_figures(TRACED_OBJECTS["box"], 0.0, FLAT, TouchNoise(), seed=1)


def test_a_slot_is_occluded_for_as_long_as_nothing_can_be_touched():
    target = carved("slot", 0.010, 0.0025)
    found = trace_figures(target, 0.0, DOMED)
    [gap] = found.gaps
    assert found.status == "occluded"
    assert gap.extent == pytest.approx(unreachable_chord(target, DOMED, 0.0, gap), abs=1e-3)


def test_every_demand_has_its_rows():
    rows = [str(row) for row in bench_tracing.width_rows()]
    assert len(rows) == 4
    assert not any("MISSED" in row for row in rows)


def mouth(half_width: float) -> Gap:
    """A gap as wide as the hollow opposite the first touch."""
    angle = half_width / 0.028
    ends = [
        0.028 * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        for azimuth in (math.pi - angle, math.pi + angle)
    ]
    return Gap(ends[0], ends[1], "bridged")


@pytest.mark.parametrize("pad", [FLAT, DOMED], ids=["flat", "domed"])
def test_nothing_of_a_convex_object_is_hidden(pad):
    target = TRACED_OBJECTS["cylinder"]
    assert unreachable_chord(target, pad, 0.0, mouth(0.004)) == 0.0


def test_a_slot_that_is_deeper_than_it_is_wide_is_hidden_but_for_its_rims():
    target = carved("slot", 0.020, 0.002)
    chord = unreachable_chord(target, DOMED, 0.0, mouth(0.003))
    assert 0.003 < chord < 0.0045


def test_a_dent_shallower_than_the_deepest_press_is_not_hidden():
    target = carved("dent", 0.0022, 0.004)
    assert unreachable_chord(target, FLAT, 0.0, mouth(0.005)) == 0.0


def test_a_blunt_wedge_that_an_edge_of_the_pad_enters_is_not_hidden():
    target = carved("wedge", 0.004, 0.006)
    assert unreachable_chord(target, FLAT, 0.0, mouth(0.0065)) == 0.0


def test_what_is_within_reach_is_touched_by_a_press_at_some_place():
    target = carved("wedge", 0.004, 0.006)
    bottom = np.array([-0.024, 0.0, 0.0])
    nearest = math.inf
    for turn in np.radians([-40.0, -30.0, 30.0, 40.0]):
        # The pad's edge comes first: it stands half a pad beside the bottom, to either side.
        z = -np.array([-math.cos(turn), -math.sin(turn), 0.0])
        y = np.array([0.0, 0.0, -1.0])
        axes = np.column_stack([np.cross(y, z), y, z])
        for side in (-7.5e-3, 7.5e-3):
            start = bottom - 0.03 * z + side * axes[:, 0] + 0.5e-3 * y
            end = guarded_move(target.shape, FLAT, pose_of(start, axes), 0.05, 2.4e-3)
            x, _ = FLAT.grid()
            depth = end.compression[8, 0 if side > 0 else 15]
            if depth > 0.0:
                place = end.pose[:3] + axes @ [x[0, 0] * math.copysign(1, side), 0.0, -depth]
                nearest = min(nearest, float(np.linalg.norm(place[:2] - bottom[:2])))
    assert nearest < 0.1e-3
