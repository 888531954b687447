"""Ways to get curvature from one tactile frame, for comparison.

Lengths are in pitches: the pad's pitch is 1, and a frame is the height of the surface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.filters import (
    median_filter,
    median_then_wiener,
    neighbourhoods,
    wiener_then_median,
)
from palpate.core.touch.forms import graph_shape, principal
from palpate.core.touch.impulses import robust_clean
from palpate.core.touch.jet import monomials
from palpate.core.touch.jet_fit import fit_jet, fit_robust_jet
from palpate.core.touch.pad import Pad
from palpate.core.touch.spline_patch import fit_spline, spline_shape

PAD = Pad(rows=16, cols=16, pitch=1.0, thickness=3.0, dome=0.0, saturation=0.8)
ALL: Bools = np.ones((16, 16), bool)
QUADRIC_REACH = 6.0
"""Half the width of the window of a local quadric, pitches."""
SMOOTHING_REACH = 3.6
"""The same of a Savitzky-Golay filter of 8 by 8 taxels."""
FLAGGED = 6.0
"""Robust deviations from the median beyond which a taxel is flagged."""
LEAST_DEVIATION = 1e-3


class Bend(NamedTuple):
    """What an estimator says."""

    k1: float
    """Larger principal curvature, 1/pitch; not a number if none was found."""
    k2: float
    """Smaller one."""
    place: tuple[float, float]
    """Where, from the pad's middle, pitches."""


Estimator = Callable[[Floats, float], Bend]
"""Takes a frame of heights and the noise's deviation, both in pitches."""


def _bend(derivatives: Floats) -> Bend:
    p, q, r, s, t = derivatives.tolist()
    k1, k2, *_ = principal(graph_shape((p, q), (r, s, t)))
    return Bend(k1, k2, (0.0, 0.0))


def _spline(frame: Floats, noise: float = 0.0) -> Bend:
    shape = spline_shape(PAD, fit_spline(PAD, frame, noise), 0.0, 0.0)
    k1, k2, *_ = principal(shape)
    return Bend(k1, k2, (0.0, 0.0))


@cache
def _window(reach: float, degree: int) -> tuple[Bools, Floats]:
    """A square window, and what gives the derivatives at the pad's middle from its taxels."""
    x, y = PAD.grid()
    inside = (np.abs(x) < reach) & (np.abs(y) < reach)
    count = (degree + 1) * (degree + 2) // 2
    solve = np.linalg.pinv(monomials(x[inside], y[inside], degree))
    assert solve.shape[0] == count
    return inside, solve[1:6] * np.array([1.0, 1.0, 2.0, 1.0, 2.0])[:, None]


def _polynomial(frame: Floats, reach: float = QUADRIC_REACH, degree: int = 2) -> Bend:
    inside, solve = _window(reach, degree)
    return _bend(solve @ frame[inside])


def _quartic(frame: Floats) -> Bend:
    fit = fit_jet(PAD, frame, ALL)
    assert fit is not None
    return _bend(fit.derivatives)


def _gaussian(frame: Floats) -> Bend:
    """Derivatives of the frame smoothed by a Gaussian of two pitches."""
    orders = ((0, 1), (1, 0), (0, 2), (1, 1), (2, 0))
    found = [
        gaussian_filter(frame, 2.0, order=order, mode="nearest")[7:9, 7:9].mean()
        for order in orders
    ]
    return _bend(np.array(found))


def _flagged(frame: Floats) -> Bend:
    """Quartic on what does not stand off its neighbourhood's median."""
    off = np.abs(frame - median_filter(frame))
    good = off <= FLAGGED * 1.4826 * float(np.median(off)) + 1e-12
    fit = fit_jet(PAD, frame, good)
    if fit is None or fit.jet.degree < 2:
        return Bend(np.nan, np.nan, (0.0, 0.0))
    k1, k2, *_ = _bend(fit.derivatives)
    return Bend(k1, k2, fit.middle[:2])


def _robust(frame: Floats, noise: float) -> Bend:
    fit = fit_robust_jet(PAD, frame, ALL, max(noise, LEAST_DEVIATION))
    assert fit is not None
    return _bend(fit.derivatives)


def _ours(frame: Floats, noise: float) -> Bend:
    """What the filter and curvature nodes do: mend the frame, leave impulses out of the fit."""
    lift = float(frame.max()) + 1.0  # so that every taxel is touched
    clean = robust_clean(PAD, lift - frame, 0.05, noise)
    patch = feel_patch(PAD, frame, ~clean.impulses, np.array([0.0, 1.0, 0.0]), noise)
    x, y, _ = patch.place.tolist()
    if patch.kind != "smooth":
        return Bend(np.nan, np.nan, (x, y))
    return Bend(*patch.principal, (x, y))


def noise_variance(frame: Floats) -> float:
    """Mean of the variances around each taxel: what a Wiener filter that knows no noise takes."""
    return float(neighbourhoods(frame).var(axis=-1).mean())


def _wiener_median(frame: Floats) -> Floats:
    return wiener_then_median(frame, noise_variance(frame))


def _median_wiener(frame: Floats) -> Floats:
    return median_then_wiener(frame, noise_variance(median_filter(frame)))


ESTIMATORS: Mapping[str, Estimator] = {
    "thesis: Wiener, median, B-spline": lambda f, s: _spline(_wiener_median(f)),
    "median, Wiener, B-spline": lambda f, s: _spline(_median_wiener(f)),
    "interpolating B-spline": lambda f, s: _spline(f),
    "smoothing B-spline": _spline,
    "quadric, 12 x 12": lambda f, s: _polynomial(f),
    "quartic, full pad": lambda f, s: _quartic(f),
    "Gaussian derivative": lambda f, s: _gaussian(f),
    "Savitzky-Golay, 8 x 8 cubic": lambda f, s: _polynomial(f, SMOOTHING_REACH, 3),
    "median, quadric": lambda f, s: _polynomial(median_filter(f)),
    "Wiener, median, quadric": lambda f, s: _polynomial(_wiener_median(f)),
    "median, Wiener, quadric": lambda f, s: _polynomial(_median_wiener(f)),
    "flag, quartic on the rest": lambda f, s: _flagged(f),
    "robust quartic": _robust,
    "palpate: filter and curvature": _ours,
}
"""By name; the first is the thesis's own chain."""


def _wavy(x: Floats, y: Floats) -> Floats:
    return x * x / 50 + y * y / 80 + 3e-4 * x**3 - 4e-5 * x**4


SHAPES: Mapping[str, Callable[[Floats, Floats], Floats]] = {
    "sphere of 20": lambda x, y: 20 - np.sqrt(400 - x * x - y * y),
    "sphere of 60": lambda x, y: 60 - np.sqrt(3600 - x * x - y * y),
    "cylinder of 15": lambda x, y: 15 - np.sqrt(225 - (0.6 * x + 0.8 * y) ** 2),
    "saddle": lambda x, y: (x * x - y * y) / 60,
    "tilted plane": lambda x, y: 0.2 * x - 0.1 * y,
    "wavy": _wavy,
}
"""Surfaces over the pad, all lengths in pitches."""
