"""Recovery of a superquadric from points: Fung, 1999, (2.10).

The text minimises the root of the volume times (F - 1). That has the unit of a length to the power
1.5, weighs points by the square of their distance, and prefers small solids only as long as it
matters least; here the first-order distance along the normal is minimised, within bounds that the
extents of the points set. The text starts once, from the moments; here all orders of the axes, and
more, are started and solved side by side.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import finite_array, positive
from palpate.core.rebuild.recovery.choices import CHOICES
from palpate.core.rebuild.recovery.degenerate import degeneracy, unfitted
from palpate.core.rebuild.recovery.normal_distance import Warps
from palpate.core.rebuild.recovery.outliers import core_of
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.recovery.report import reported, scaled_down
from palpate.core.rebuild.recovery.search import TRIMMED, search, search_among_outliers

FARTHEST = 1e150
"""m: squares beyond it overflow."""


def recover(
    points: ArrayLike,
    *,
    taper: bool = False,
    bend: bool = False,
    outliers: bool = False,
    choice: Literal["thesis"] | None = None,
    noise: float | None = None,
) -> Recovery:
    """Fit a superquadric to points on its surface.

    Parameters
    ----------
    points : (n, 3) array
        m. At least 11, and 2 more for a taper and for a bend.
    taper, bend : bool
        Whether these are fitted; otherwise there is none.
    outliers : bool
        Whether some of the points, up to about a third, may not lie on the surface. It costs
        two to three times as much.
    choice : "thesis" or None
        Whether the exponents are only chosen from sphere, box and cylinder, see `CHOICES`.
    noise : float or None
        Standard deviation of the points, m, if it is known.

    Returns
    -------
    Recovery
        Always: what could not be fitted says so in `Recovery.doubts`.

    Raises
    ------
    ValueError
        If points are not finite, not of shape (n, 3) or so far away that their squares overflow,
        the noise is not positive, or the choice is unknown.
    """
    places = finite_array("points", points, (None, 3))
    farthest = float(np.abs(places).max(initial=0.0))
    if farthest > FARTHEST:
        raise ValueError(
            f"points must lie within {FARTHEST:g} m, got a coordinate of {farthest:g} m"
        )
    if noise is not None:
        positive("noise", noise, "m")
    if choice not in (None, "thesis"):
        raise ValueError(f"choice must be 'thesis' or None, got {choice!r}")
    warps = Warps(bool(taper), bool(bend))
    doubt = degeneracy(places, warps.total)
    if doubt is not None:
        return unfitted(places, warps, doubt)
    scaled = scaled_down(places, core_of(places, max(TRIMMED)) if outliers else None)
    pairs = None if choice is None else tuple(CHOICES.values())
    spread = None if noise is None else min(noise, scaled.unit) / scaled.unit
    if outliers:
        found = search_among_outliers(scaled.points, warps, pairs, spread)
    else:
        found = search(scaled.points, warps, pairs)
    return reported(scaled, warps, found, spread, chosen=choice is not None)
