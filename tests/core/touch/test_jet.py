from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.jet import Jet, fit_jet
from palpate.core.touch.pad import Pad

ALL = np.ones((16, 16), bool)
SCALE = 8e-3


def polynomial(pad: Pad, degree: int, seed: int = 0) -> Floats:
    """Heights of some millimetres, of one total degree, over the pad."""
    x, y = (axis / SCALE for axis in pad.grid())
    rng = np.random.default_rng(seed)
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    terms = [rng.normal() * x**i * y**j for i, j in powers]
    return np.asarray(1e-3 * np.sum(terms, axis=0))


def first(count: int) -> Bools:
    """The `count` taxels nearest to the middle of a 16 by 16 array."""
    row, col = np.mgrid[:16, :16] - 7.4
    touched = np.zeros(256, bool)
    touched[np.argsort((row**2 + col**2).ravel())[:count]] = True
    return touched.reshape(16, 16)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_a_polynomial_up_to_the_fourth_degree_is_reproduced(degree: int, flat: Pad) -> None:
    height = polynomial(flat, degree)
    fitted = fit_jet(*flat.grid(), height, ALL, SCALE)
    assert fitted is not None
    jet, misfit = fitted
    assert misfit < 1e-15
    x, y = flat.grid()
    assert np.allclose(jet.height(x[ALL], y[ALL]), height[ALL], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("count", "degree"), [(8, 1), (11, 1), (12, 2), (29, 2), (30, 3), (44, 3), (45, 4), (256, 4)]
)
def test_the_degree_follows_the_number_of_taxels(count: int, degree: int, flat: Pad) -> None:
    height = polynomial(flat, degree)
    fitted = fit_jet(*flat.grid(), height, first(count), SCALE)
    assert fitted is not None
    assert fitted[0].degree == degree
    assert fitted[1] < 1e-15


@pytest.mark.parametrize("count", [0, 1, 7])
def test_fewer_than_eight_taxels_have_no_jet(count: int, flat: Pad) -> None:
    assert fit_jet(*flat.grid(), np.zeros((16, 16)), first(count), SCALE) is None


def test_taxels_on_a_line_have_no_jet(flat: Pad) -> None:
    height = polynomial(flat, 2)
    for line in (np.s_[3, :], np.s_[:, 15], np.s_[np.arange(16), np.arange(16)]):
        touched = np.zeros((16, 16), bool)
        touched[line] = True
        assert fit_jet(*flat.grid(), height, touched, SCALE) is None


def test_two_rows_of_taxels_tell_no_more_than_a_plane(flat: Pad) -> None:
    touched = np.zeros((16, 16), bool)
    touched[7:9] = True
    fitted = fit_jet(*flat.grid(), polynomial(flat, 1), touched, SCALE)
    assert fitted is not None
    assert fitted[0].degree == 1
    assert fitted[1] < 1e-15


def test_the_jet_is_the_same_in_millimetres_and_metres(flat: Pad) -> None:
    x, y = flat.grid()
    height = np.sqrt(0.02**2 - x**2 - y**2) + 1e-5 * np.random.default_rng(0).normal(size=x.shape)
    metres = fit_jet(x, y, height, first(60), SCALE)
    millimetres = fit_jet(1e3 * x, 1e3 * y, 1e3 * height, first(60), 1e3 * SCALE)
    assert metres is not None
    assert millimetres is not None
    assert np.allclose(1e3 * metres[0].coefficients, millimetres[0].coefficients, rtol=1e-9)
    assert millimetres[1] == pytest.approx(1e3 * metres[1])
    place = np.array([1e-3]), np.array([2e-3])
    seconds = metres[0].second_derivatives(*place)
    other = millimetres[0].second_derivatives(1e3 * place[0], 1e3 * place[1])
    assert np.allclose(seconds, 1e3 * np.array(other), rtol=1e-8)


def test_slopes_and_second_derivatives_are_those_of_the_height() -> None:
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


def test_the_misfit_is_the_root_mean_square_of_what_is_left(flat: Pad) -> None:
    noise = np.random.default_rng(2).normal(scale=1e-5, size=(16, 16))
    fitted = fit_jet(*flat.grid(), polynomial(flat, 4) + noise, ALL, SCALE)
    assert fitted is not None
    # 15 of 256 degrees of freedom are spent.
    assert fitted[1] == pytest.approx(1e-5 * np.sqrt(1 - 15 / 256), rel=0.1)


def test_untouched_taxels_do_not_count(flat: Pad) -> None:
    height, touched = polynomial(flat, 4), first(80)
    spoiled = np.where(touched, height, 1e6)
    one, other = (fit_jet(*flat.grid(), h, touched, SCALE) for h in (height, spoiled))
    assert one is not None
    assert other is not None
    assert np.array_equal(one[0].coefficients, other[0].coefficients)
