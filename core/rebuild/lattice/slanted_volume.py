"""A control volume whose points are slanted: the spline through the slanted points of the first.

Where both ends are parallel it is the slanted volume itself; else the product of heights and places
is no spline of the same degree, and it is as near to it as its knots are close together.
"""

from __future__ import annotations

import numpy as np

from palpate.core.rebuild.slant import Slant
from palpate.core.splines.collocation import interpolate
from palpate.core.splines.tensor import evaluate_grid
from palpate.core.splines.volume import Volume


def slanted_volume(volume: Volume, slant: Slant) -> Volume:
    """The volume where a slant carries it.

    Parameters
    ----------
    volume : Volume
        In the straight space; its weights are kept.
    slant : Slant
        From there to where the object is.
    """
    sites = [basis.greville() for basis in volume.bases]
    places = volume.grid(*sites)
    moved = slant.slanted(places.reshape(-1, 3)).reshape(places.shape)
    if volume.weights is None:
        return Volume(interpolate(volume.bases, sites, moved).control, volume.bases)
    weights = evaluate_grid(volume.bases, volume.spline[..., 3:], sites)
    found = interpolate(volume.bases, sites, weights * moved).control
    return Volume(np.asarray(found / volume.weights[..., None]), volume.bases, volume.weights)
