"""Roots that are known to lie between two places, by Newton's method kept between them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats

MOST_STEPS = 100
NEWTON_STEPS = 12
"""After these the interval is halved: a kink or a flat place is in the way."""

Function = Callable[[Floats], tuple[Floats, Floats]]
"""Places (n,), one on each function: values and slopes (n,)."""


def bracketed_roots(
    function: Function, outside: Floats, inside: Floats, tolerance: float
) -> Floats:
    """A root (n,) of each function between a place where it is positive and one where it is not.

    Parameters
    ----------
    function : function
        Gives values and slopes.
    outside, inside : (n,) arrays
        Where the functions are positive, and where they are not; either may be the larger.
    tolerance : float
        How exactly a root is wanted, in the unit of the places.

    Returns
    -------
    (n,) array
        A place where the function is not positive, or within the tolerance of one.
    """
    outside, inside = outside.copy(), inside.copy()
    places = 0.5 * (outside + inside)
    for step in range(MOST_STEPS):
        value, slope = function(places)
        positive = value > 0.0
        outside, inside = np.where(positive, places, outside), np.where(positive, inside, places)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            newton = places - value / slope
        within = (newton - outside) * (newton - inside) <= 0.0
        if step >= NEWTON_STEPS:
            within = np.zeros_like(within)
        after = np.where(within, newton, 0.5 * (outside + inside))
        near = np.abs(after - places) <= tolerance
        places = np.where(within | ~near, after, inside)
        if near.all():
            break
    return places
