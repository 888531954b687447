"""Single taxels that have nothing to do with the surface, found by what a jet leaves over."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.filters import MAD_TO_SIGMA, neighbourhoods
from palpate.core.touch.jet_fit import JetFit, fit_robust_jet
from palpate.core.touch.pad import Pad

FAR = 5.0
"""Robust deviations from the jet: normal noise on 256 taxels goes beyond once in 7000 frames."""
MOST = 3
"""More than this are not strays but something that the jet cannot follow."""
PULLED = 8
"""Taxels that one stray may pull the plain jet off from; beyond, a robust one is not tried."""


def strays(pad: Pad, height: Floats, touched: Bools, fit: JetFit, noise: float) -> Bools | None:
    """Up to three touched taxels, no two of them neighbours, far off a jet: (rows, cols).

    None if there are none, or too many, or they lie together: a face, however small, is no
    stray.

    Parameters
    ----------
    pad, height, touched
        The touch.
    fit : JetFit
        Its plain jet.
    noise : float
        Standard deviation of one taxel, m.
    """
    if not 0 < np.count_nonzero(_far(fit, noise)) <= MOST * PULLED:
        return None
    robust = fit_robust_jet(pad, height, touched, noise)
    if robust is None:
        return None
    far = _far(robust, noise)
    if not 0 < np.count_nonzero(far) <= MOST:
        return None
    found = np.zeros_like(touched)
    found[touched] = far
    crowd = neighbourhoods(found.astype(np.float64)).sum(axis=-1)
    return None if (crowd[found] > 1.0).any() else found


def _far(fit: JetFit, noise: float) -> Bools:
    off = np.abs(fit.misfit)
    far: Bools = off > FAR * max(MAD_TO_SIGMA * float(np.median(off)), noise)
    return far
