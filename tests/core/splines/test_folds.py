import numpy as np
import pytest

from palpate.core.splines.bases import Basis, averaged_knots, clamped_basis
from palpate.core.splines.lattices import Lattice, box_lattice, fold_report
from palpate.core.splines.spline_volumes import (
    Parallelepiped,
    SplineVolume,
    determinant_pieces,
    slope_determinant,
    subdivide,
)

LOW, EXTENT = np.array([1.0, -2.0, 0.5]), np.array([0.5, 0.25, 2.0])
AXES = np.linspace(0, 1, 30), np.linspace(0, 1, 31), np.linspace(0, 1, 32)


def lattice(counts=(5, 4, 6), degree=3):
    return box_lattice(LOW, EXTENT, counts, degree)


def disturbed(amount, seed, weighted=False):
    """Each control point moves by that share of the way to its neighbours, about."""
    plain, rng = lattice(), np.random.default_rng(seed)
    noise = amount * EXTENT / np.array([4, 3, 5]) * rng.normal(size=plain.control.shape)
    weights = rng.uniform(0.5, 2.0, (5, 4, 6)) if weighted else None
    return plain.with_control(plain.control + noise, weights)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_coefficients_of_every_piece_enclose_the_determinant(degree, weighted):
    counts = (degree + 1, degree + 3, degree + 2)
    plain, rng = box_lattice(np.zeros(3), np.ones(3), counts, degree), np.random.default_rng(0)
    weights = rng.uniform(0.5, 2.0, counts) if weighted else None
    volume = plain.with_control(rng.normal(size=plain.control.shape), weights).volume
    for layer in determinant_pieces(volume):
        for pieces in (layer, subdivide(layer)):
            for low, width, found in zip(*pieces[:3], strict=True):
                axes = low[:, None] + width[:, None] * np.linspace(0.0, 1.0, 5)
                axes = np.clip(axes, low[:, None] + 1e-12, low[:, None] + width[:, None] - 1e-12)
                values = slope_determinant(volume, *axes)
                if weights is not None:
                    values = values * weight_of(volume, axes) ** 4
                slack = 1e-9 * np.abs(values).max()
                assert found.min() <= values.min() + slack
                assert found.max() >= values.max() - slack
                ends = found[np.ix_([0, -1], [0, -1], [0, -1])]
                corners = values[np.ix_([0, -1], [0, -1], [0, -1])]
                assert np.allclose(ends, corners, rtol=0, atol=1e-7 * np.abs(values).max())


def weight_of(volume, axes):
    s, t, u = (b.matrix(x).toarray() for b, x in zip(volume.bases, axes, strict=True))
    assert volume.weights is not None
    return np.asarray(np.einsum("abc,sa,tb,uc->stu", volume.weights, s, t, u))


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_verdict_is_never_contradicted_by_samples(seed, weighted):
    for amount in (0.05, 0.15, 0.3):
        found = disturbed(amount, seed, weighted)
        report = fold_report(found)
        least = found.change_on_grid(*AXES).min()
        assert (report.verdict == "sound") <= (least > 0.0)
        assert report.verdict != "undecided"
        there = found.change_on_grid(*report.where[:, None])[0, 0, 0]
        assert there == pytest.approx(report.least, rel=1e-9, abs=1e-12)
        assert (report.verdict == "folded") == (report.least < 0.0)


def test_an_undeformed_lattice_is_sound_and_changes_no_volume():
    report = fold_report(lattice())
    assert report.verdict == "sound"
    assert report.least == pytest.approx(1.0)
    assert report.share == 0.0


def test_a_lattice_whose_frame_is_left_handed_is_sound():
    plain = lattice()
    before = SplineVolume(plain.control * [-1, 1, 1], plain.volume.bases)
    assert fold_report(Lattice(before, before)).verdict == "sound"
    assert fold_report(Lattice(plain.volume, before)).verdict == "folded"


@pytest.mark.parametrize("scale", [1e-150, 1e150])
@pytest.mark.parametrize("amount", [0.05, 0.3])
def test_the_unit_changes_no_report(scale, amount):
    here = disturbed(amount, 0)
    plain = box_lattice(np.zeros(3), scale * EXTENT, (5, 4, 6))
    before = SplineVolume(plain.control, plain.volume.bases)
    wanted = fold_report(here)
    moved = plain.control + scale * (here.control - lattice().control)
    for undeformed in (plain.undeformed, before):
        found = fold_report(Lattice(SplineVolume(moved, plain.volume.bases), undeformed))
        assert found.verdict == wanted.verdict
        assert found.share == wanted.share
        assert found.least == pytest.approx(wanted.least, rel=1e-9)


def test_a_mirrored_lattice_is_folded_everywhere():
    report = fold_report(lattice().with_control(lattice().control[::-1]))
    assert report.verdict == "folded"
    assert report.share == 1.0
    assert report.least == pytest.approx(-1.0)


def test_a_fold_that_no_sample_sees_is_found():
    control = lattice().control.copy()
    control[0, 0, 0] += 1.2 * (control[1, 0, 0] - control[0, 0, 0])  # past its neighbour
    report = fold_report(lattice().with_control(control))
    assert report.verdict == "folded"
    assert report.where.tolist() == [0.0, 0.0, 0.0]
    assert report.least < 0.0
    assert report.share < 0.001


def test_a_lattice_that_is_flat_at_a_face_is_neither_sound_nor_folded():
    control = lattice().control.copy()
    control[:, :, 0] = control[:, :, 1]  # the slope along u vanishes there
    report = fold_report(lattice().with_control(control))
    assert report.verdict == "undecided"
    assert report.least == pytest.approx(0.0, abs=1e-12)


def test_the_share_is_that_of_the_points_given():
    control = lattice().control.copy()
    control[..., 2] = np.abs(control[..., 2] - 1.5)  # the lower half turned over the upper
    folded = lattice().with_control(control)
    below, above = (LOW + EXTENT * np.array([[0.5, 0.5, u]]) for u in (0.1, 0.9))
    assert fold_report(folded, below).share == 1.0
    assert fold_report(folded, above).share == 0.0
    report = fold_report(folded, np.concatenate([below, above, above]))
    assert report.share == pytest.approx(1 / 3)
    assert report.verdict == "folded"
    assert fold_report(folded, np.zeros((0, 3))).share == 0.0


def test_the_report_is_the_same_in_any_unit():
    for amount in (0.1, 0.3):
        here = disturbed(amount, 1)
        scaled = box_lattice(1e-3 * LOW, 1e-3 * EXTENT, (5, 4, 6))
        there = fold_report(scaled.with_control(1e-3 * here.control))
        report = fold_report(here)
        assert there.verdict == report.verdict
        assert there.least == pytest.approx(report.least, rel=1e-6, abs=1e-9)


def test_points_outside_are_refused():
    with pytest.raises(ValueError, match="points must lie in the lattice"):
        fold_report(lattice(), np.zeros((1, 3)))


def test_where_rounding_hides_the_sign_nothing_is_claimed():
    plain = box_lattice(np.zeros(3), np.ones(3), (7, 7, 7), 6)
    report = fold_report(plain)
    assert report.verdict == "undecided"
    assert report.least == pytest.approx(1.0)
    assert fold_report(plain.with_control(plain.control[::-1])).verdict == "undecided"


def test_the_functions_sum_to_one_at_the_last_knot():
    for degree in (1, 2, 3, 5):
        basis = clamped_basis(degree + 4, degree)
        ends = basis.matrix(np.array([0.0, 1.0])).toarray()
        assert np.array_equal(ends, np.eye(degree + 4)[[0, -1]])
        slopes = basis.matrix(np.array([1.0]), 1) @ basis.greville()
        assert slopes[0] == pytest.approx(1.0, abs=1e-14)


def test_a_place_outside_by_rounding_is_the_end_and_by_more_is_refused():
    basis = clamped_basis(6)
    just_outside = np.array([-1e-16, 1.0 + 2.3e-16])
    assert np.array_equal(basis.matrix(just_outside).toarray(), np.eye(6)[[0, -1]])
    for outside in (-0.1, 1.1, -1e-9):
        with pytest.raises(ValueError, match="x must lie in the domain from 0 to 1, got 1 outside"):
            basis.matrix(np.array([0.5, outside]))
    large = Basis(1e9 * basis.knots, 3)
    assert large.matrix(np.array([1e9 + 1e-6])).toarray()[0, -1] == 1.0
    with pytest.raises(ValueError, match="x must lie in the domain"):
        large.matrix(np.array([1e9 + 1.0]))


def test_at_a_knot_of_full_multiplicity_the_right_limit_is_taken_without_a_nan():
    basis = Basis(np.array([0, 0, 0, 0, 0.5, 0.5, 0.5, 0.5, 1, 1, 1, 1]), 3)
    for order in range(4):
        here, right = basis.matrix(np.array([0.5, 0.5 + 1e-13]), order).toarray()
        assert np.isfinite(here).all()
        assert np.allclose(here, right, rtol=1e-11, atol=1e-9)
    here, left = basis.matrix(np.array([0.5, 0.5 - 1e-13])).toarray()
    assert np.argmax(here) == 4
    assert np.argmax(left) == 3  # the curve jumps there


def test_the_highest_derivative_is_piecewise_constant_and_those_above_are_0():
    basis = clamped_basis(7, 3)
    x = np.array([0.01, 0.1, 0.2, 0.26, 0.49, 0.99, 1.0])
    third = basis.matrix(x, 3).toarray()
    assert np.isfinite(third).all()
    assert np.allclose(third[0], third[1], rtol=1e-12)
    assert np.allclose(third[3], third[4], rtol=1e-12)
    assert np.allclose(third[5], third[6], rtol=1e-12)
    assert np.abs(third[2] - third[3]).max() > 1.0
    for order in (4, 5, 9):
        assert not basis.matrix(x, order).toarray().any()


def test_averaged_knots_rise_and_their_system_has_a_condition_of_4():
    sites = np.linspace(0.0, 1.0, 9)
    basis = Basis(averaged_knots(sites, 3), 3)
    assert (np.diff(basis.knots) >= 0.0).all()
    assert np.linalg.cond(basis.matrix(sites).toarray()) == pytest.approx(4.1, abs=0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_lattice_without_length_along_an_edge_is_refused(axis):
    edges = np.eye(3)
    edges[axis] = 0.0
    with pytest.raises(ValueError, match="edges must have a length"):
        Parallelepiped(np.zeros(3), edges)


@pytest.mark.parametrize(("weight", "words"), [(0.0, "got 0"), (-1.0, "got -1")])
def test_weights_that_are_zero_or_negative_are_refused(weight, words):
    bases = clamped_basis(4), clamped_basis(4), clamped_basis(4)
    weights = np.ones((4, 4, 4))
    weights[1, 2, 3] = weight
    with pytest.raises(ValueError, match=f"weights must be positive, {words}"):
        SplineVolume(np.zeros((4, 4, 4, 3)), bases, weights)
