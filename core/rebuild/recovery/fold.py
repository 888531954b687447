"""Whether a bend folds the solid that it bends."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.normal_distance import Warps
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.warped import most_bend


def folds(parameters: Floats, warps: Warps) -> bool:
    """True if the inner side is squeezed to nothing, or the axis closed to a ring."""
    bend = parameters[warps.bend_columns]
    taper = parameters[warps.taper_columns] if warps.taper else np.zeros(2)
    base = Superquadric(np.exp(parameters[:3]), parameters[3:5])
    curvature = float(np.hypot(*bend))
    return curvature > most_bend(base, taper, float(np.arctan2(bend[1], bend[0])))
