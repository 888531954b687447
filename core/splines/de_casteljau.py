"""Bézier curves, surfaces and solids by repeated means of control points.

Slower than the bases, and independent of them.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, finite_array


def de_casteljau(control: Floats, at: Floats) -> Floats:
    """Points of a Bézier curve, surface or solid: Fung, 1999, (2.20), without its binomials.

    Parameters
    ----------
    control : (n_1, ..., n_d, c) array
        Control points; the degree along each axis is one less than their number.
    at : (m, d) array
        Parameters from 0 to 1.

    Returns
    -------
    (m, c) array

    Raises
    ------
    ValueError
        If something is not finite, there is no control point, or `at` has another number of axes
        or lies outside 0 to 1.
    """
    control = finite_array("control", control, (None,) * np.ndim(control))
    if 0 in control.shape[:-1] or not control.ndim:
        raise ValueError(f"control must have shape (n_1, ..., n_d, c), got {control.shape}")
    at = finite_array("at", at, (None, control.ndim - 1))
    if at.min(initial=0.0) < 0.0 or at.max(initial=1.0) > 1.0:
        raise ValueError(f"at must lie between 0 and 1, got {at.min():g} to {at.max():g}")
    points = np.broadcast_to(control, (len(at), *control.shape))
    for x in at.T:
        share = x.reshape(-1, *(1,) * (points.ndim - 2))
        for _ in range(points.shape[1] - 1):
            points = (1.0 - share[:, None]) * points[:, :-1] + share[:, None] * points[:, 1:]
        points = points[:, 0]
    result: Floats = np.array(points)
    return result
