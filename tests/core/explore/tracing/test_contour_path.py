from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.explore.tracing.contour_path import Path, heading_at_end

WIDTH = 0.015


def arc(radius: float, begin: float, end: float, count: int) -> Path:
    """Points of a circle about the origin, counter-clockwise, with their normals."""
    azimuth = np.linspace(begin, end, count)
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)])
    flat = np.zeros(count)
    return Path(radius * away, away, flat, flat, flat)


@pytest.mark.parametrize("radius", [0.005, 0.01, 0.03, 0.2])
@pytest.mark.parametrize("azimuth", [0.0, 1.0, 3.1, -2.0])
def test_the_course_of_a_circle_is_its_tangent_and_curvature(radius, azimuth) -> None:
    path = arc(radius, azimuth - 0.012 / radius, azimuth, 13)
    course = heading_at_end(path, azimuth - 0.1, WIDTH)
    assert np.allclose(course.tangent, [-math.sin(azimuth), math.cos(azimuth)], atol=1e-12)
    assert course.normal_azimuth == pytest.approx(azimuth, abs=1e-9)
    # A parabola leaves out the fourth power, at most 60 um of it.
    assert course.curvature == pytest.approx(1 / radius, rel=0.15)


def test_a_hollow_has_negative_curvature() -> None:
    points = arc(0.02, 3.0, 2.5, 12)
    path = points._replace(normals=-points.normals)
    assert heading_at_end(path, 2.5 - math.pi, WIDTH).curvature == pytest.approx(-50.0, rel=0.1)


def test_headings_do_not_jump_by_a_whole_turn() -> None:
    for turns in (-1, 0, 2):
        path = arc(0.03, 2.9, 3.3, 12)
        course = heading_at_end(path, 3.2 + 2 * math.pi * turns, WIDTH)
        assert course.normal_azimuth == pytest.approx(3.3 + 2 * math.pi * turns, abs=1e-9)


def test_one_point_goes_on_across_the_heading() -> None:
    path = arc(0.03, 0.5, 0.5, 1)._replace(normals=np.array([[0.0, 0.0, 1.0]]))
    course = heading_at_end(path, 0.5, WIDTH)
    assert np.allclose(course.tangent, [-math.sin(0.5), math.cos(0.5)])
    assert course.curvature == 0.0


def test_curvatures_are_bounded() -> None:
    tight = heading_at_end(arc(0.0005, -2.0, 0.0, 9), 0.0, WIDTH)
    assert tight.curvature <= 500.0
