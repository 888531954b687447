"""Whether a skin that closes in a point runs through its own axis before it does."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroids
from palpate.core.rebuild.skin.contour_surface import ContourSurface
from palpate.core.rebuild.slices.star_shaped import are_star_shaped

SECTIONS, TURNS = 16, 64
LAST = 1e-3
"""Of the way to the point: how near to it sections are looked at."""


def runs_through_axis(surface: ContourSurface, rim: float, end: float) -> bool:
    """Whether a section between the last contour and the point is turned inside out.

    Where the last contour is seen whole from its middle, so must be all sections. Otherwise a
    section must but lie on the whole on the side of the axis on which the contour lies.

    Parameters
    ----------
    surface : ContourSurface
        The skin.
    rim, end : float
        Heights of the last contour and of the point, m.
    """
    ways = 1.0 - np.geomspace(1.0, LAST, SECTIONS)
    turns = np.arange(TURNS) / TURNS
    sections: Floats = surface.at((rim + ways * (end - rim))[:, None], turns[None])
    away = sections - area_centroids(sections)[:, None]
    along = np.einsum("ski,ki->s", away, away[0])
    if not (along > 0.0).all():
        return True
    star = are_star_shaped(away)
    return bool(star[0] and not star.all())
