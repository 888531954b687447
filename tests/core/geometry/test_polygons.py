"""Laws of closed polygons: area, winding, crossings, circles, kernels, azimuths."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.geometry import (
    area_centroid,
    area_centroids,
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
U_SHAPE = np.array([[0, 0], [5, 0], [5, 4], [4, 4], [4, 1], [1, 1], [1, 4], [0, 4.0]])
SEEDS = st.integers(0, 10**6)
AZIMUTHS = 2 * np.pi * np.arange(80) / 80
quick = settings(derandomize=True, deadline=None, max_examples=25)


def plane(angles: Floats, radius: Floats | float = 1.0) -> Floats:
    return np.reshape(radius, (-1, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])


def lobes(depth: float, count: int = 3000) -> Floats:
    angle = 2 * np.pi * np.arange(count) / count
    return plane(angle, 1.0 + depth * np.cos(3 * angle))


def refined(polygon: Floats, per_edge: int = 50) -> Floats:
    share = np.arange(per_edge)[:, None, None] / per_edge
    fine = polygon + share * (np.roll(polygon, -1, axis=0) - polygon)
    return fine.transpose(1, 0, 2).reshape(-1, 2)


def test_area_has_the_sign_of_the_direction():
    assert signed_area(SQUARE) == 1.0 and signed_area(SQUARE[::-1]) == -1.0
    assert signed_area(1e6 + 1e-6 * SQUARE) == pytest.approx(1e-12, rel=1e-3)
    assert signed_area(plane(AZIMUTHS)) == pytest.approx(40 * np.sin(2 * np.pi / 80))


@quick
@given(SEEDS, st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_centroid_is_that_of_the_triangles_and_moves_along(seed, scale, angle):
    rng = np.random.default_rng(seed)  # for a polygon that the origin sees whole
    figure = plane(np.sort(rng.uniform(0, 2 * np.pi, 12)), rng.uniform(0.3, 1.5, 12))
    ahead = np.roll(figure, -1, axis=0)
    areas = 0.5 * (figure[:, 0] * ahead[:, 1] - figure[:, 1] * ahead[:, 0])
    wanted = areas @ (figure + ahead) / 3.0 / areas.sum()
    assert np.allclose(area_centroid(figure), wanted, rtol=0, atol=1e-12)
    cosine, sine = math.cos(angle), math.sin(angle)
    rotation, shift = np.array([[cosine, -sine], [sine, cosine]]), rng.normal(size=2)
    moved = scale * figure @ rotation.T + shift
    centroid = scale * rotation @ wanted + shift
    listed = moved[::-1], np.roll(moved, 5, axis=0), np.vstack([moved, moved[:1]])
    for contour in (moved, *listed, np.column_stack([moved, np.full(12, 7.0)])):
        assert np.allclose(area_centroid(contour), centroid, rtol=0, atol=1e-11 * scale)
    both = area_centroids(np.stack([figure, moved]))
    assert np.allclose(both, [wanted, centroid], rtol=0, atol=1e-11 * scale)


def test_centroid_does_not_follow_dense_points():
    angle = np.concatenate([np.arange(60) / 240, 0.25 + 0.75 * np.arange(20) / 20]) * 2 * np.pi
    uneven = plane(angle)
    assert np.linalg.norm(uneven.mean(axis=0)) > 0.4
    assert np.linalg.norm(area_centroid(uneven)) < 0.01
    far = 1e-6 * plane(AZIMUTHS) + [1e3, -1e3]
    assert np.linalg.norm(area_centroid(far) - [1e3, -1e3]) < 1e-11
    for count in (1, 2, 40):  # without an area it is the mean of the points
        on_a_line = np.outer(np.linspace(1.0, 2.0, count), [0.01, 0.02, 0.0])
        assert np.allclose(area_centroid(on_a_line), on_a_line.mean(axis=0)[:2], atol=1e-15)


@quick
@given(SEEDS, st.floats(-12.0, 0.49))
def test_turns_are_exact_at_any_size(seed, power):
    rng, angle = np.random.default_rng(seed), 10.0**power
    begin = rng.uniform(0.0, 7.0)
    first, second = (10.0 ** rng.uniform(-200, 150) * plane(begin + by)[0] for by in (0.0, angle))
    assert turn_between(first, second) == pytest.approx(angle, rel=1e-12, abs=2e-15)
    assert turn_between(second, first) == pytest.approx(-angle, rel=1e-12, abs=2e-15)


def test_turns_of_special_directions():
    east, north = np.array([2.0, 0.0]), np.array([0.0, 0.5])
    assert np.array_equal(turn_between(np.array([east, north]), north), [np.pi / 2, 0.0])
    for zero in (0.0, -0.0):
        for x in (1.0, -1.0):
            assert turn_between(np.array([x, zero]), np.array([-x, 0.0])) == np.pi
    assert turn_between(np.zeros(2), np.array([1.0, 2.0])) == 0.0
    tiny = np.array([math.cos(1e-9), math.sin(1e-9)])
    assert turn_between(np.array([1.0, 0.0]), tiny) == pytest.approx(1e-9, rel=1e-12)


@quick
@given(SEEDS)
def test_winding_and_distance_agree_with_angles_and_samples(seed):
    rng = np.random.default_rng(seed)
    polygon, points = rng.normal(size=(9, 2)), rng.normal(size=(40, 2))
    away = polygon - points[:, None, :]
    angles = turn_between(away, np.roll(away, -1, axis=1)).sum(axis=1)
    assert np.array_equal(winding_number(polygon, points), np.round(angles / (2 * np.pi)))
    sampled = np.linalg.norm(points[:, None] - refined(polygon, 400), axis=2).min(axis=1)
    distance = edge_distance(polygon, points)
    assert (distance <= sampled + 1e-12).all() and np.allclose(distance, sampled, atol=1e-2)
    doubled = np.repeat(polygon, 2, axis=0)
    assert np.allclose(edge_distance(doubled, points), distance, rtol=0, atol=1e-14)


def sides(a: Floats, b: Floats, c: Floats) -> Floats:
    (x, y), (u, v) = (np.moveaxis(one - a, -1, 0) for one in (b, c))
    return np.asarray(x * v - y * u)


@quick
@given(SEEDS, st.integers(3, 12), st.floats(0.0, 0.5))
def test_crossings_are_those_of_all_pairs(seed, count, noise):
    rng = np.random.default_rng(seed)
    polygon = plane(2 * np.pi * np.arange(count) / count) + noise * rng.normal(size=(count, 2))
    first = polygon[:, None], np.roll(polygon, -1, axis=0)[:, None]
    second = polygon, np.roll(polygon, -1, axis=0)
    parted = [
        sides(*one, other[0]) * sides(*one, other[1]) < 0
        for one, other in ((first, second), (second, first))
    ]
    assert self_intersects(polygon) == (parted[0] & parted[1]).any()


@pytest.mark.parametrize("count", [33, 64, 65, 1000])
def test_one_crossing_among_many_edges_is_found(count):
    circle = plane(2 * np.pi * np.arange(count) / count)
    assert not self_intersects(circle)
    for place in range(0, count, max(count // 33, 1)):
        crossed = np.roll(circle, place, axis=0)
        crossed[[5, 6]] = crossed[[6, 5]]
        assert self_intersects(crossed)


@pytest.mark.parametrize("scale", [1e-200, 1e-9, 1.0, 1e200])
def test_touches_cross_and_repeated_vertices_do_not(scale):
    closed = scale * np.vstack([SQUARE, SQUARE[:1]])
    assert not self_intersects(closed)
    assert not self_intersects(np.repeat(closed, 3, axis=0))
    assert self_intersects(closed[[0, 2, 1, 3, 0]])
    assert self_intersects(scale * np.array([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2.0]]))
    assert not self_intersects(scale * lobes(0.9))
    assert not self_intersects(np.zeros((9, 2)))


@pytest.mark.parametrize(("polygon", "middle", "radius"), [
    (SQUARE, [0.5, 0.5], 0.5),
    (1e-9 * SQUARE + 1e-3, [1e-3 + 0.5e-9] * 2, 0.5e-9),
    (1e9 * SQUARE, [0.5e9, 0.5e9], 0.5e9),
    (np.array([[0, 0], [4, 0], [0, 3.0]]), [1.0, 1.0], 1.0),
    # It touches two sides of a corner and the corner opposite: (1 - r) sqrt 2 = r.
    (U_SHAPE, None, 2 - math.sqrt(2)),
    (SQUARE * [10, 1], None, 0.5),
    (np.tile([1.0, 2.0], (5, 1)), None, 0.0),
    (np.array([[0, 0], [1, 1], [2, 2.0]]), None, 0.0),
])  # fmt: skip
def test_inscribed_circles_equal_known_ones(polygon, middle, radius):
    result = inscribed_circle(polygon)
    assert result.radius == pytest.approx(radius, rel=1e-6)
    if middle is not None:
        assert np.allclose(result.middle, middle, rtol=0, atol=1e-6 * radius)


def test_azimuth_match_is_the_ray_where_it_is_unique():
    contour, middle = lobes(0.4) + [3.0, -2.0], np.array([3.0, -2.0])
    match = azimuth_match(contour, middle, AZIMUTHS)
    assert match.one_to_one and match.inside
    points = plane(AZIMUTHS, 1.0 + 0.4 * np.cos(3 * AZIMUTHS)) + middle
    assert np.allclose(match.points, points, rtol=0, atol=1e-5)
    aside = azimuth_match(contour, middle + [0.05, -0.02], AZIMUTHS).points - middle - [0.05, -0.02]
    assert np.allclose(turn_between(aside, plane(AZIMUTHS)), 0.0, rtol=0, atol=1e-5)
    for shift in (0, 1, 130, 399):
        listed = np.roll(contour, shift, axis=0)
        again = azimuth_match(listed, middle, AZIMUTHS + 4 * np.pi).points
        assert np.allclose(again, match.points, rtol=0, atol=1e-9)


def test_concave_contours_are_matched_in_order():
    contour = refined(U_SHAPE)
    outside, inside = area_centroid(U_SHAPE), inscribed_circle(U_SHAPE).middle
    assert winding_number(U_SHAPE, np.array([outside, inside])).tolist() == [0, 1]
    for middle in (outside, inside):
        match = azimuth_match(contour, middle, AZIMUTHS)
        assert match.inside == (middle is inside) and not match.one_to_one
        steps = np.mod(np.diff(match.turns, append=match.turns[0]), 1.0)
        assert (steps > 0.0).all() and steps.sum() == pytest.approx(1.0)
        assert np.allclose(edge_distance(U_SHAPE, match.points), 0.0, atol=1e-12)
        for shift in (1, 130, 399):
            again = azimuth_match(np.roll(contour, shift, axis=0), middle, AZIMUTHS).points
            assert np.allclose(again, match.points, rtol=0, atol=1e-9)
    # Below the circle a ray meets the outline once, not far from the match.
    down = azimuth_match(contour, inside, np.array([1.4 * np.pi])).points[0]
    assert abs(down[1]) < 1.0 and down[0] < inside[0] + 0.5


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_kernel_points_see_the_whole_polygon(scale):
    corner = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4.0]])
    place = kernel_point(scale * (corner + 7.0))
    assert place is not None and np.allclose(place / scale - 7.0, 0.5, rtol=0, atol=1e-7)
    box = scale * np.array([[0, 0], [2, 0], [2, 2], [2, 2], [0, 2.0]])
    assert np.allclose(kernel_point(box), scale, rtol=1e-9)
    clamp = [[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [4, 3], [4, 4], [0, 4.0]]
    assert kernel_point(scale * np.array(clamp)) is None
    assert kernel_point(np.full((4, 2), scale)) is None


NONE, NAN, ORIGIN = np.zeros((0, 2)), np.full((3, 2), math.nan), np.zeros((1, 2))


@pytest.mark.parametrize(("call", "words"), [
    (lambda: signed_area(NONE), "polygon must have at least 1 vertex, got 0"),
    (lambda: area_centroid(NONE), "polygon must have at least 1 vertex, got 0"),
    (lambda: edge_distance(NONE, ORIGIN), "polygon must have at least 1 vertex, got 0"),
    (lambda: winding_number(NONE, ORIGIN), "polygon must have at least 1 vertex, got 0"),
    (lambda: edge_distance(SQUARE, NAN), "points must be finite"),
    (lambda: winding_number(SQUARE, NAN), "points must be finite"),
    (lambda: self_intersects(NAN), "polygon must be finite"),
    (lambda: turn_between(SQUARE[1], NAN), "second must be finite"),
    (lambda: turn_between(np.zeros(3), ORIGIN), r"first must have shape \(..., 2\), got \(3,\)"),
    (lambda: inscribed_circle(SQUARE[:2]), "polygon must have at least 3 vertices, got 2"),
    (lambda: inscribed_circle(NAN), "polygon must be finite"),
    (lambda: azimuth_match(SQUARE[:2], ORIGIN[0], AZIMUTHS), "at least 3 vertices, got 2"),
    (lambda: azimuth_match(SQUARE, ORIGIN[0], NAN[:, 0]), "azimuths must be finite"),
    (lambda: azimuth_match(SQUARE, NAN[0], AZIMUTHS), "middle must be finite"),
])  # fmt: skip
def test_bad_input_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
