"""Jets: polynomials fitted to the touched taxels, plainly, shrunk and robustly."""

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.touch import Jet, fit_jet, fit_robust_jet, monomials
from tests.core.touch.touches import FLAT, X, Y

ALL: Bools = np.ones((16, 16), bool)
NOISE = 10e-6
BALL = 0.02 - np.sqrt(0.02**2 - X**2 - Y**2)


def polynomial(degree: int) -> Floats:
    """Heights of some millimetres, of one total degree, over the pad."""
    x, y, rng = X / 8e-3, Y / 8e-3, np.random.default_rng(0)
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    return 1e-3 * np.sum([rng.normal() * x**i * y**j for i, j in powers], axis=0)


def first(count: int) -> Bools:
    """The taxels nearest to the middle of the array."""
    row, col = np.mgrid[:16, :16] - 7.4
    touched = np.zeros(256, bool)
    touched[np.argsort((row**2 + col**2).ravel())[:count]] = True
    return touched.reshape(16, 16)


def only(places: object) -> Bools:
    touched = np.zeros((16, 16), bool)
    touched[places] = True  # type: ignore[index]
    return touched


@pytest.mark.parametrize(
    ("touched", "degree"),
    [
        *[(first(8), 1), (first(11), 1), (first(12), 2), (first(29), 2), (first(30), 3)],
        *[(first(44), 3), (first(45), 4), (ALL, 4)],
        (only(np.s_[7:9]), 1),  # two rows tell no more than a plane
        (only(np.s_[6:9]), 2),  # three rows bear a quadric
        *[(first(count), None) for count in (0, 1, 7)],
        *[(only(line), None) for line in (np.s_[3, :], np.s_[:, 15])],
        (np.eye(16, dtype=bool), None),
    ],
)
def test_degree_follows_the_number_and_place_of_taxels(touched, degree):
    result = fit_jet(FLAT, polynomial(degree or 2), touched)
    robust = fit_robust_jet(FLAT, polynomial(degree or 2), touched, NOISE)
    if degree is None:
        assert result is None and robust is None
    else:
        assert result.jet.degree == robust.jet.degree == degree
        assert result.residual < 1e-15 and robust.residual < 1e-15


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_jets_derivatives_are_differences_of_its_height(degree):
    rng, h = np.random.default_rng(0), 1e-4
    jet = Jet(rng.normal(size=(degree + 1) * (degree + 2) // 2), 0.5)
    x, y = rng.uniform(-0.4, 0.4, (2, 30))
    assert jet.degree == degree
    assert np.allclose(monomials(2 * x, 2 * y, degree) @ jet.coefficients, jet.height(x, y))
    z = {(i, j): jet.height(x + i * h, y + j * h) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    slopes = (z[1, 0] - z[-1, 0]) / (2 * h), (z[0, 1] - z[0, -1]) / (2 * h)
    assert np.allclose(jet.slopes(x, y), slopes, atol=1e-6)
    seconds = (
        (z[1, 0] - 2 * z[0, 0] + z[-1, 0]) / h**2,
        (z[1, 1] - z[-1, 1] - z[1, -1] + z[-1, -1]) / (4 * h**2),
        (z[0, 1] - 2 * z[0, 0] + z[0, -1]) / h**2,
    )
    assert np.allclose(jet.second_derivatives(x, y), seconds, atol=1e-5)


def test_derivatives_are_those_at_middle_of_contact():
    height, touched = polynomial(4), first(90)
    touched[:, :7] = False
    rough = height + NOISE * np.random.default_rng(1).normal(size=X.shape)
    fits = [fit_jet(FLAT, height, touched), fit_robust_jet(FLAT, height, touched, NOISE)]
    for result in (*fits, fit_jet(FLAT, rough, touched), fit_jet(FLAT, rough, touched, NOISE)):
        x, y, z = (np.array([at]) for at in result.middle)
        assert (x[0], y[0]) == pytest.approx((X[touched].mean(), Y[touched].mean()))
        assert z == pytest.approx(result.jet.height(x, y))
        assert np.allclose(result.derivatives[:2], np.ravel(result.jet.slopes(x, y)))
        assert np.allclose(result.derivatives[2:], np.ravel(result.jet.second_derivatives(x, y)))


@pytest.mark.parametrize("count", [20, 35, 60])
def test_factors_are_the_exact_covariance_of_linear_least_squares(count):
    touched = first(count)
    units = np.zeros((count, 16, 16))
    units[:, touched] = np.eye(count)
    fits = [fit_jet(FLAT, unit, touched) for unit in units]
    for name, factor in (("derivatives", "derivative_factor"), ("jet", "factor")):
        values = [getattr(one, name) for one in fits]
        result = np.array([getattr(value, "coefficients", value) for value in values]).T
        promised = getattr(fits[0], factor)
        assert np.allclose(result @ result.T, promised @ promised.T, rtol=1e-9, atol=1e-9)
    robust = fit_robust_jet(FLAT, polynomial(2), touched, 1.0)  # all weights are 1
    weighted, plain = robust.derivative_factor, fits[0].derivative_factor
    assert np.allclose(weighted @ weighted.T, plain @ plain.T, rtol=1e-5)


def test_deviation_is_the_noise_whatever_the_degree():
    rng = np.random.default_rng(2)
    for count in (12, 30, 45, 256):
        frames = NOISE * rng.normal(size=(300, 16, 16))
        result = [fit_jet(FLAT, frame, first(count)) for frame in frames]
        freedom = count - result[0].jet.coefficients.size
        assert freedom * result[0].deviation ** 2 == pytest.approx(np.sum(result[0].misfit ** 2))
        assert count * result[0].residual ** 2 == pytest.approx(np.sum(result[0].misfit ** 2))
        # A variance of 300 times 9 degrees of freedom or more is known to 4 %.
        assert np.mean([one.deviation**2 for one in result]) == pytest.approx(NOISE**2, rel=0.1)


def test_shrinkage_reduces_errors_most_on_flat_surfaces():
    rng, gains = np.random.default_rng(5), []
    for height in (0.1 * X, 0.5 * (X**2 + Y**2) / 0.02, BALL):
        wanted = fit_jet(FLAT, height, ALL).derivatives[2:]
        errors = []
        for _ in range(200):
            frame = height + 5 * NOISE * rng.normal(size=X.shape)
            pair = [fit_jet(FLAT, frame, ALL, noise) for noise in (None, 5 * NOISE)]
            errors.append([one.derivatives[2:] - wanted for one in pair])
        of_plain, of_shrunk = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
        gains.append(of_shrunk / of_plain)
    assert max(gains) < 1.05  # what holds for all coefficients together may cost one a little
    assert gains[0] < 0.75
    plain, shrunk = (fit_jet(FLAT, BALL, ALL, noise).derivatives for noise in (None, 0.0))
    assert np.allclose(plain, shrunk, rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize("share", [0.02, 0.08, 0.2])
def test_robust_jet_is_not_moved_by_impulses(share):
    height, rng = 0.5 * (X**2 + Y**2) / 0.02, np.random.default_rng(6)
    for _ in range(20):
        struck = np.where(rng.random(X.shape) < share, 1e-3 * rng.choice([-1, 1], X.shape), 0.0)
        frame = height + NOISE * rng.normal(size=X.shape) + struck
        result = fit_robust_jet(FLAT, frame, ALL, NOISE)
        assert (result.weights[struck.ravel() != 0.0] == 0.0).all()
        assert np.allclose(result.derivatives[[2, 4]], 50.0, atol=3.0)


def test_robust_weights_are_those_of_the_biweight():
    rng = np.random.default_rng(9)
    for _ in range(10):
        frame = 0.5 * (X**2 + Y**2) / 0.02 + NOISE * rng.normal(size=X.shape)
        frame[rng.random(X.shape) < 0.05] += 8 * NOISE
        result = fit_robust_jet(FLAT, frame, ALL, 3 * NOISE)
        # 4.685 deviations: 95 % efficient for normal noise (Tukey). Rounds end within 1e-3.
        again = np.maximum(1.0 - (result.misfit / (4.685 * 3 * NOISE)) ** 2, 0.0) ** 2
        assert np.abs(again - result.weights).max() < 1e-3
        freedom = np.count_nonzero(result.weights) - result.jet.coefficients.size
        squares = float(result.weights @ result.misfit**2)
        assert result.deviation == pytest.approx(np.sqrt(squares / freedom))
        assert result.residual == pytest.approx(np.sqrt(squares / result.weights.sum()))


def test_robust_jet_starts_from_initial_weights():
    height = polynomial(2)
    spoiled = height + np.where(np.arange(16)[:, None] < 6, 3e-3, 0.0)
    begun = fit_robust_jet(FLAT, spoiled, ALL, NOISE, (spoiled == height).astype(float))
    assert np.array_equal(begun.weights.reshape(16, 16) > 0.0, spoiled == height)
    nothing = fit_robust_jet(FLAT, height, ALL, NOISE, np.zeros((16, 16)))
    assert (nothing.weights > 0.99).all()  # weights that leave nothing are not begun with
