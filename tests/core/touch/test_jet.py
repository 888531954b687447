from dataclasses import replace

import numpy as np
import pytest

from palpate.core.touch.jet import (
    COUNTS,
    SETTLED,
    TUKEY,
    Jet,
    derivative_rows,
    fit_jet,
    fit_robust_jet,
    jet_design,
    monomials,
)
from palpate.core.touch.pad import Pad

ALL = np.ones((16, 16), bool)
SCALE = 8e-3
NOISE = 10e-6


def polynomial(pad, degree, seed=0):
    """Heights of some millimetres, of one total degree, over the pad."""
    x, y = (axis / SCALE for axis in pad.grid())
    rng = np.random.default_rng(seed)
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    terms = [rng.normal() * x**i * y**j for i, j in powers]
    return np.asarray(1e-3 * np.sum(terms, axis=0))


def first(count):
    """The `count` taxels nearest to the middle of a 16 by 16 array."""
    row, col = np.mgrid[:16, :16] - 7.4
    touched = np.zeros(256, bool)
    touched[np.argsort((row**2 + col**2).ravel())[:count]] = True
    return touched.reshape(16, 16)


def fit(pad, height, touched=ALL, noise=None):
    found = fit_jet(pad, height, touched, noise)
    assert found is not None
    return found


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_a_polynomial_up_to_the_fourth_degree_is_reproduced(degree, flat):
    height = polynomial(flat, degree)
    x, y = flat.grid()
    for found in (fit(flat, height), fit(flat, height, noise=0.0)):
        assert found.residual < 1e-15
        assert np.allclose(found.jet.height(x[ALL], y[ALL]), height[ALL], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("count", "degree"), [(8, 1), (11, 1), (12, 2), (29, 2), (30, 3), (44, 3), (45, 4), (256, 4)]
)
def test_the_degree_follows_the_number_of_taxels(count, degree, flat):
    found = fit(flat, polynomial(flat, degree), first(count))
    assert found.jet.degree == degree
    assert found.residual < 1e-15


@pytest.mark.parametrize("count", [0, 1, 7])
def test_fewer_than_eight_taxels_have_no_jet(count, flat):
    assert fit_jet(flat, np.zeros((16, 16)), first(count)) is None
    assert fit_robust_jet(flat, np.zeros((16, 16)), first(count), NOISE) is None


def test_taxels_on_a_line_have_no_jet(flat):
    height = polynomial(flat, 2)
    for line in (np.s_[3, :], np.s_[:, 15], np.s_[np.arange(16), np.arange(16)]):
        touched = np.zeros((16, 16), bool)
        touched[line] = True
        assert fit_jet(flat, height, touched) is None
        assert fit_robust_jet(flat, height, touched, NOISE) is None


def test_two_rows_of_taxels_tell_no_more_than_a_plane(flat):
    touched = np.zeros((16, 16), bool)
    touched[7:9] = True
    found = fit(flat, polynomial(flat, 1), touched)
    assert found.jet.degree == 1
    assert found.residual < 1e-15


def test_three_rows_bear_a_quadric_and_no_more(flat):
    touched = np.zeros((16, 16), bool)
    touched[6:9] = True
    found = fit(flat, polynomial(flat, 2), touched)
    assert found.jet.degree == 2
    assert found.residual < 1e-15


def test_the_jet_is_the_same_in_millimetres_and_metres(flat):
    x, y = flat.grid()
    height = np.sqrt(0.02**2 - x**2 - y**2) + NOISE * np.random.default_rng(0).normal(size=x.shape)
    large = replace(flat, pitch=1e3 * flat.pitch)
    for noise in (None, NOISE):
        metres = fit(flat, height, first(60), noise=noise)
        other = fit(large, 1e3 * height, first(60), noise=None if noise is None else 1e3 * noise)
        assert np.allclose(1e3 * metres.jet.coefficients, other.jet.coefficients, rtol=1e-9)
        assert other.deviation == pytest.approx(1e3 * metres.deviation)
        assert np.allclose(metres.derivatives[:2], other.derivatives[:2], rtol=1e-8)
        assert np.allclose(metres.derivatives[2:], 1e3 * other.derivatives[2:], rtol=1e-8)
        assert np.allclose(metres.derivative_factor[2:], 1e6 * other.derivative_factor[2:])


def test_an_array_that_is_not_square_is_fitted_as_well():
    pad = Pad(rows=8, cols=14, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
    height = polynomial(pad, 4)
    assert fit(pad, height, np.ones((8, 14), bool)).residual < 1e-15


def test_derivatives_are_those_of_the_jet_at_the_middle_of_the_contact(flat):
    height, touched = polynomial(flat, 4), first(90)
    touched[:, :7] = False
    for found in (fit(flat, height, touched), fit_robust_jet(flat, height, touched, NOISE)):
        x, y, z = (np.array([at]) for at in found.middle)
        assert found.middle[0] == pytest.approx(flat.grid()[0][touched].mean())
        assert z == pytest.approx(found.jet.height(x, y))
        assert np.allclose(found.derivatives[:2], np.ravel(found.jet.slopes(x, y)))
        assert np.allclose(found.derivatives[2:], np.ravel(found.jet.second_derivatives(x, y)))


def test_what_the_coefficients_took_up_of_the_noise_is_given_back(flat):
    found = fit(flat, np.random.default_rng(4).normal(scale=NOISE, size=(16, 16)), first(20))
    freedom = 20 - found.jet.coefficients.size
    assert freedom * found.deviation**2 == pytest.approx(found.misfit @ found.misfit, rel=1e-9)


def test_the_deviation_is_the_noise_whatever_the_degree(flat):
    rng = np.random.default_rng(2)
    for count in (12, 30, 45, 256):
        found = [
            fit(flat, rng.normal(scale=NOISE, size=(16, 16)), first(count)).deviation ** 2
            for _ in range(300)
        ]
        assert np.sqrt(np.mean(found)) == pytest.approx(NOISE, rel=0.05)


def test_untouched_taxels_do_not_count(flat):
    height, touched = polynomial(flat, 4), first(80)
    spoiled = np.where(touched, height, 1e6)
    one, other = (fit(flat, h, touched) for h in (height, spoiled))
    assert np.array_equal(one.jet.coefficients, other.jet.coefficients)


def test_the_covariance_is_the_scatter_over_many_frames(flat):
    rng = np.random.default_rng(4)
    clean, touched = polynomial(flat, 4), first(120)
    fits = [fit(flat, clean + NOISE * rng.normal(size=clean.shape), touched) for _ in range(2000)]
    scatter = np.cov(np.array([found.derivatives for found in fits]).T)
    factor = fits[0].derivative_factor
    promised = NOISE**2 * factor @ factor.T
    size = np.sqrt(np.diag(promised))
    # 2000 draws tell a variance to 3 %.
    assert np.allclose(scatter / np.outer(size, size), promised / np.outer(size, size), atol=0.12)


def test_shrinking_hardly_ever_costs_and_helps_most_where_the_surface_is_flat(flat):
    x, y = flat.grid()
    rng = np.random.default_rng(5)
    gains = []
    for height in (0.1 * x, 0.5 * (x**2 + y**2) / 0.02, 0.02 - np.sqrt(0.02**2 - x**2 - y**2)):
        wanted = fit(flat, height).derivatives[2:]
        errors = []
        for _ in range(300):
            frame = height + 5 * NOISE * rng.normal(size=x.shape)
            plain, shrunk = fit(flat, frame), fit(flat, frame, noise=5 * NOISE)
            errors.append([plain.derivatives[2:] - wanted, shrunk.derivatives[2:] - wanted])
        of_plain, of_shrunk = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
        gains.append(of_shrunk / of_plain)
    assert max(gains) < 1.05  # what holds for all coefficients together may cost one a little
    assert gains[0] < 0.75


def test_shrinking_leaves_a_noise_free_surface_alone(flat):
    x, y = flat.grid()
    height = 0.02 - np.sqrt(0.02**2 - x**2 - y**2)
    plain, shrunk = fit(flat, height), fit(flat, height, noise=0.0)
    assert np.allclose(plain.derivatives, shrunk.derivatives, rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize("share", [0.02, 0.08, 0.2])
def test_a_robust_jet_is_not_moved_by_impulses(share, flat):
    x, y = flat.grid()
    height = 0.5 * (x**2 + y**2) / 0.02
    rng = np.random.default_rng(6)
    for _ in range(20):
        frame = height + NOISE * rng.normal(size=x.shape)
        frame = np.where(
            rng.random(x.shape) < share, frame + 1e-3 * rng.choice([-1, 1], x.shape), frame
        )
        found = fit_robust_jet(flat, frame, ALL, NOISE)
        assert found.weights is not None
        assert np.count_nonzero(found.weights == 0.0) >= np.count_nonzero(
            np.abs(frame - height) > 5e-4
        )
        assert np.allclose(found.derivatives[[2, 4]], 50.0, atol=3.0)


def test_a_robust_jet_is_fitted_with_the_weights_that_its_own_misfit_gives(flat):
    x, y = flat.grid()
    rng = np.random.default_rng(9)
    for _ in range(10):
        frame = 0.5 * (x**2 + y**2) / 0.02 + NOISE * rng.normal(size=x.shape)
        frame[rng.random(x.shape) < 0.05] += 8 * NOISE
        found = fit_robust_jet(flat, frame, ALL, 3 * NOISE)
        again = np.maximum(1.0 - (found.misfit / (3 * NOISE * TUKEY)) ** 2, 0.0) ** 2
        assert np.abs(again - found.weights).max() < SETTLED


def test_a_robust_jet_of_a_clean_frame_throws_nothing_out(flat):
    found = fit_robust_jet(flat, polynomial(flat, 4), ALL, NOISE)
    assert found.weights is not None
    assert (found.weights > 0.99).all()
    exact = fit_robust_jet(flat, np.zeros((16, 16)), ALL, 0.0)
    assert (exact.jet.coefficients == 0.0).all()


def test_a_robust_jet_may_begin_with_weights_even_if_they_leave_nothing(flat):
    height = polynomial(flat, 2)
    spoiled = height.copy()
    spoiled[:6] += 3e-3
    begun = fit_robust_jet(flat, spoiled, ALL, NOISE, (spoiled == height).astype(float))
    assert np.array_equal(begun.weights.reshape(16, 16) > 0.0, spoiled == height)
    assert fit_robust_jet(flat, height, ALL, NOISE, np.zeros((16, 16))) is not None


def test_a_factorisation_is_made_once_for_each_mask(flat):
    jet_design.cache_clear()
    for height in (polynomial(flat, 2), polynomial(flat, 3)):
        fit(flat, height)
        fit(flat, height, first(50))
    assert jet_design.cache_info().misses == 2


def test_slopes_and_second_derivatives_are_those_of_the_height():
    jet = Jet(np.random.default_rng(0).normal(size=15), 0.5)
    x, y = np.random.default_rng(1).uniform(-0.4, 0.4, (2, 30))
    h = 1e-5
    ahead_x, back_x = jet.slopes(x + h, y), jet.slopes(x - h, y)
    ahead_y, back_y = jet.slopes(x, y + h), jet.slopes(x, y - h)
    slope_x, slope_y = jet.slopes(x, y)
    by_xx, by_xy, by_yy = jet.second_derivatives(x, y)
    assert np.allclose(slope_x, (jet.height(x + h, y) - jet.height(x - h, y)) / (2 * h), atol=1e-7)
    assert np.allclose(slope_y, (jet.height(x, y + h) - jet.height(x, y - h)) / (2 * h), atol=1e-7)
    assert np.allclose(by_xx, (ahead_x[0] - back_x[0]) / (2 * h), atol=1e-6)
    assert np.allclose(by_xy, (ahead_x[1] - back_x[1]) / (2 * h), atol=1e-6)
    assert np.allclose(by_xy, (ahead_y[0] - back_y[0]) / (2 * h), atol=1e-6)
    assert np.allclose(by_yy, (ahead_y[1] - back_y[1]) / (2 * h), atol=1e-6)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_rows_and_monomials_say_what_the_jet_says(degree):
    jet = Jet(np.random.default_rng(2).normal(size=COUNTS[degree]), 1.0)
    at_x, at_y = np.array([0.3]), np.array([-0.7])
    found = derivative_rows(0.3, -0.7, degree) @ jet.coefficients
    wanted = [jet.height(at_x, at_y), *jet.slopes(at_x, at_y), *jet.second_derivatives(at_x, at_y)]
    assert jet.degree == degree
    assert np.allclose(found, np.concatenate(wanted), rtol=1e-13)
    assert np.allclose(monomials(at_x, at_y, degree) @ jet.coefficients, found[0], rtol=1e-13)
