from __future__ import annotations

import numpy as np
import pytest

from palpate.launch import bench_tracing
from palpate.launch.bench_tracing import DOMED, FLAT, Noise, followed, off_outline, traced
from palpate.launch.tracing_objects import OBJECTS, notched
from palpate.launch.tracing_reach import hidden


@pytest.mark.parametrize("name", sorted(OBJECTS))
def test_every_object_has_the_outline_that_its_rays_meet(name: str) -> None:
    target = OBJECTS[name]
    height = 0.4 * target.half
    outline = target.outline(height)
    for number in range(0, len(outline), len(outline) // 7):
        away = outline[number] / np.linalg.norm(outline[number])
        start = np.array([[0.1 * away[0], 0.1 * away[1], height]])
        met = target.shape.cast(start, np.array([-away[0], -away[1], 0.0]), 0.1)
        assert 0.1 - met[0] == pytest.approx(np.linalg.norm(outline[number]), abs=1e-8)


def test_a_ray_of_a_radial_solid_says_where_it_is() -> None:
    star = OBJECTS["star"].shape
    starts = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.01, 0.3]])
    found = star.cast(starts, np.array([0.0, 0.0, -1.0]), 0.15)
    assert found.tolist() == pytest.approx([0.055, -np.inf, np.inf, np.inf])


def test_a_radial_solid_has_no_mesh() -> None:
    with pytest.raises(NotImplementedError, match="no mesh"):
        OBJECTS["star"].shape.mesh(3)


def test_points_off_a_polygon_are_measured_to_its_sides() -> None:
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    off = off_outline(np.array([[0.9, 0.0], [1.3, 1.4], [-0.5, 1.25]]), square)
    assert off.tolist() == pytest.approx([0.1, 0.5, 0.25])


def test_a_ball_is_traced_whole_and_exactly() -> None:
    for pad, most in ((FLAT, 20), (DOMED, 26)):
        found, gaps = followed(OBJECTS["sphere"], 0.3, pad)
        assert (found.status, gaps, found.covered) == ("closed", (), 1.0)
        assert found.touches <= most
        assert found.worst < 10e-6


def test_noise_moves_the_points_as_far_as_the_pose() -> None:
    found = traced(OBJECTS["box"], 0.0, FLAT, Noise(), seed=1)
    assert found.status == "closed"
    assert 50e-6 < found.rms < 200e-6
    assert found == traced(OBJECTS["box"], 0.0, FLAT, Noise(), seed=1)


def test_a_slot_is_occluded_for_as_long_as_nothing_can_be_felt() -> None:
    target = notched(0.010, 0.0025)
    found, [gap] = followed(target, 0.0, DOMED)
    assert found.status == "occluded"
    assert gap.extent == pytest.approx(hidden(target, DOMED, 0.0, gap), abs=1e-3)


def test_every_demand_has_its_rows() -> None:
    assert len(bench_tracing.GROUPS) == 4
    rows = [str(row) for row in bench_tracing.widths(quick=True)]
    assert len(rows) == 4
    assert not any("MISSED" in row for row in rows)
