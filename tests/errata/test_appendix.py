import math

import numpy as np
import pytest

from palpate.core.explore.planners.protocol import Observation, first_and_last
from palpate.core.geometry.polygons import (
    edge_distance,
    inscribed_circle,
    turn_between,
    winding_number,
)


def ellipse_scale(polygon, middle, semi_axes):
    """Of the largest ellipse of that shape: in its own plane the distance from the edges."""
    around, origin = (polygon - middle) / semi_axes, np.zeros((1, 2))
    return float(edge_distance(around, origin)[0]) if winding_number(around, origin)[0] else 0.0


def line_meets(line, p, q):
    """isint.m, with the ellipse at the origin."""
    a, b, c = line
    if a == 0:
        return q >= abs(-c / b)
    if b == 0:
        return p >= abs(-c / a)
    return q * q * b * b + p * p * a * a >= c * c


def test_the_search_moves_on_from_places_that_it_has_not_tested():
    fib = [1.0, 1.0]
    while len(fib) < 50:
        fib.append(fib[-1] + fib[-2])

    def printed(limit):
        a, b, count = 1e-3, 1.0, 1
        while abs(b - a) > 1e-3 and count < 48:
            first, second = a > limit, b > limit  # tested at a and b
            a1 = a + fib[50 - count - 2] / fib[50 - count] * (b - a)
            b1 = a + fib[50 - count - 1] / fib[50 - count] * (b - a)
            if first and second:
                b = a1
            elif second:
                a, b = a1, b1  # moved to a1 and b1
            elif not first:
                a = b1
            count += 1
        return 0.5 * (a + b)

    limits = np.linspace(0.05, 0.95, 19)
    assert max(abs(printed(x) - x) for x in limits) > 0.3
    for limit in limits:
        box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * [limit, 1.0]
        assert ellipse_scale(box, np.zeros(2), np.ones(2)) == pytest.approx(limit)


def test_all_edges_are_tested_and_not_as_many_as_the_grid_is_wide():
    turn = 2 * np.pi * np.arange(16) / 16  # 16 vertices around a layer of 5 by 5
    radius = np.where(np.arange(16) == 10, 0.3, 1.0)
    polygon = radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    along = np.roll(polygon, -1, axis=0) - polygon

    def blocked(edges):
        return any(
            line_meets((dy, -dx, dx * y - dy * x), 0.5, 0.5)
            for (x, y), (dx, dy) in zip(polygon[:edges], along[:edges], strict=True)
        )

    assert not blocked(5)
    assert blocked(16)
    assert ellipse_scale(polygon, np.zeros(2), np.full(2, 0.5)) == pytest.approx(0.6)


def test_the_normal_of_an_edge_has_a_minus():
    (x, y), (dx, dy) = (1.0, 0.0), (-1.0, 1.0)  # an edge on x + y = 1
    printed = (dy, dx, dx * y - dy * x)  # as buildgrid.m hands it on
    right = (dy, -dx, dx * y - dy * x)
    for share in (0.0, 0.5, 1.0):
        place = np.array([x + share * dx, y + share * dy, 1.0])
        assert np.dot(right, place) == pytest.approx(0.0)
    assert np.dot(printed, [x + dx, y + dy, 1.0]) == pytest.approx(-2.0)


def test_the_comment_on_the_conic_has_its_axes_swapped():
    # Semi-axes 2 along x and 1 along y; the line y = 1.5 passes above.
    p, q = 2.0, 1.0
    assert not line_meets((0.0, 1.0, -1.5), p, q)
    height_of_comment = p  # p^2 x^2 + q^2 y^2 = (pq)^2 reaches y = p
    assert height_of_comment > 1.5
    box = np.array([[-3, -1.5], [3, -1.5], [3, 1.5], [-3, 1.5]])
    assert ellipse_scale(box, np.zeros(2), np.array([p, q])) == 1.5


def test_lines_beyond_the_edges_cut_an_ellipse_that_the_edges_do_not():
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    polygon = (1 + 0.45 * np.cos(3 * turn))[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, axes = 0.5 * (low + high), 0.5 * (high - low)
    around = (polygon - middle) / axes
    along = np.roll(around, -1, axis=0) - around
    lines = [(dy, -dx, dx * y - dy * x) for (x, y), (dx, dy) in zip(around, along, strict=True)]
    scales = np.linspace(0, 1, 2001)
    free = [s for s in scales if not any(line_meets(line, s, s) for line in lines)]
    assert max(free) == pytest.approx(0.168, abs=1e-3)
    assert ellipse_scale(polygon, middle, axes) == pytest.approx(0.399, abs=1e-3)


def test_the_middle_of_the_box_may_lie_outside_the_polygon():
    u_shape = np.array(
        [[-1, 1], [-1, -1], [1, -1], [1, 1], [0.8, 1], [0.8, -0.8], [-0.8, -0.8], [-0.8, 1.0]]
    )
    assert winding_number(u_shape, np.zeros((1, 2)))[0] == 0
    along = np.roll(u_shape, -1, axis=0) - u_shape
    lines = [(dy, -dx, dx * y - dy * x) for (x, y), (dx, dy) in zip(u_shape, along, strict=True)]
    free = [s for s in np.linspace(0, 1, 401) if not any(line_meets(one, s, s) for one in lines)]
    assert max(free) == pytest.approx(0.8, abs=0.005)
    assert ellipse_scale(u_shape, np.zeros(2), np.ones(2)) == 0.0
    circle = inscribed_circle(u_shape)
    assert winding_number(u_shape, circle.middle[None])[0] == 1
    assert circle.radius > 0.1


def test_an_angle_needs_no_matrix():
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(np.zeros((2, 2)))  # phasediff.m, with a vertex in the middle
    first, second = np.random.default_rng(0).normal(size=(2, 50, 2))
    blocks = np.zeros((100, 100))
    for row, (x, y) in enumerate(first):
        blocks[2 * row : 2 * row + 2, 2 * row : 2 * row + 2] = [[x, -y], [y, x]]
    solved = np.linalg.inv(blocks) @ second.ravel()
    printed = np.arctan2(solved[1::2], solved[::2])
    assert np.allclose(turn_between(first, second), printed, rtol=0, atol=1e-12)
    assert np.isfinite(turn_between(np.zeros(2), second)).all()


def test_a_quadrant_is_taken_about_the_middle_and_not_about_the_origin():
    first_vertex, middle = np.array([-0.5, 0.1]), np.array([0.0, 0.0])
    quadrants = []
    for shift in (0.0, 500.0):
        x, y = first_vertex + shift
        quadrants.append(abs(math.atan2(y, x)) > math.pi / 2)
    assert quadrants == [True, False]  # one contour, felt 500 mm further on
    right = [
        abs(turn_between(np.array([1.0, 0.0]), first_vertex + s - (middle + s))) > math.pi / 2
        for s in (0.0, 500.0)
    ]
    assert right == [True, True]


def test_the_models_contours_leave_out_its_ends():
    latitude = np.arctan2(np.linspace(-1, 1, 27), 1.0)
    assert np.sin(latitude).max() == pytest.approx(0.7071, abs=1e-4)  # of a ball of radius 1
    even = np.linspace(-1, 1, 27)
    assert even.max() == 1.0


def test_the_program_takes_a_box_for_every_object():
    def heights(exponents):
        e1, e2 = exponents
        omega, eta = np.linspace(-np.pi, np.pi, 81), math.pi / 4
        x, y = np.abs(np.cos(eta) * np.cos(omega)), np.abs(np.cos(eta) * np.sin(omega))
        level = (x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1)
        return np.asarray((level + math.sin(eta) ** (2 / e1)) ** (-e1 / 2) * math.sin(eta))

    assert np.ptp(heights((0.15, 0.15))) > 0.03  # no plane curve, yet paired with a plane contour
    assert np.ptp(heights((1.0, 1.0))) < 1e-15


def test_the_caps_depend_on_the_unit_of_length():
    # Half of 0.02 beyond the last contour, of one object 100 mm high in mm and in m.
    printed = 0.01 / np.array([100.0, 0.1])
    assert printed.tolist() == pytest.approx([1e-4, 0.1])
    # Slices at 3 and 97 % of the height leave 3 % of it, in either unit.
    left = []
    for top in (100.0, 0.1):
        share = 2e-3 * top
        known = Observation(low=0.0, high=top, tolerance=share, resolution=share, feature=share)
        left.append(1.0 - first_and_last(known)[1] / top)
    assert left == pytest.approx([0.03, 0.03])
