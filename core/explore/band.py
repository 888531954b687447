"""How far up and down the surface was felt beside the slice, column by column."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.crossing import Crossings


def felt_bands(above: Floats, one_surface: Bools, met: Crossings) -> tuple[Floats, Floats]:
    """Lowest and highest height felt without a break from where columns meet the slice.

    Only touched taxels count: of a domed pad's face the edge often hangs free.

    Parameters
    ----------
    above : (rows, cols) array
        Height of the surface over the slice, m.
    one_surface : (rows - 1, cols) array of bool
        Whether two neighbouring rows touch one surface.
    met : Crossings
        Where the columns meet the slice.

    Returns
    -------
    low, high : (n,) arrays
        Heights over the slice, m: 0 or less, 0 or more.
    """
    breaks = np.cumsum(~one_surface, axis=0)
    stretch = np.vstack([np.zeros_like(breaks[:1]), breaks])[:, met.columns]
    unbroken = stretch == stretch[met.rows, np.arange(len(met.rows))]
    heights = np.where(unbroken, above[:, met.columns], 0.0)
    return heights.min(axis=0), heights.max(axis=0)
