"""Derivatives of a touched surface by an interpolating B-spline: Fung, 1999, section 3.5.

The bicubic surface (3.23) passes through every taxel, touched or not, so every taxel's noise is in
its derivatives (3.24). They are linear in the heights: the rows that give them from the taxels give
their covariance too, of which the thesis says nothing.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import make_interp_spline

from palpate.core.arrays import Bools, Floats
from palpate.core.touch import Jet, JetFit, Pad, taylor_coefficients

CUBIC = 3
ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # Along x, along y


def fit_bspline(pad: Pad, height: Floats, touched: Bools, noise: float) -> JetFit:
    """The spline through a frame, as its tangent quadric at the middle of the contact.

    `height` (rows, cols): surface over the plane of the pad's face, m; the face itself where
    nothing is touched. `touched` (rows, cols) of bool: says where the middle is. `noise`: standard
    deviation of one taxel, m. An estimator as `palpate.core.touch.fit_patch` takes it: the quadric
    has the spline's normal and curvatures, with errors for the noise alone, as nothing is left of
    a surface that passes through all. Raises ValueError if the array is smaller than 4 by 4.
    """
    x, y = (axis[touched] for axis in pad.grid())
    at_x, at_y = float(x.mean()), float(y.mean())
    along_x, along_y = _rows(pad.cols, pad.pitch, at_x), _rows(pad.rows, pad.pitch, at_y)
    rows = np.stack([np.outer(along_y[b], along_x[a]).ravel() for a, b in ORDERS])
    told = rows @ height.ravel()
    scale = 0.5 * pad.pitch * pad.cols
    moved = taylor_coefficients(at_x, at_y, scale)
    jet = Jet(moved @ told, scale)
    misfit = height[touched] - jet.height(x, y)
    return JetFit(
        jet=jet,
        middle=(at_x, at_y, float(told[0])),
        derivatives=told[1:],
        derivative_factor=rows[1:],
        factor=moved @ rows,
        misfit=misfit,
        residual=0.0,  # of the spline
        deviation=noise,
        weights=None,
    )


@lru_cache(maxsize=1024)
def _rows(count: int, pitch: float, place: float) -> Floats:
    """What gives the value and two derivatives of the spline at a place, m, from `count` values."""
    taxels = np.arange(count) - 0.5 * (count - 1)
    spline = make_interp_spline(taxels, np.eye(count), k=CUBIC)
    return np.stack([spline(place / pitch, nu=order) / pitch**order for order in range(CUBIC)])
