"""Single taxels that have nothing to do with the surface, found by what a jet leaves over."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.filters import neighbourhoods
from palpate.core.touch.jet_fit import MAD_TO_SIGMA, JetFit

FAR = 5.0
"""Robust deviations from the jet: normal noise on 256 taxels goes beyond once in 7000 frames."""
MOST = 3
"""More than this are not strays but something that the jet cannot follow."""


def strays(fit: JetFit, touched: Bools, noise: float) -> Bools | None:
    """Up to three touched taxels, no two of them neighbours, far off a jet: (rows, cols).

    None if there are none, or too many, or they lie together: a face, however small, is no
    stray.

    Parameters
    ----------
    fit : JetFit
        Jet of the touched taxels.
    touched : (rows, cols) array of bool
        What it was fitted to.
    noise : float
        Standard deviation of one taxel, m.
    """
    off: Floats = np.abs(fit.misfit)
    far = off > FAR * max(MAD_TO_SIGMA * float(np.median(off)), noise)
    if not 0 < np.count_nonzero(far) <= MOST:
        return None
    found = np.zeros_like(touched)
    found[touched] = far
    crowd = neighbourhoods(found.astype(np.float64)).sum(axis=-1)
    return None if (crowd[found] > 1.0).any() else found
