import numpy as np
import pytest

from palpate.core.touch.filters import median_filter
from palpate.core.touch.forms import principal_curvatures
from palpate.core.touch.pad import Pad
from tests.studies.tactile_surface import fit_spline, spline_shape


def test_an_interpolating_spline_has_the_curvature_of_a_clean_surface(flat):
    x, y = flat.grid()
    ball = 0.02 - np.sqrt(0.02**2 - x**2 - y**2)
    k1, k2, *_ = principal_curvatures(spline_shape(flat, fit_spline(flat, ball), 0.0, 0.0))
    assert (k1, k2) == pytest.approx((50.0, 50.0), rel=1e-3)
    saddle = 15 * (x**2 - y**2) + 0.1 * x * y
    k1, k2, *_ = principal_curvatures(spline_shape(flat, fit_spline(flat, saddle), 0.0, 0.0))
    assert (k1, k2) == pytest.approx((30.0, -30.0), rel=1e-3)


def test_x_and_y_are_not_mixed_up():
    pad = Pad(rows=10, cols=14, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
    x, y = pad.grid()
    shape = spline_shape(pad, fit_spline(pad, 0.2 * x - 0.1 * y + 20 * x**2), 1e-3, -2e-3)
    k1, _, direction, _ = principal_curvatures(shape)
    assert np.allclose(shape.normal[:2] / -shape.normal[2], [0.24, -0.1], atol=1e-9)
    assert k1 > 10.0
    assert abs(direction[0]) > 0.9


def test_it_turns_noise_into_curvature_and_a_median_filter_makes_it_worse(flat):
    x, y = flat.grid()
    clean = 0.5 * (x**2 + y**2) / 0.02
    noisy = clean + 10e-6 * np.random.default_rng(0).normal(size=x.shape)
    noisy_k, _, *_ = principal_curvatures(spline_shape(flat, fit_spline(flat, noisy), 0.0, 0.0))
    median_k, _, *_ = principal_curvatures(
        spline_shape(flat, fit_spline(flat, median_filter(clean)), 0.0, 0.0)
    )
    assert abs(noisy_k - 50.0) > 5.0
    assert abs(median_k - 50.0) > 5.0


def test_a_smoothing_spline_is_told_how_much_is_noise(flat):
    x, y = flat.grid()
    noisy = 0.5 * (x**2 + y**2) / 0.02 + 10e-6 * np.random.default_rng(0).normal(size=x.shape)
    spline = fit_spline(flat, noisy, 10e-6)
    k1, k2, *_ = principal_curvatures(spline_shape(flat, spline, 0.0, 0.0))
    assert spline.smoothed
    assert (k1, k2) == pytest.approx((50.0, 50.0), abs=2.0)


@pytest.mark.filterwarnings("error")
def test_without_noise_or_with_too_little_it_interpolates_and_says_so(flat):
    x, y = flat.grid()
    clean = 0.5 * (x**2 + y**2) / 0.02
    assert not fit_spline(flat, clean, 0.0).smoothed
    rng = np.random.default_rng(0)
    given_up = 0
    for noise in (1e-12, 1e-9, 1e-7, 1e-6, 1e-5):
        for _ in range(20):
            wild = clean + 1e-3 * rng.choice([0.0, 1.0, -1.0], p=[0.9, 0.05, 0.05], size=x.shape)
            spline = fit_spline(flat, wild, noise)
            given_up += not spline.smoothed
            assert np.isfinite(spline_shape(flat, spline, 0.0, 0.0).parts).all()
            if not spline.smoothed:
                assert np.allclose(spline.surface(y[:, 0] / 1e-3, x[0] / 1e-3), wild / 1e-3)
    assert given_up > 0
