import numpy as np
import pytest

from palpate.core.geometry.polygons import edge_distance, winding_number
from palpate.core.splines.bases import PeriodicBasis, clamped_basis
from palpate.core.splines.closed_curves import fit_closed_curve
from palpate.core.splines.curve_fits import curve_parameters, moved_parameters
from palpate.core.thesis.layers import fit_closed_curve_thesis, rectangle_scale
from palpate.core.thesis.rebuilding import rebuild_thesis

ORDER, COUNT = 4, 16


def ellipse(turn):
    return np.column_stack([2 * np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)])


def circle(count):
    turn = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(turn), np.sin(turn)])


def pseudo_rows():
    """(4.31): the first three vertices come again as the last three."""
    total = COUNT + ORDER - 1
    return np.eye(3, total) - np.eye(3, total, COUNT)


def closing_rows():
    """Position, (4.32) and (4.33) at both ends of the clamped curve."""
    basis = clamped_basis(COUNT + ORDER - 1)
    ends = np.array([0.0, 1.0])
    rows = [basis.matrix(ends, order).toarray() for order in range(3)]
    return np.array([row[0] - row[1] for row in rows])


def solutions(rows):
    """Vertices (k, total) that all rows let be."""
    _, sizes, right = np.linalg.svd(rows)
    return right[(sizes > 1e-10).sum() :]


def test_the_closing_chord_is_lost_if_the_first_point_is_not_repeated():
    points = circle(10)
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    printed = np.concatenate([[0.0], np.cumsum(chords)]) / chords.sum()
    assert printed[-1] == 1.0  # the last point is where the first one is
    assert curve_parameters(points, "chord")[-1] == pytest.approx(0.9)


def test_pseudo_vertices_and_continuity_put_three_vertices_in_one_place():
    left = solutions(np.vstack([pseudo_rows(), closing_rows()]))
    assert len(left) > 0
    assert np.abs(left[:, 0] - left[:, 1]).max() < 1e-14
    assert np.abs(left[:, 0] - left[:, 2]).max() < 1e-14
    # Either demand alone leaves them free.
    for rows in (pseudo_rows(), closing_rows()):
        free = solutions(rows)
        assert np.abs(free[:, 0] - free[:, 1]).max() > 0.1


def test_the_fitted_curve_never_closes():
    points = ellipse(np.arange(81) / 80)
    printed = fit_closed_curve_thesis(points, COUNT)
    ours = fit_closed_curve(points, count=COUNT)
    size = float(np.ptp(points))
    assert printed.closure_gap > 0.05 * size
    assert ours.closure_gap < 1e-15 * size
    assert printed.condition > 500 * ours.condition


def test_the_vertices_are_as_many_as_the_columns():
    points, total = 81, COUNT + ORDER - 1
    system = np.zeros((points + ORDER + 1, total))  # N-hat of (4.37)
    zero_rows = ORDER + 1  # which (4.35) puts below the vertices
    with pytest.raises(ValueError, match="mismatch"):
        system @ np.zeros((total + zero_rows, 2))
    assert (system @ np.zeros((total, 2))).shape == (points + ORDER + 1, 2)


def test_the_sum_of_squares_is_compared_with_a_length():
    # (4.39) at two scales, against the tolerance: a share of the diameter.
    verdicts, right = [], []
    for scale in (1e-3, 1e3):
        open_by, tolerance = 0.05 * scale, 0.02 * scale
        verdicts.append(open_by**2 < tolerance)
        right.append(open_by < tolerance)
    assert verdicts == [True, False]
    assert right == [False, False]


def test_a_full_step_of_the_parameters_can_swap_points():
    # (4.40), beside a curve that is bent more than the points are apart.
    parameters = np.array([0.0, 0.02, 0.5])
    places = circle(3)
    slopes = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    points = places + [[0.0, 0.03], [0.0, -0.03], [0.0, 0.0]]
    printed = parameters + ((points - places) * slopes).sum(axis=1) / (slopes**2).sum(axis=1)
    assert printed[0] > printed[1]
    moved = moved_parameters(parameters, points, places, slopes)
    assert (np.diff(moved) > 0.0).all()


def test_contours_taken_for_control_layers_shrink_the_solid():
    def radius(height):
        return np.sqrt(1.04 - height**2) * (0.75 + 0.18 * np.sin(9 * height))

    basis = clamped_basis(27)
    rms = []
    for places in (np.linspace(0, 1, 27), basis.greville()):
        layers = radius(2 * places - 1)
        off = (basis.matrix(places) @ layers - layers) / 2.0  # over the solid's height
        rms.append(np.sqrt((off**2).mean()))
        right = np.linalg.solve(basis.matrix(places).toarray(), layers)
        assert np.allclose(basis.matrix(places) @ right, layers, rtol=0, atol=1e-12)
    # Contours at even heights, and at those where a control layer counts most.
    assert rms == pytest.approx([0.0233, 0.0051], abs=1e-4)


def test_a_round_polygon_read_with_clamped_knots_is_not_round():
    fitted = fit_closed_curve(circle(80), count=COUNT).control
    turns = np.arange(800) / 800
    round_ = np.linalg.norm(PeriodicBasis(COUNT).matrix(turns) @ fitted, axis=1)
    assert np.abs(round_ - 1.0).max() < 3e-4
    # A layer of 5 by 5 has 5 of the vertices on each of its sides.
    side = clamped_basis(5).matrix(turns) @ fitted[:5]
    radius = np.linalg.norm(side, axis=1)
    assert radius.max() > 1.015
    assert radius.min() < 0.99


def test_the_search_for_the_largest_ellipse_is_not_needed():
    # Table 4.2 tests two ellipses a step; the predicate is monotone, so that one would do.
    tolerance, golden = 1e-3, 0.6180339887
    low, high, two_points = tolerance, 1.0, 0
    while high - low > tolerance:
        first, second = high - golden * (high - low), low + golden * (high - low)
        two_points += 2
        low, high = (low, first) if first > 0.37 else (
            (first, second) if second > 0.37 else (second, high)
        )  # fmt: skip
    halvings = int(np.ceil(np.log2((1.0 - tolerance) / tolerance)))
    assert two_points > halvings == 10
    box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    assert edge_distance(box * [0.37, 1.0], np.zeros((1, 2))) == pytest.approx(0.37)


def test_the_box_around_an_ellipse_that_fits_does_not_fit():
    polygon, middle, half_sides = circle(96), np.zeros(2), np.ones(2)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    around_ellipse = edge_distance(polygon, middle[None])[0]
    fitting = rectangle_scale(polygon, middle, half_sides)
    assert around_ellipse == pytest.approx(np.sqrt(2.0) * fitting, rel=2e-3)
    assert (winding_number(polygon, around_ellipse * corners) == 0).all()
    assert (winding_number(polygon, 0.999 * fitting * corners) != 0).all()


def test_the_programs_lattice_knows_nothing_of_the_correspondence():
    ring = np.vstack([ellipse(np.arange(24) / 24), ellipse(np.zeros(1))])
    contours = [np.column_stack([(2 + z) * ring, np.full(25, z)]) for z in np.linspace(-1, 1, 7)]
    box, ball = (
        rebuild_thesis(contours, exponents=exponents, faithful=True)
        for exponents in ((0.15, 0.15), (1.0, 1.0))
    )
    assert np.abs(box.parameters - ball.parameters).max() > 0.05
    assert (box.lattice.control == ball.lattice.control).all()
