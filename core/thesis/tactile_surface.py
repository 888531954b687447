"""Derivatives of a touched surface by an interpolating B-spline: Fung, 1999, section 3.5.

The bicubic surface (3.23) passes through every taxel, touched or not, so that its derivatives
(3.24) contain the noise of every taxel. They are linear in the heights: the rows that compute them
from the taxels also give their covariance, which the thesis does not mention.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import make_interp_spline

from palpate.core import splines
from palpate.core.arrays import Bools, Floats
from palpate.core.touch import Jet, JetFit, Pad, taylor_coefficients

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # of derivatives along x and y


def fit_bspline(pad: Pad, height: Floats, touched: Bools, noise: float) -> JetFit:
    """The spline through a frame, as its tangent quadric at the middle of the contact.

    An estimator for `palpate.core.touch.fit_patch`. `height` (rows, cols): surface over the plane
    of the pad's face [m]; the face itself where nothing is touched. `touched` (rows, cols) of bool:
    their mean is the middle. `noise`: standard deviation of one taxel [m]. The quadric has the
    spline's normal and curvatures; their errors are of the noise alone, since the spline has no
    residuals. Raises ValueError if the array is smaller than 4 by 4.
    """
    x, y = (axis[touched] for axis in pad.grid())
    at_x, at_y = float(x.mean()), float(y.mean())
    along_x, along_y = _rows(pad.cols, pad.pitch, at_x), _rows(pad.rows, pad.pitch, at_y)
    rows = np.stack([np.outer(along_y[b], along_x[a]).ravel() for a, b in ORDERS])
    derivatives = rows @ height.ravel()
    scale = 0.5 * pad.pitch * pad.cols
    moved = taylor_coefficients(at_x, at_y, scale)
    jet = Jet(moved @ derivatives, scale)
    misfit = height[touched] - jet.height(x, y)
    return JetFit(
        jet=jet,
        middle=(at_x, at_y, float(derivatives[0])),
        derivatives=derivatives[1:],
        derivative_factor=rows[1:],
        factor=moved @ rows,
        misfit=misfit,
        residual=0.0,  # of an interpolating spline
        deviation=noise,
        weights=None,
    )


@lru_cache(maxsize=1024)
def _rows(count: int, pitch: float, place: float) -> Floats:
    """Rows that give value, slope and bend of the spline at a place [m] from `count` values."""
    taxels = np.arange(count) - 0.5 * (count - 1)
    spline = make_interp_spline(taxels, np.eye(count), k=splines.CUBIC)
    return np.stack(
        [spline(place / pitch, nu=order) / pitch**order for order in range(splines.CUBIC)]
    )
