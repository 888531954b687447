"""The object as one superquadric: what a few grasps tell of size, place and shape."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.rebuild.recovery.recover import recover
from palpate.core.rebuild.recovery.recovery import Recovery

WARPS = ((False, False), (True, False), (True, True))
"""Of which fits the best is taken: neither tapered nor bent, tapered, both."""
USELESS = frozenset({"folded", "not converged"})
"""A fit with one of these doubts is taken only if there is no other."""


def coarse_of(points: Floats, noise: float) -> Recovery:
    """The superquadric that explains contacts best for its number of parameters.

    Parameters
    ----------
    points : (n, 3) array
        Contacts, m.
    noise : float
        Standard deviation of a contact, m: what is less than this explains nothing.

    Returns
    -------
    Recovery
        Tapered and bent where that pays. If the contacts are too few, or all in a plane, it is an
        ellipsoid in their extents, and says so in its doubts.

    Raises
    ------
    ValueError
        If the contacts are not finite points, or the noise is not positive.

    Notes
    -----
    Fung, 1999, 3.2.2, step 1, with pose, taper, bend and free exponents. Chosen by Schwarz,
    *Estimating the dimension of a model*, 1978.
    """
    contacts = finite_array("points", points, (None, 3))
    positive("noise", noise, "m")
    fits = [recover(contacts, taper=taper, bend=bend) for taper, bend in WARPS]
    fitted = [fit for fit in fits if fit.fitted]
    if not fitted:
        return fits[0]
    sound = [fit for fit in fitted if not USELESS.intersection(fit.doubts)]
    return min(sound or fitted[:1], key=lambda fit: _information(fit, len(contacts), noise))


def _information(fit: Recovery, count: int, noise: float) -> float:
    """Schwarz's criterion: smaller is better."""
    missed = 2.0 * count * math.log(math.hypot(fit.rms, noise))
    return missed + len(fit.names) * float(np.log(count))
