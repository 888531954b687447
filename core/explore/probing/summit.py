"""Where a surface goes on upwards from the highest touch of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.probing.face import FOOT
from palpate.core.explore.probing.known import Probed

LEAN = math.radians(3.0)
"""Where the surface leans less, a pole is under the pad: of a ridge that goes on beyond the pad,
what touches leans little more."""
SAME = 0.25
"""Of the pad's width: a place is not touched again that lies nearer to a touched one."""
MOST = 8
"""Touches after which nobody climbs on."""


def uphill(touches: Sequence[Probed], made: Sequence[Probed], width: float) -> Floats | None:
    """The next place (2,) on the way up, m; None at the top.

    Parameters
    ----------
    touches : sequence of Probed
        At least one, that touched something: the highest of them tells where the way up goes.
    made : sequence of Probed
        All touches, those that met nothing, too: no place is tried twice.
    width : float
        Of the pad, m: a step goes as far as it feels.
    """
    highest = max(touches, key=lambda one: float(one.point[2]))
    level = float(np.linalg.norm(highest.normal[:2]))
    if not level > math.sin(LEAN) or len(made) >= MOST:
        return None
    place = highest.point[:2] - FOOT * width / level * highest.normal[:2]
    tried = [one.probing.pose[:2] for one in made]
    tried += [one.point[:2] for one in made if one.touched]
    away = np.linalg.norm(np.stack(tried) - place, axis=1)
    return place if away.min() > SAME * width else None
