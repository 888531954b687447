import numpy as np
import pytest
from scipy.interpolate import BSpline

from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.splines.bases import Basis, clamped_basis, clamped_knots, uniform_knots
from palpate.core.splines.spline_volumes import Parallelepiped

ALPHA = 0.3
POINTS = np.random.default_rng(0).uniform(-1, 1, (500, 3))


def printed_bend(points, k, angle, inwards):
    """(2.8) and (2.9) with an angle and a coordinate r."""
    radius = 1.0 / k - np.cos(angle) * (1.0 / k - inwards)
    x = points[:, 0] + np.cos(ALPHA) * (radius - inwards)
    y = points[:, 1] + np.sin(ALPHA) * (radius - inwards)
    return np.column_stack([x, y, np.sin(angle) * (1.0 / k - inwards)])


def test_the_inverse_of_a_taper_is_singular_where_a_section_vanishes():
    with np.errstate(divide="ignore"):
        assert np.isinf(np.float64(1.0) / (-1.0 / 1.0 * 1.0 + 1.0))
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        Taper(-1.0, 0.0, 1.0)
    taper = Taper(-0.999, 0.5, 1.0)
    assert np.allclose(taper.inverse(taper(POINTS)), POINTS, rtol=0, atol=1e-12)


def test_the_angle_of_a_bend_is_height_times_curvature():
    height, k = np.linspace(-1, 1, 2001), 0.5
    axis = np.column_stack([np.zeros((2001, 2)), height])
    printed = printed_bend(axis, k, height / k, np.zeros(2001))
    lengths = [
        np.linalg.norm(np.diff(bent, axis=0), axis=1).sum()
        for bent in (printed, Bend(k, ALPHA)(axis))
    ]
    assert lengths == pytest.approx([8.0, 2.0], rel=1e-5)


def test_the_arc_tangent_of_y_over_x_turns_half_of_the_points_round():
    x, y = -0.5, 0.2
    printed = np.cos(ALPHA - np.arctan(y / x)) * np.hypot(x, y)
    right = x * np.cos(ALPHA) + y * np.sin(ALPHA)
    assert printed == pytest.approx(0.4186, abs=5e-5)
    assert right == pytest.approx(-0.4186, abs=5e-5)
    found = Bend(1e-3, ALPHA).unbend(np.array([x, y]) @ Bend(1.0, ALPHA).towards, np.zeros(1))
    assert found.inwards == pytest.approx(right, rel=1e-12)


def test_one_over_the_curvature_loses_all_digits_as_it_vanishes():
    inwards = POINTS[:, :2] @ [np.cos(ALPHA), np.sin(ALPHA)]
    errors = []
    for k in (1e-9, 1e-16):
        printed = printed_bend(POINTS, k, k * POINTS[:, 2], inwards)
        errors.append(np.abs(printed - Bend(k, ALPHA)(POINTS)).max())
    assert 1e-8 < errors[0] < 1e-6
    assert errors[1] > 0.5
    for k in (0.0, 1e-300, 1e-16, 1e-9, 1e-3, 0.6, -0.6):
        bend = Bend(k, ALPHA)
        assert np.allclose(bend.inverse(bend(POINTS)), POINTS, rtol=0, atol=2e-15)


def test_a_bend_is_undone_before_the_taper_that_came_first():
    taper, bend = Taper(0.5, -0.4, 1.0), Bend(0.4, ALPHA)
    moved = bend(taper(POINTS))
    assert np.allclose(taper.inverse(bend.inverse(moved)), POINTS, rtol=0, atol=1e-14)
    swapped = bend.inverse(taper.inverse(moved))
    assert np.abs(swapped - POINTS).max() > 0.2


def test_lattice_coordinates_are_in_edges_not_in_unit_vectors():
    edges, middle = np.diag([4.0, 2.0, 1.0]), np.array([[2.0, 0.0, 0.0]])
    units = edges / np.linalg.norm(edges, axis=1, keepdims=True)
    s, t, u = units
    assert np.cross(t, u) @ middle[0] / (np.cross(t, u) @ s) == 2.0
    assert Parallelepiped(np.zeros(3), edges).local(middle)[0, 0] == 0.5


def test_a_bernstein_curve_of_degree_n_has_one_vertex_more():
    degree = 5
    assert clamped_basis(degree + 1, degree).count == degree + 1
    x = np.linspace(0, 1, 7)
    all_of_them = clamped_basis(degree + 1, degree).matrix(x).toarray()
    assert np.allclose(all_of_them.sum(axis=1), 1.0, atol=1e-15)
    assert np.abs(all_of_them[:, :degree].sum(axis=1) - 1.0).max() == pytest.approx(1.0)


def half_open(i, order, t, x):
    """The recursion of section 2.4.2 as printed, 0 / 0 being 0."""
    if order == 1:
        return float(x[i] <= t < x[i + 1])
    total = 0.0
    if x[i + order - 1] > x[i]:
        total += (t - x[i]) * half_open(i, order - 1, t, x) / (x[i + order - 1] - x[i])
    if x[i + order] > x[i + 1]:
        total += (x[i + order] - t) * half_open(i + 1, order - 1, t, x) / (x[i + order] - x[i + 1])
    return total


def test_the_recursion_leaves_nothing_at_the_last_knot():
    knots = clamped_knots(7)
    assert sum(half_open(i, 4, 1.0, knots) for i in range(7)) == 0.0
    assert sum(half_open(i, 4, 0.4, knots) for i in range(7)) == pytest.approx(1.0)
    assert clamped_basis(7).matrix(np.array([1.0])).sum() == 1.0


def test_the_printed_knots_do_not_end_at_one():
    # (2.21) for n + 1 = 7 vertices and order k = 4.
    n, k = 6, 4
    printed = [0] * k + [i - k for i in range(k + 1, n + 2)] + [n - k + 2] * k
    assert (printed[0], printed[-1]) == (0, 4)
    assert np.allclose(np.array(printed) / printed[-1], clamped_knots(n + 1))


def test_unclamped_knots_carry_a_basis_only_between_their_inner_ones():
    # Figure 2.7 (b): 11 even knots from 0 to 1 and 7 functions.
    knots = np.linspace(0, 1, 11)
    sums = [sum(half_open(i, 4, t, knots) for i in range(7)) for t in (0.1, 0.5)]
    assert sums == pytest.approx([1 / 6, 1.0])
    assert Basis(knots, 3).domain == pytest.approx((0.3, 0.7))
    assert Basis(uniform_knots(7), 3).domain == (0.0, 1.0)
    with pytest.raises(ValueError, match="must lie in the domain"):
        Basis(knots, 3).matrix(np.array([0.1]))
    assert BSpline(knots, np.ones(7), 3)(0.5) == pytest.approx(1.0)
