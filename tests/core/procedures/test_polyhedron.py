"""Planes by total least squares, and the corners in which they meet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.procedures.polyhedron import Plane, corners_of, fit_plane, polyhedron_of

RNG = np.random.default_rng(5)


def patches(count: int, offsets: np.ndarray | float = 0.0) -> list[np.ndarray]:
    """Touches of the plane z = 0.02, each off by its own offset along it."""
    offsets = np.broadcast_to(offsets, count)
    touches = []
    for number in range(count):
        flat = RNG.uniform(-6e-3, 6e-3, (80, 2)) + RNG.uniform(-0.03, 0.03, 2)
        touches.append(np.column_stack([flat, np.full(80, 0.02 + offsets[number])]))
    return touches


def test_a_plane_is_found_from_exact_points_whatever_way_it_faces():
    for outward in ([0, 0, 1.0], [0, 0, -1.0]):
        fit = fit_plane(patches(5), np.array(outward), 0.0, 1e-4, 1e-3)
        assert fit.plane.normal == pytest.approx(outward, abs=1e-12)
        assert fit.plane.offset == pytest.approx(0.02 * outward[2]) and fit.rms < 1e-15


def test_the_stated_error_of_a_normal_is_what_it_scatters_by():
    lean, stated = [], []
    for _ in range(200):
        fit = fit_plane(patches(6, RNG.normal(0.0, 1e-4, 6)), np.array([0, 0, 1.0]), 1e-5, 1e-4, 1)
        lean.append(math.acos(min(fit.plane.normal[2], 1.0)))
        stated.append(fit.normal_error)
    assert np.sqrt(np.mean(np.square(lean))) == pytest.approx(
        np.sqrt(np.mean(np.square(stated))), rel=0.2
    )


def test_few_points_and_points_on_a_line_are_refused():
    up = np.array([0.0, 0, 1.0])
    with pytest.raises(ValueError, match="a plane needs 3 points, got 2"):
        fit_plane([np.zeros((2, 3))], up, 0.0, 1e-4, 1e-3)
    line = np.column_stack([np.arange(9.0), np.zeros((9, 2))])
    with pytest.raises(ValueError, match="on a line"):
        fit_plane([line], up, 0.0, 1e-4, 1e-3)


def box_planes() -> list[Plane]:
    return [Plane(sign * axis, 1.0) for axis in np.eye(3) for sign in (1.0, -1.0)]


def test_the_corners_of_a_box_close_it():
    corners = corners_of(box_planes(), 10.0)
    assert corners is not None and sorted(map(len, corners.faces)) == [4] * 6
    solid, numbers = polyhedron_of(corners)
    assert solid.volume == pytest.approx(8.0) and numbers == list(range(6))
    assert solid.edges.euler == 2


def test_a_corner_of_more_than_three_planes_is_one():
    slopes = [Plane(np.array([x, y, 1.0]) / math.sqrt(2.0), 1.0 / math.sqrt(2.0))
              for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))]  # fmt: skip
    corners = corners_of([*slopes, Plane(np.array([0.0, 0, -1.0]), 0.0)], 10.0)
    assert corners is not None and len(corners.places) == 5


@pytest.mark.parametrize("left_out", range(6))
def test_planes_that_leave_a_side_open_have_no_corners(left_out):
    planes = box_planes()
    del planes[left_out]
    assert corners_of(planes, 10.0) is None


def test_a_plane_that_touches_nothing_of_the_rest_has_no_corners():
    corners = corners_of([*box_planes(), Plane(np.array([1.0, 0, 0]), 3.0)], 10.0)
    assert corners is not None and corners.faces[-1] == ()
