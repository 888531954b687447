"""Laws of the interpolating B-spline over a touch, and of the curvature node that uses it."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.thesis import fit_bspline
from palpate.core.touch import Pad, fit_jet, fit_patch
from palpate.messages.types import SurfacePatch, TactileImage
from palpate.nodes import curvature
from palpate.nodes.runtime.testing import drive, example, messages_on
from tests.nodes.patches import IMPRINT, INFO, RADIUS

PAD = Pad(rows=12, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
X, Y = PAD.grid()
ALL = np.ones(X.shape, bool)
BEYOND = X > -3e-3  # a contact beside the pad's middle
NOISE = 5e-6
ALONG_Y = np.array([0.0, 1.0, 0.0])
IMAGE = example(
    TactileImage,
    pose=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    direction=ALONG_Y,
    outcome="hit",
    fault="none",
    compression=IMPRINT,
    mask=IMPRINT > 0.0,
)  # of a small ball


def test_derivatives_of_cubic_are_exact():
    height = 1e-3 + 0.1 * X - 0.05 * Y + 20 * X**2 - 8 * X * Y + 5 * Y**2 + 900 * X**3 - 400 * Y**3
    fit = fit_bspline(PAD, height, BEYOND, NOISE)
    x, y, z = fit.middle
    assert (x, y) == pytest.approx((float(X[BEYOND].mean()), 0.0), abs=1e-12)
    expected = [0.1 + 40 * x - 8 * y + 2700 * x**2, -0.05 - 8 * x + 10 * y - 1200 * y**2]
    expected += [40 + 5400 * x, -8.0, 10 - 2400 * y]
    assert fit.derivatives == pytest.approx(expected, rel=1e-9)
    # The quadric has height, slopes and bends of the spline at the middle of the contact.
    jet, at = fit.jet, (np.array([x]), np.array([y]))
    derivatives = (jet.height(*at), *jet.slopes(*at), *jet.second_derivatives(*at))
    assert np.ravel(derivatives) == pytest.approx([z, *expected], rel=1e-9)


def test_derivatives_contain_noise_of_all_taxels():
    rng = np.random.default_rng(1)
    draws = NOISE * rng.normal(size=(2000, *X.shape))
    derivatives = np.array([fit_bspline(PAD, draw, ALL, NOISE).derivatives for draw in draws])
    spline = fit_bspline(PAD, draws[0], ALL, NOISE)
    assert (spline.residual, spline.deviation) == (0.0, NOISE)
    expected = NOISE**2 * spline.derivative_factor @ spline.derivative_factor.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.cov(derivatives.T) / scale == pytest.approx(expected / scale, abs=0.1)
    jet = fit_jet(PAD, draws[0], ALL, NOISE)
    smoother = np.linalg.norm(jet.derivative_factor, axis=1)
    assert np.all(np.linalg.norm(spline.derivative_factor, axis=1)[2:] > 10 * smoother[2:])


def test_patch_takes_normal_and_curvatures_of_spline():
    radius = 0.03
    ball = radius - np.sqrt(radius**2 - (X - 1e-3) ** 2 - Y**2)
    jet, spline = (fit_patch(PAD, ball, ALL, ALONG_Y, 0.0, one) for one in (fit_jet, fit_bspline))
    assert spline.principal == pytest.approx((1 / radius, 1 / radius), rel=1e-3)
    assert spline.normal == pytest.approx(jet.normal, abs=1e-4)
    noisy = ball + NOISE * np.random.default_rng(2).normal(size=X.shape)
    patch = fit_patch(PAD, noisy, ALL, ALONG_Y, NOISE, fit_bspline)
    errors = np.abs(np.array(patch.principal) - 1 / radius)
    assert np.all(errors < 4.0 * np.array(patch.principal_error)) and errors.max() > 1.0
    ridge = np.abs(X)
    kinds = {fit_patch(PAD, ridge, ALL, ALONG_Y, 0.0, one).kind for one in (fit_jet, fit_bspline)}
    assert kinds == {"edge"}


def test_node_takes_estimator_by_name():
    inputs = [INFO, ("/touch/image", IMAGE)]
    for name in ("bspline", "palpate.core.thesis:fit_bspline"):
        [patch] = messages_on(drive(curvature.NODE, inputs, {"estimator": name}), "/touch/patch")
        assert isinstance(patch, SurfacePatch) and len(patch.jet) == 6
        # The free face around the contact counts too.
        assert (patch.k1, patch.k2) == pytest.approx((1 / RADIUS, 1 / RADIUS), rel=0.15)
    for name, words in (
        ("spline", "there is no estimator of curvature 'spline'; there are jet, bspline"),
        ("os:path", "'os:path' must be a function"),
        ("nowhere:fit", "'nowhere:fit' cannot be imported: ModuleNotFoundError"),
    ):
        with pytest.raises(ValueError, match=words):
            curvature.Params(estimator=name)
