from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.polygons import edge_distance
from palpate.core.geometry.star_shapes import azimuth_match, kernel_point, radial_match

AZIMUTHS = 2 * np.pi * np.arange(80) / 80


def test_where_each_ray_meets_the_contour_once_both_matches_agree(
    three_lobes: Callable[..., Floats],
) -> None:
    contour, middle = three_lobes(0.4) + [3.0, -2.0], np.array([3.05, -2.02])
    radial, match = (
        radial_match(contour, middle, AZIMUTHS),
        azimuth_match(contour, middle, AZIMUTHS),
    )
    assert (radial.meetings == 1).all()
    assert match.one_to_one
    assert match.inside
    assert np.allclose(match.points, radial.points, rtol=0, atol=1e-5)


def test_where_a_ray_meets_the_contour_is_on_it(u_shape: Floats) -> None:
    found = radial_match(u_shape, np.array([0.5, 0.5]), AZIMUTHS)
    assert (found.meetings >= 1).all()
    assert np.allclose(edge_distance(u_shape, found.points), 0.0, atol=1e-14)
    missed = radial_match(u_shape, np.array([9.0, 0.5]), np.array([0.0]))
    assert missed.meetings[0] == 0
    assert np.array_equal(missed.points[0], [9.0, 0.5])


def test_azimuths_of_more_than_a_turn_begin_again(three_lobes: Callable[..., Floats]) -> None:
    contour = three_lobes(0.3)
    once = azimuth_match(contour, np.zeros(2), AZIMUTHS)
    again = azimuth_match(contour, np.zeros(2), AZIMUTHS + 4 * np.pi)
    assert np.allclose(once.points, again.points, rtol=0, atol=1e-12)


def test_the_match_does_not_depend_on_the_first_vertex(
    u_shape: Floats, refined: Callable[..., Floats]
) -> None:
    contour, middle = refined(u_shape), np.array([0.5, 0.5])
    wanted = azimuth_match(contour, middle, AZIMUTHS).points
    for shift in (1, 130, 399):
        found = azimuth_match(np.roll(contour, shift, axis=0), middle, AZIMUTHS).points
        assert np.allclose(found, wanted, rtol=0, atol=1e-9)


def test_too_few_vertices_or_a_nan_are_refused() -> None:
    with pytest.raises(ValueError, match="polygon must have at least 3 vertices, got 2"):
        azimuth_match(np.zeros((2, 2)), np.zeros(2), AZIMUTHS)
    with pytest.raises(ValueError, match="azimuths must be finite"):
        azimuth_match(np.eye(3, 2), np.zeros(2), np.array([np.nan]))


def test_no_polygon_meets_no_ray() -> None:
    with pytest.raises(ValueError, match="polygon must have at least 1 vertex, got 0"):
        radial_match(np.zeros((0, 2)), np.zeros(2), AZIMUTHS)
    with pytest.raises(ValueError, match="azimuths must be finite"):
        radial_match(np.eye(3, 2), np.zeros(2), np.array([np.nan]))


CORNER = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4.0]])
MOUTH = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [4, 3], [4, 4], [0, 4.0]])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_an_angle_is_seen_whole_from_its_corner(scale: float) -> None:
    place = kernel_point(scale * (CORNER + 7.0))
    assert place is not None
    np.testing.assert_allclose(place / scale - 7.0, [0.5, 0.5], atol=1e-7)


def test_a_convex_polygon_is_seen_best_from_the_middle_of_its_largest_disc() -> None:
    box = np.array([[0, 0], [2, 0], [2, 2], [2, 2], [0, 2.0]])
    np.testing.assert_allclose(kernel_point(box), [1.0, 1.0], atol=1e-9)


def test_nothing_sees_both_arms_of_a_clamp_nor_a_single_place() -> None:
    assert kernel_point(MOUTH) is None
    assert kernel_point(np.ones((4, 2))) is None
