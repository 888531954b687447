from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.geometry.polygons import (
    area_centroid,
    azimuth_match,
    edge_distance,
    inscribed_circle,
    kernel_point,
    self_intersects,
    signed_area,
    turn_between,
    winding_number,
)

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
SEEDS = st.integers(0, 10**6)


def test_the_area_is_positive_counter_clockwise():
    assert signed_area(SQUARE) == 1.0
    assert signed_area(SQUARE[::-1]) == -1.0
    assert signed_area(1e6 + 1e-6 * SQUARE) == pytest.approx(1e-12, rel=1e-3)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(SEEDS, st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_the_centroid_moves_with_the_figure(seed: int, scale: float, angle: float) -> None:
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 12))
    figure = rng.uniform(0.5, 1.5, (12, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    cosine, sine = math.cos(angle), math.sin(angle)
    rotation, shift = np.array([[cosine, -sine], [sine, cosine]]), rng.normal(size=2)
    moved = scale * figure @ rotation.T + shift
    wanted = scale * rotation @ area_centroid(figure) + shift
    assert np.allclose(area_centroid(moved), wanted, rtol=0, atol=1e-11 * scale)


def test_the_centroid_of_a_triangle_is_the_mean_of_its_corners():
    corners = np.array([[0, 0, 7], [3, 0, 7], [0, 6, 7.0]])
    assert np.allclose(area_centroid(corners), [1, 2])


@settings(derandomize=True, deadline=None, max_examples=40)
@given(SEEDS, st.floats(-12.0, 0.49))
def test_angles_are_found_at_any_size_of_the_vectors(seed: int, power: float) -> None:
    rng, angle = np.random.default_rng(seed), 10.0**power
    begin = rng.uniform(0.0, 7.0)
    first, second = (
        10.0 ** rng.uniform(-200, 150) * np.array([math.cos(way), math.sin(way)])
        for way in (begin, begin + angle)
    )
    assert turn_between(first, second) == pytest.approx(angle, rel=1e-12, abs=1e-14)


def test_turns_are_positive_counter_clockwise():
    east, north = np.array([2.0, 0.0]), np.array([0.0, 0.5])
    assert turn_between(east, north) == pytest.approx(np.pi / 2)
    assert turn_between(north, east) == pytest.approx(-np.pi / 2)
    assert turn_between(east, -east) == pytest.approx(np.pi)
    assert np.array_equal(turn_between(np.array([east, north]), north), [np.pi / 2, 0.0])


def test_half_a_turn_is_positive_whatever_the_sign_of_zero():
    for zero in (0.0, -0.0):
        for x in (1.0, -1.0):
            assert turn_between(np.array([x, zero]), np.array([-x, 0.0])) == np.pi


def test_a_direction_of_no_length_makes_no_angle():
    assert turn_between(np.zeros(2), np.array([1.0, 2.0])) == 0.0


@settings(derandomize=True, deadline=None, max_examples=30)
@given(SEEDS)
def test_winding_and_distance_agree_with_sums_of_angles_and_fine_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygon, points = rng.normal(size=(9, 2)), rng.normal(size=(40, 2))
    away = polygon - points[:, None, :]
    angles = turn_between(away, np.roll(away, -1, axis=1)).sum(axis=1)
    assert np.array_equal(winding_number(polygon, points), np.round(angles / (2 * np.pi)))
    share = np.linspace(0, 1, 400)[:, None, None]
    edges = (1 - share) * polygon + share * np.roll(polygon, -1, axis=0)
    sampled = np.linalg.norm(points[:, None] - edges.reshape(1, -1, 2), axis=2).min(axis=1)
    distance = edge_distance(polygon, points)
    assert (distance <= sampled + 1e-12).all()
    assert np.allclose(distance, sampled, atol=1e-2)


def test_an_edge_of_no_length_is_a_point():
    doubled = np.repeat(SQUARE, 2, axis=0)
    assert edge_distance(doubled, np.array([[0.5, 0.2]]))[0] == pytest.approx(0.2)


def _crosses_plainly(polygon):
    count = len(polygon)

    def side(a, b, c):
        return float((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])

    for i in range(count):
        for j in range(i + 2, count):
            if i == 0 and j == count - 1:
                continue
            a, b = polygon[i], polygon[(i + 1) % count]
            c, d = polygon[j], polygon[(j + 1) % count]
            if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
                return True
    return False


@settings(derandomize=True, deadline=None, max_examples=50)
@given(SEEDS, st.integers(3, 12), st.floats(0.0, 0.5))
def test_crossings_are_those_that_all_pairs_show(seed: int, count: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * np.arange(count) / count
    polygon = np.column_stack([np.cos(turn), np.sin(turn)]) + noise * rng.normal(size=(count, 2))
    assert self_intersects(polygon) == _crosses_plainly(polygon)


def test_a_polygon_that_touches_itself_meets_itself(three_lobes):
    touching = np.array([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2.0]])
    assert self_intersects(touching)
    assert not self_intersects(SQUARE)
    assert not self_intersects(three_lobes(0.9))
    assert self_intersects(SQUARE[[0, 2, 1, 3]])


@pytest.mark.parametrize("scale", [1e-200, 1e-9, 1.0, 1e200])
def test_vertices_that_come_twice_are_no_touch(scale):
    closed = scale * np.vstack([SQUARE, SQUARE[:1]])
    assert not self_intersects(closed)
    assert not self_intersects(np.repeat(closed, 3, axis=0))
    assert self_intersects(closed[[0, 2, 1, 3, 0]])
    assert not self_intersects(np.zeros((9, 2)))


@pytest.mark.parametrize("count", [33, 64, 65, 1000])
def test_one_crossing_among_many_edges_is_found_wherever_it_is(count):
    turn = 2 * np.pi * np.arange(count) / count
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    assert not self_intersects(circle)
    for place in range(0, count, max(count // 33, 1)):
        crossed = np.roll(circle, place, axis=0)
        crossed[[5, 6]] = crossed[[6, 5]]
        assert self_intersects(crossed)


def test_no_polygon_and_what_is_not_finite_are_refused():
    origin, nan = np.zeros((1, 2)), np.full((1, 2), math.nan)
    for measure in (signed_area, area_centroid):
        with pytest.raises(ValueError, match="polygon must have at least 1 vertex, got 0"):
            measure(np.zeros((0, 2)))
    with pytest.raises(ValueError, match="polygon must be finite"):
        self_intersects(nan)
    for relate in (edge_distance, winding_number):
        with pytest.raises(ValueError, match="polygon must have at least 1 vertex, got 0"):
            relate(np.zeros((0, 2)), origin)
        with pytest.raises(ValueError, match="points must be finite"):
            relate(SQUARE, nan)
    with pytest.raises(ValueError, match="second must be finite"):
        turn_between(SQUARE[1], nan)
    with pytest.raises(ValueError, match=r"first must have shape \(..., 2\), got \(3,\)"):
        turn_between(np.zeros(3), SQUARE[1])


def polygon(azimuth, radius, middle):
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * np.reshape(radius, (-1, 1))
    return np.column_stack([away + middle, np.full(len(azimuth), 0.05)])


def test_the_middle_of_an_unevenly_felt_circle_is_its_centre():
    rng = np.random.default_rng(0)
    azimuth = np.sort(np.concatenate([rng.uniform(0, 2 * np.pi, 60), rng.uniform(0, 0.5, 300)]))
    contour = polygon(azimuth, 0.03, (0.1, -0.2))
    assert np.linalg.norm(area_centroid(contour) - [0.1, -0.2]) < 0.01 * 0.03
    assert np.linalg.norm(contour[:, :2].mean(axis=0) - [0.1, -0.2]) > 0.5 * 0.03


def test_the_middle_does_not_depend_on_direction_or_start_or_a_repeated_end():
    azimuth = np.sort(np.random.default_rng(1).uniform(0, 2 * np.pi, 40))
    contour = polygon(azimuth, 0.03 + 0.01 * np.cos(3 * azimuth), (1.0, 2.0))
    middle = area_centroid(contour)
    for other in (
        contour[::-1],
        np.roll(contour, 13, axis=0),
        np.concatenate([contour, contour[:1]]),
    ):
        assert np.allclose(area_centroid(other), middle, rtol=0, atol=1e-15)


def test_the_middle_of_a_small_ring_far_away_keeps_its_digits():
    azimuth = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    contour = polygon(azimuth, 1e-6, (1e3, -1e3))
    assert np.linalg.norm(area_centroid(contour) - [1e3, -1e3]) < 1e-11


@pytest.mark.parametrize("count", [1, 2, 40])
def test_points_that_enclose_nothing_have_the_middle_of_the_points(count):
    on_a_line = np.outer(np.linspace(1.0, 2.0, count), [0.01, 0.02, 0.0])
    assert np.allclose(area_centroid(on_a_line), on_a_line.mean(axis=0)[:2], atol=1e-15)


def test_the_circle_in_a_square_a_rectangle_and_a_triangle_is_the_known_one():
    for scale, shift in ((1.0, 0.0), (1e-9, 1e-3), (1e9, 0.0)):
        middle, radius = inscribed_circle(scale * SQUARE + shift)
        assert radius == pytest.approx(0.5 * scale, rel=1e-6)
        assert np.allclose(middle, 0.5 * scale + shift, rtol=1e-6)
    flat = inscribed_circle(SQUARE * [10, 1])
    assert flat.radius == pytest.approx(0.5, rel=1e-6)
    triangle = inscribed_circle(np.array([[0, 0], [4, 0], [0, 3.0]]))
    assert triangle.radius == pytest.approx(1.0, rel=1e-4)
    assert np.allclose(triangle.middle, [1, 1], atol=1e-3)


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.integers(0, 10**6))
def test_no_sampled_place_holds_a_larger_circle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 20))
    polygon = rng.uniform(0.3, 1.5, (20, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    middle, radius = inscribed_circle(polygon)
    places = rng.uniform(polygon.min(axis=0), polygon.max(axis=0), (3000, 2))
    places = places[winding_number(polygon, places) != 0]
    assert radius >= edge_distance(polygon, places).max() - 1e-3 * np.ptp(polygon, axis=0).max()
    assert edge_distance(polygon, middle[None])[0] == pytest.approx(radius)
    assert winding_number(polygon, middle[None])[0] != 0


def test_a_polygon_that_encloses_nothing_holds_no_circle():
    assert inscribed_circle(np.tile([1.0, 2.0], (5, 1))).radius == 0.0
    assert inscribed_circle(np.array([[0, 0], [1, 1], [2, 2.0]])).radius == 0.0


def test_what_encloses_nothing_is_refused():
    with pytest.raises(ValueError, match="polygon must have at least 3 vertices, got 2"):
        inscribed_circle(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="polygon must be finite"):
        inscribed_circle(np.full((3, 2), np.nan))


AZIMUTHS = 2 * np.pi * np.arange(80) / 80


def ray_meetings(polygon, middle, azimuths):
    """How often each ray from the middle meets the polygon, and the farthest place."""
    starts = polygon - middle
    ends, rays = np.roll(starts, -1, axis=0), np.array([np.cos(azimuths), np.sin(azimuths)]).T
    first, second = (np.outer(rays[:, 0], p[:, 1]) - np.outer(rays[:, 1], p[:, 0])
                     for p in (starts, ends))  # fmt: skip
    crossing = (first >= 0.0) != (second >= 0.0)
    share = np.divide(first, first - second, out=np.zeros_like(first), where=crossing)
    along = np.where(crossing, rays @ starts.T + share * (rays @ (ends - starts).T), 0.0)
    return (along > 0.0).sum(axis=1), middle + along.max(axis=1)[:, None] * rays


def test_an_unevenly_sampled_circle_has_its_centroid_in_the_middle():
    # Three quarters of the points lie on one quarter of the circle.
    angle = np.concatenate(
        [
            np.linspace(0, np.pi / 2, 60, endpoint=False),
            np.linspace(np.pi / 2, 2 * np.pi, 20, endpoint=False),
        ]
    )
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    assert np.linalg.norm(circle.mean(axis=0)) > 0.4
    assert np.linalg.norm(area_centroid(circle)) < 0.01
    assert np.linalg.norm(area_centroid(np.vstack([circle, circle[:1]]))) < 0.01


def test_a_concave_slice_is_matched_in_order_or_flagged_where_rays_miss_or_meet_it_often(
    u_shape, refined
):
    contour = refined(u_shape)
    outside, inside = area_centroid(u_shape), inscribed_circle(u_shape).middle
    assert winding_number(u_shape, outside[None])[0] == 0
    assert set(ray_meetings(contour, outside, AZIMUTHS + 0.01)[0]) == {0, 2}
    assert set(ray_meetings(contour, inside, AZIMUTHS + 0.01)[0]) == {1, 3}
    for middle in (outside, inside):
        match = azimuth_match(contour, middle, AZIMUTHS)
        assert match.inside == (middle is inside)
        assert not match.one_to_one
        steps = np.mod(np.diff(match.turns, append=match.turns[0]), 1.0)
        assert (steps > 0.0).all()
        assert steps.sum() == pytest.approx(1.0)
        assert np.allclose(edge_distance(u_shape, match.points), 0.0, atol=1e-12)
    # Where a ray meets the outline only once, the match from inside is nearly that place.
    match = azimuth_match(contour, inside, AZIMUTHS)
    radial = ray_meetings(contour, inside, AZIMUTHS)[1]
    below = (np.sin(AZIMUTHS) < -0.8) & (np.cos(AZIMUTHS) < 0.0)
    off = np.linalg.norm(match.points - radial, axis=1)[below]
    assert off.max() < 1.0


def test_the_largest_circle_in_a_u_lies_inside_where_the_middle_of_its_box_does_not(u_shape):
    box = 0.5 * (u_shape.min(axis=0) + u_shape.max(axis=0))
    assert winding_number(u_shape, box[None])[0] == 0
    middle, radius = inscribed_circle(u_shape)
    assert winding_number(u_shape, middle[None])[0] == 1
    # It touches two sides of a corner and the corner opposite: (1 - r) sqrt 2 = r.
    assert radius == pytest.approx(2 - math.sqrt(2), rel=1e-6)


def test_an_angle_of_a_nanoradian_is_found():
    first, second = np.array([1.0, 0.0]), np.array([math.cos(1e-9), math.sin(1e-9)])
    assert math.acos(min(float(first @ second), 1.0)) == 0.0
    assert turn_between(first, second) == pytest.approx(1e-9, rel=1e-12)


def test_where_each_ray_meets_the_contour_once_both_matches_agree(three_lobes):
    contour, middle = three_lobes(0.4) + [3.0, -2.0], np.array([3.05, -2.02])
    meetings, points = ray_meetings(contour, middle, AZIMUTHS)
    match = azimuth_match(contour, middle, AZIMUTHS)
    assert (meetings == 1).all()
    assert match.one_to_one
    assert match.inside
    assert np.allclose(match.points, points, rtol=0, atol=1e-5)


def test_azimuths_of_more_than_a_turn_begin_again(three_lobes):
    contour = three_lobes(0.3)
    once = azimuth_match(contour, np.zeros(2), AZIMUTHS)
    again = azimuth_match(contour, np.zeros(2), AZIMUTHS + 4 * np.pi)
    assert np.allclose(once.points, again.points, rtol=0, atol=1e-12)


def test_the_match_does_not_depend_on_the_first_vertex(u_shape, refined):
    contour, middle = refined(u_shape), np.array([0.5, 0.5])
    wanted = azimuth_match(contour, middle, AZIMUTHS).points
    for shift in (1, 130, 399):
        found = azimuth_match(np.roll(contour, shift, axis=0), middle, AZIMUTHS).points
        assert np.allclose(found, wanted, rtol=0, atol=1e-9)


def test_too_few_vertices_or_a_nan_are_refused():
    with pytest.raises(ValueError, match="polygon must have at least 3 vertices, got 2"):
        azimuth_match(np.zeros((2, 2)), np.zeros(2), AZIMUTHS)
    with pytest.raises(ValueError, match="azimuths must be finite"):
        azimuth_match(np.eye(3, 2), np.zeros(2), np.array([np.nan]))


CORNER = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4.0]])
MOUTH = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [4, 3], [4, 4], [0, 4.0]])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_an_angle_is_seen_whole_from_its_corner(scale):
    place = kernel_point(scale * (CORNER + 7.0))
    assert place is not None
    np.testing.assert_allclose(place / scale - 7.0, [0.5, 0.5], atol=1e-7)


def test_a_convex_polygon_is_seen_best_from_the_middle_of_its_largest_disc():
    box = np.array([[0, 0], [2, 0], [2, 2], [2, 2], [0, 2.0]])
    np.testing.assert_allclose(kernel_point(box), [1.0, 1.0], atol=1e-9)


def test_nothing_sees_both_arms_of_a_clamp_nor_a_single_place():
    assert kernel_point(MOUTH) is None
    assert kernel_point(np.ones((4, 2))) is None


def test_the_circle_in_a_triangle_of_3_4_and_5_has_radius_1_to_eight_digits():
    middle, radius = inscribed_circle(np.array([[0, 0], [4, 0], [0, 3.0]]))
    assert radius == pytest.approx(1.0, rel=1e-8)
    assert np.allclose(middle, [1.0, 1.0], rtol=0, atol=1e-8)
