import numpy as np
import pytest

from palpate.core.geometry.polygons import area_centroid, azimuth_match
from palpate.core.splines.bases import Basis, averaged_knots, clamped_basis
from palpate.core.splines.inversion import invert_general, invert_points
from palpate.core.splines.lattices import box_lattice
from palpate.core.splines.spline_volumes import SplineVolume

COUNTS = (5, 5, 6)


def ring(count):
    turn = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(turn), np.sin(turn)])


def undeformed():
    return box_lattice(np.full(3, -1.0), np.full(3, 2.0), COUNTS).volume


def deformed(noise):
    volume = undeformed()
    moved = volume.control + noise * np.random.default_rng(0).normal(size=volume.control.shape)
    return SplineVolume(moved, volume.bases)


def test_inner_slicing_planes_are_not_those_that_include_the_ends():
    count = 27
    inner = np.linspace(-1, 1, count + 2)[1:-1]  # step 4a: count + 1 intervals
    with_ends = np.linspace(-1, 1, count)  # the program
    assert np.abs(inner - with_ends).max() == pytest.approx(2 / (count + 1))


@pytest.mark.parametrize(("count", "bias"), [(81, 0.0123), (41, 0.0244)])
def test_the_mean_of_a_closed_contour_counts_its_first_point_twice(count, bias):
    closed = np.vstack([ring(count - 1), ring(count - 1)[:1]])
    assert np.linalg.norm(closed.mean(axis=0)) == pytest.approx(bias, abs=1e-4)
    assert np.linalg.norm(area_centroid(closed)) < 1e-15


def test_the_mean_of_uneven_points_lies_where_they_are_dense():
    turn = np.concatenate([np.linspace(0, 0.25, 60, False), np.linspace(0.25, 1, 20, False)])
    points = np.column_stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)])
    assert np.linalg.norm(points.mean(axis=0)) > 0.5
    assert np.linalg.norm(area_centroid(points)) < 0.01


def test_a_ray_from_the_middle_does_not_always_meet_a_contour_once():
    turn = np.linspace(-2.2, 2.2, 400)
    arc = np.column_stack([np.cos(turn), np.sin(turn)])
    contour = np.vstack([arc, 0.7 * arc[::-1]])  # a C, with its middle outside
    azimuths = np.linspace(0, 2 * np.pi, 50, endpoint=False) + 0.01
    rays = np.column_stack([-np.sin(azimuths), np.cos(azimuths)]) @ contour.T
    ahead = np.column_stack([np.cos(azimuths), np.sin(azimuths)]) @ contour.T > 0.0
    meetings = ((np.roll(rays, -1, axis=1) >= 0.0) != (rays >= 0.0)) & ahead
    assert set(meetings.sum(axis=1)) == {0, 2}
    match = azimuth_match(contour, np.zeros(2), azimuths)
    assert not match.inside
    assert np.isfinite(match.points).all()


def test_the_sum_of_the_single_index_has_as_many_terms_as_control_points():
    volume = undeformed()
    shares = volume.shares(np.random.default_rng(0).random((20, 3))).toarray()
    assert shares.shape[1] == np.prod(COUNTS)  # M of (4.3); its second sum stops at N
    assert np.allclose(shares.sum(axis=1), 1.0, atol=1e-14)
    assert np.abs(shares[:, : COUNTS[2]].sum(axis=1) - 1.0).max() > 0.9


def test_the_matrix_of_newtons_method_holds_products_of_slopes():
    volume, target = deformed(0.1), np.array([0.1, 0.2, -0.1])
    at = np.array([0.4, 0.55, 0.6])

    def gradient(parameters):
        place, slopes = volume.first(parameters[None])
        return np.asarray(slopes[0].T @ (place[0] - target))

    place, slopes, bends = volume.second(at[None])
    off = place[0] - target
    right = slopes[0].T @ slopes[0] + np.einsum("i,ijk->jk", off, bends[0])
    step = 1e-5
    for axis in range(3):
        ahead, back = (at + sign * step * np.eye(3)[axis] for sign in (1, -1))
        change = (gradient(ahead) - gradient(back)) / (2 * step)
        assert np.allclose(right[:, axis], change, rtol=1e-6, atol=1e-6)
    # Of the product in the second row, (4.9) prints one factor: a vector beside numbers.
    printed = slopes[0][:, 1] + off @ bends[0][:, 1, 0]
    assert printed.shape == (3,)
    assert right[1, 0].shape == ()


def test_the_equations_of_right_angles_square_the_condition_and_have_false_roots():
    volume = undeformed()
    flat = SplineVolume(volume.control * [1.0, 1.0, 1e-6], volume.bases)
    slopes = flat.first(np.full((1, 3), 0.4))[1][0]
    assert np.linalg.cond(slopes.T @ slopes) > 1e5 * np.linalg.cond(slopes)
    # Outside, the nearest face point is at right angles, but no answer.
    outside = invert_points(volume, np.array([[0.3, 0.2, 1.5]]))
    assert not outside.converged[0]
    assert outside.residual[0] == pytest.approx(0.5)


def test_the_cosine_is_nothing_over_nothing_where_the_point_is_met():
    slope, off = np.array([1.0, 0.0, 0.0]), np.zeros(3)
    with np.errstate(invalid="ignore"):
        assert np.isnan(abs(slope @ off) / (np.linalg.norm(slope) * np.linalg.norm(off)))
    volume = undeformed()
    found = invert_points(volume, volume.at(np.full((1, 3), 0.3)))
    assert found.converged[0]
    assert found.steps[0] == 0


def test_tolerances_in_metres_depend_on_the_unit():
    # (4.14) and (4.16) with the program's 1e-6, at a lattice of a micrometre and of a kilometre.
    volume = deformed(0.1)
    points = volume.at(np.random.default_rng(1).uniform(0.1, 0.9, (30, 3)))
    steps = []
    for scale in (2.0**-30, 1.0, 2.0**30):
        scaled = SplineVolume(scale * volume.control, volume.bases)
        found = invert_general(scaled, scale * points)
        steps.append(found.steps)
        middle = scaled.at(np.full((1, 3), 0.5))
        passes = np.linalg.norm(middle - scale * points, axis=1) <= 1e-6
        assert passes.all() == (scale < 1e-6)  # at once, anywhere, if all is that small
        assert found.converged.all()
    assert np.array_equal(steps[0], steps[1])
    assert np.array_equal(steps[1], steps[2])


def test_points_that_are_all_equal_have_no_centripetal_parameters():
    steps = np.zeros(5)
    with np.errstate(invalid="ignore"):
        assert np.isnan(np.sqrt(steps) / np.sqrt(steps).sum()).all()  # (4.18), on a pole's row


def test_inner_knots_average_as_many_parameters_as_the_degree():
    count, order = 9, 4
    sites = np.linspace(0, 1, count)

    def knots(first):
        inner = [
            sum(sites[at + i - 1] for i in range(first or at, order)) / (order - 1)
            for at in range(1, count - order + 1)
        ]
        return np.array([0.0] * order + inner + [1.0] * order)

    printed = knots(None)  # the sum of (4.19) begins at i = l
    assert printed[4:9] == pytest.approx([0.25, 0.2917, 0.2083, 0.0, 0.0], abs=1e-4)
    assert (np.diff(printed) < 0.0).any()
    assert np.allclose(averaged_knots(sites), knots(1))
    system = Basis(averaged_knots(sites), 3).matrix(sites).toarray()
    assert np.linalg.cond(system) == pytest.approx(4.1, abs=0.1)
    as_printed = np.sort(printed)
    assert (as_printed[:6] == 0.0).all()  # six equal knots of order 4: two functions are nothing


def test_no_spline_is_needed_for_what_is_known_in_closed_form():
    volume = undeformed()
    points = np.random.default_rng(0).uniform(-1, 1, (1000, 3))
    found = invert_points(volume, points)
    assert found.residual.max() < 1e-15
    assert np.allclose(found.parameters, 0.5 * (points + 1.0), rtol=0, atol=1e-15)
    # Section 4.3 interpolates such parameters over a grid, and clips what overshoots.
    corner = np.clip(np.linspace(-2, 2, 15), 0.0, 1.0)
    sites = np.linspace(0, 1, 15)
    basis = clamped_basis(15)
    system = basis.matrix(basis.greville()).toarray()
    values = np.linalg.solve(system, np.interp(basis.greville(), sites, corner))
    assert (basis.matrix(np.linspace(0, 1, 400)) @ values).max() > 1.001
