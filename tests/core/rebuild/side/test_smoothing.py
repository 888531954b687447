from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.side.smoothing import (
    DECAY,
    FEW,
    LEAST_DECAY,
    LEAST_TRUST,
    MOST_DECAY,
    BetweenContours,
    Smoothed,
    SmoothingAxis,
    bending_along,
    bending_around,
    between_contours,
    smooth,
    smoothing_axis,
)
from palpate.core.splines.bases import Basis, PeriodicBasis, clamped_basis

LINES, TURNS = 15, 24


def bases(count: int = LINES) -> tuple[Basis, PeriodicBasis]:
    return clamped_basis(count), PeriodicBasis(TURNS)


def axes(weights: Floats | None = None, count: int = LINES) -> tuple[SmoothingAxis, SmoothingAxis]:
    along, around = bases(count)
    places = np.linspace(0.0, 1.0, LINES)
    return (
        smoothing_axis(along.matrix(places).toarray(), bending_along(along), weights),
        smoothing_axis(around.matrix(np.arange(TURNS) / TURNS).toarray(), bending_around(TURNS)),
    )


def wavy() -> Floats:
    z, t = np.linspace(0.0, 1.0, LINES)[:, None], 2 * np.pi * np.arange(TURNS) / TURNS
    radius = (1.0 + 0.3 * np.sin(4.0 * z)) * (1.0 + 0.1 * np.cos(2.0 * t))
    return np.stack([radius * np.cos(t), radius * np.sin(t)], axis=-1)


def dense(smoothed: Smoothed) -> Floats:
    """The smoother as one matrix, by solving along and around."""
    matrices = []
    for axis, strength in zip((smoothed.along, smoothed.around), smoothed.strengths, strict=True):
        modes = axis.modes
        basis = modes.shapes @ np.linalg.pinv(modes.control)
        scale = np.trace(basis.T @ basis) / basis.shape[1]
        system = basis.T @ basis / scale + strength * axis.bending
        matrices.append(basis @ np.linalg.solve(system, basis.T / scale))
    return np.asarray(np.kron(*matrices))


def test_the_fit_the_freedom_and_the_score_are_those_of_the_whole_system():
    values = wavy() + 0.01 * np.random.default_rng(0).normal(size=(LINES, TURNS, 2))
    found = smooth(values, *axes(count=12))
    whole = dense(found)
    flat = values.reshape(-1, 2)
    assert np.allclose(found.fitted.reshape(-1, 2), whole @ flat, atol=1e-9)
    assert found.freedom == pytest.approx(np.trace(whole), rel=1e-8)
    squares = np.square(flat - whole @ flat).sum()
    assert found.score == pytest.approx(squares / found.spare**2, rel=1e-6)
    assert found.sigma == pytest.approx(np.sqrt(squares / (2 * found.spare)), rel=1e-6)


def test_no_other_pair_of_strengths_has_a_smaller_score():
    values = wavy() + 0.02 * np.random.default_rng(1).normal(size=(LINES, TURNS, 2))
    along, around = axes()
    found = smooth(values, along, around)
    for first in along.strengths[::6]:
        for second in around.strengths[::6]:
            p = along.modes.kept(np.array([first]))[0]
            q = around.modes.kept(np.array([second]))[0]
            lost = 1.0 - np.outer(p, q)
            squares = np.square(lost * found.parts).sum()
            assert squares / lost.sum() ** 2 >= found.score * (1 - 1e-9)


def test_the_coefficients_give_the_fit():
    values = wavy() + 0.01 * np.random.default_rng(2).normal(size=(LINES, TURNS, 2))
    found = smooth(values, *axes())
    along, around = bases()
    rows = along.matrix(np.linspace(0.0, 1.0, LINES)).toarray()
    columns = around.matrix(np.arange(TURNS) / TURNS).toarray()
    fitted = np.einsum("zn,nkd,tk->ztd", rows, found.coefficients, columns)
    assert np.allclose(fitted, found.fitted, atol=1e-12)


def test_clean_values_are_kept_and_noise_is_smoothed_to_its_estimate():
    clean = smooth(wavy(), *axes())
    assert np.abs(clean.fitted - wavy()).max() < 1e-4
    assert clean.sigma < 1e-4
    errors, sigmas = [], []
    for seed in range(10):
        noise = 0.01 * np.random.default_rng(seed).normal(size=(LINES, TURNS, 2))
        found = smooth(wavy() + noise, *axes())
        sigmas.append(found.sigma)
        errors.append(np.sqrt(np.mean(np.square(found.fitted - wavy()))))
    assert np.mean(sigmas) == pytest.approx(0.01, rel=0.05)
    assert np.mean(errors) < 0.006


def test_a_known_noise_chooses_what_errs_least():
    noise = 0.03 * np.random.default_rng(3).normal(size=(LINES, TURNS, 2))
    errors = {
        known: np.sqrt(
            np.mean(np.square(smooth(wavy() + noise, *axes(), noise=known).fitted - wavy()))
        )
        for known in (0.001, 0.03, 0.5)
    }
    assert errors[0.03] < min(errors[0.001], errors[0.5])


def test_the_posterior_variance_covers_the_error_at_the_points():
    along, around = bases()
    rows = along.matrix(np.linspace(0.0, 1.0, LINES))
    columns = around.matrix(np.arange(TURNS) / TURNS)
    covered = []
    for seed in range(20):
        noise = 0.02 * np.random.default_rng(seed).normal(size=(LINES, TURNS, 2))
        found = smooth(wavy() + noise, *axes())
        deviation = found.sigma * np.sqrt(found.variance(rows, columns))
        covered.append(np.abs(found.fitted - wavy()) <= 1.96 * deviation[..., None])
    assert 0.90 <= np.mean(covered) <= 0.99


def test_a_line_of_twice_the_weight_counts_like_two():
    values = wavy() + 0.05 * np.random.default_rng(4).normal(size=(LINES, TURNS, 2))
    weights = np.ones(LINES)
    weights[7] = 1e6
    found = smooth(values, *axes(weights))
    plain = smooth(values, *axes())
    off = np.abs(found.fitted - values).max(axis=(1, 2))
    assert off[7] < 0.2 * np.abs(plain.fitted - values)[7].max()
    assert np.delete(off, 7).max() > 0.02


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_the_unit_does_not_matter(unit):
    values = wavy() + 0.02 * np.random.default_rng(5).normal(size=(LINES, TURNS, 2))
    found, usual = smooth(unit * values, *axes()), smooth(values, *axes())
    assert found.strengths == usual.strengths
    assert np.allclose(found.fitted / unit, usual.fitted, rtol=1e-12)


def test_the_condition_is_bounded_and_that_of_the_matrix():
    found = smooth(wavy(), *axes())
    assert found.condition < 1e3
    weight, strength = found.along.weight, found.strengths[0]
    root = np.linalg.cholesky(weight + strength * found.along.bending)
    assert found.along.condition(strength) == pytest.approx(np.linalg.cond(root), rel=1e-6)


def test_values_all_in_one_place_stay_there():
    found = smooth(np.full((LINES, TURNS, 2), 3.0), *axes())
    assert np.allclose(found.fitted, 3.0)
    assert found.sigma < 1e-12


def test_without_anything_that_bends_the_values_are_passed():
    along = smoothing_axis(np.eye(2), np.zeros((1, 2)))
    values = np.random.default_rng(6).normal(size=(2, TURNS, 2))
    around = axes()[1]
    found = smooth(values, along, around, noise=0.0)
    assert np.allclose(found.fitted, values, atol=1e-4)


def test_caution_smooths_more_and_never_passes_the_values():
    noise = 0.02 * np.random.default_rng(7).normal(size=(LINES, TURNS, 2))
    for values in (wavy(), wavy() + noise):
        plain, careful = smooth(values, *axes()), smooth(values, *axes(), caution=1.4)
        assert careful.freedom <= plain.freedom
        assert careful.freedom < LINES * TURNS / 1.4


def test_values_and_noise_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match=r"values must have shape \(15, 24, any\)"):
        smooth(wavy()[1:], *axes())
    with pytest.raises(ValueError, match="noise must be 0 or more and finite, got -1"):
        smooth(wavy(), *axes(), noise=-1.0)
    with pytest.raises(ValueError, match=r"caution must be at least 1 and finite, got 0\.5"):
        smooth(wavy(), *axes(), caution=0.5)


def test_what_a_line_is_missed_by_is_what_leaving_it_out_would_cost():
    rng = np.random.default_rng(2)
    sites = np.linspace(0.0, 1.0, 9)
    basis = clamped_basis(9)
    matrix, root = basis.matrix(sites).toarray(), bending_along(basis)
    weights = rng.uniform(0.5, 2.0, 9)
    around = smoothing_axis(np.eye(4), np.eye(4)[:1])
    values = rng.normal(size=(9, 4, 2))
    fit = smooth(values, smoothing_axis(matrix, root, weights), around, noise=0.5)
    form = np.trace(matrix.T @ (weights[:, None] * matrix)) / 9
    bend = np.trace(root.T @ root) / 9
    penalty = fit.strengths[0] * form / bend * root.T @ root
    held = (fit.around.modes.shapes * fit.around.modes.kept(np.array(fit.strengths[1:]))) @ (
        fit.around.modes.shapes.T
    )
    smoothed = np.einsum("kl,mld->mkd", held, values)
    for out in range(9):
        stay = np.arange(9) != out
        rows = matrix[stay]
        left = np.linalg.solve(
            rows.T @ (weights[stay, None] * rows) + penalty,
            rows.T @ (weights[stay, None] * smoothed[stay].reshape(8, -1)),
        )
        missed = np.linalg.norm(matrix[out] @ left - smoothed[out].ravel())
        assert fit.missed[out] == pytest.approx(missed, rel=1e-6)


def test_the_bending_along_is_the_integral_of_the_squared_second_derivative():
    basis = Basis(np.array([0, 0, 0, 0, 0.2, 0.7, 1, 1, 1, 1.0]), 3)
    control = np.random.default_rng(0).normal(size=basis.count)
    fine = (np.arange(200_000) + 0.5) / 200_000
    wanted = np.mean(np.square(basis.matrix(fine, 2) @ control))
    assert np.sum(np.square(bending_along(basis) @ control)) == pytest.approx(wanted, rel=1e-6)


def test_straight_lines_do_not_bend_along():
    basis = clamped_basis(9)
    line = 3.0 + 2.0 * basis.greville()
    assert np.abs(bending_along(basis) @ line).max() < 1e-11
    assert np.abs(bending_along(basis, 1) @ np.ones(9)).max() < 1e-12
    assert np.abs(bending_along(basis, 1) @ line).max() > 0.1


@pytest.mark.parametrize("count", [4, 7, 24, 128])
def test_points_and_ellipses_do_not_bend_around_and_lobes_do(count):
    angle = 2 * np.pi * np.arange(count) / count
    root = bending_around(count)
    ellipse = np.column_stack([4.0 + 3.0 * np.cos(angle + 1.0), np.sin(angle)])
    assert np.abs(root @ ellipse).max() < 1e-13
    assert np.abs(root @ np.cos(2 * angle)).max() > 1e-8


TURNS_32 = 32
ANGLE = 2 * np.pi * np.arange(TURNS_32) / TURNS_32
RIM = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)


def judged(sites: Floats, radius: Floats, sigma: float = 0.0) -> BetweenContours:
    """Of contours with radii (m,) or (m, TURNS)."""
    radius = np.broadcast_to(radius.reshape(len(sites), -1), (len(sites), TURNS_32))
    across = np.broadcast_to(RIM, (len(sites), TURNS_32, 2))
    return between_contours(sites, radius[..., None] * RIM, across, sigma)


def test_what_neighbours_predict_exactly_leaves_no_doubt():
    sites = np.linspace(-1.0, 1.0, 12)
    found = judged(sites, 1.0 + sites - sites**2)
    doubt = found.variance(np.linspace(-1.5, 1.5, 50), np.arange(5) / 5)
    assert doubt.max() < 1e-24


def test_doubt_is_none_at_contours_and_most_midway():
    sites = np.linspace(0.0, 1.0, 11)
    found = judged(sites, 1.0 + 0.2 * np.sin(20.0 * sites))
    assert found.variance(sites, np.zeros(1)).max() < 1e-24
    steps = np.linspace(sites[4], sites[5], 21)
    doubt = found.variance(steps, np.zeros(1))[:, 0]
    assert np.argmax(doubt) == 10
    assert doubt[10] > 0.0


def test_doubt_grows_with_the_distance_beyond_the_outermost_contours():
    sites = np.linspace(0.0, 1.0, 11)
    found = judged(sites, 1.0 + 0.2 * np.sin(20.0 * sites))
    for away in (-1.0, 1.0):
        edge = 0.5 + 0.5 * away
        near, far = found.variance(edge + away * np.array([0.05, 0.1]), np.zeros(1))[:, 0]
        assert far == pytest.approx(4.0 * near)
        assert near > 0.0


def test_what_lies_at_one_side_leaves_no_doubt_about_the_other():
    sites = np.linspace(0.0, 1.0, 15)
    bump = np.exp(-np.square((sites[:, None] - 0.5) / 0.05) - np.square((ANGLE - np.pi) / 0.3))
    found = judged(sites, 1.0 + 0.1 * bump)
    doubt = found.variance(np.linspace(0.4, 0.6, 21), np.array([0.0, 0.5]))
    assert doubt[:, 0].max() < 1e-6 * doubt[:, 1].max()


def test_noise_alone_leaves_little_doubt():
    sites = np.linspace(0.0, 1.0, 20)
    noise = 0.01 * np.random.default_rng(0).normal(size=(20, TURNS_32))
    found = judged(sites, 1.0 + noise, sigma=0.01)
    without = judged(sites, 1.0 + noise, sigma=0.0)
    assert found.squares.mean() < 0.5 * without.squares.mean()


def test_the_decay_is_measured_within_limits():
    sites = np.linspace(0.0, 1.0, 30)
    trust = max(FEW / 30, LEAST_TRUST)
    smooth = judged(sites, 1.0 + np.sin(3.0 * sites))
    assert smooth.share == pytest.approx(trust * LEAST_DECAY)
    rough = judged(sites, 1.0 + np.random.default_rng(1).normal(size=30))
    assert trust * 0.3 < rough.share <= trust * MOST_DECAY
    few = judged(sites[:5], 1.0 + np.sin(9.0 * sites[:5]))
    assert few.share == pytest.approx(DECAY)


def test_three_two_and_one_contours_give_finite_doubts():
    places = np.linspace(-0.5, 2.5, 31)
    for count, warnings in ((3, True), (2, True), (1, False)):
        found = judged(np.arange(count, dtype=float), np.array([1.0, 1.5, 0.7])[:count])
        variance = found.variance(places, np.arange(4) / 4)
        assert np.isfinite(variance).all()
        assert bool(variance.max() > 0.0) is warnings
