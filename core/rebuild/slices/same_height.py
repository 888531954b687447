"""Which of two contours at one height is used: a solid of one piece has one of them."""

from __future__ import annotations

import numpy as np

from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.signed_area import signed_area
from palpate.core.plane.winding import winding_number
from palpate.core.rebuild.slices.dropped import Reason
from palpate.core.rebuild.slices.loops import Loop

ALIKE = 0.02
"""Of the perimeter: curves that are apart by less, root mean square, say the same."""
EACH = 8
"""Every so many places of a fine curve are compared with the other one."""


def rivalry(first: Loop, second: Loop) -> tuple[Loop, Reason]:
    """Which one of two loops at one height to drop, and why."""
    smaller, larger = sorted((first, second), key=lambda loop: abs(signed_area(loop.fine)))
    worse = min((second, first), key=_worth)
    off = edge_distance(larger.fine, smaller.fine[::EACH])
    if float(np.sqrt((off**2).mean())) <= ALIKE * larger.perimeter:
        return worse, "repeats another at its height"
    inside = winding_number(larger.fine, smaller.fine) != 0
    if inside.all():
        return smaller, "inside another at its height"
    if inside.any() or (winding_number(smaller.fine, larger.fine) != 0).any():
        return worse, "crosses another at its height"
    return smaller, "beside another at its height"


def _worth(loop: Loop) -> tuple[bool, bool, int]:
    """What makes one curve more reliable than another."""
    flags = loop.curve.flags
    return not flags.self_intersecting, not flags.uneven, len(loop.points)
