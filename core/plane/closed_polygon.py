"""What a closed polygon must be."""

from __future__ import annotations

from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array


def closed_polygon(polygon: ArrayLike, least: int = 1) -> Floats:
    """Vertices (n, 2) of a closed polygon, m, once they have been looked at.

    Raises
    ------
    ValueError
        If they are not finite (n, 2), or fewer than `least`.
    """
    checked = finite_array("polygon", polygon, (None, 2))
    if len(checked) < least:
        ending = "vertex" if least == 1 else "vertices"
        raise ValueError(f"polygon must have at least {least} {ending}, got {len(checked)}")
    return checked
