"""A superquadric, tapered and bent, where it stands."""

from __future__ import annotations

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.warped import WarpedSuperquadric


def posed_superquadric(
    size: Floats, exponents: Floats, pose: Floats, taper: Floats, bend: Bend
) -> PosedShape:
    """The solid with these parameters.

    Parameters
    ----------
    size, exponents : (3,), (2,) arrays
        Semi-axes, m; e1 and e2.
    pose : (7,) array
        Of its own frame in the world.
    taper : (2,) array
        Widening of x and y at the top.
    bend : Bend
        How the tapered solid is bent.

    Raises
    ------
    ValueError
        If it has no extent, or its bend folds it.
    """
    base = Superquadric(size, exponents)
    if not taper.any() and bend.curvature == 0.0:
        return PosedShape(base, pose)
    return PosedShape(WarpedSuperquadric(base, taper, bend), pose)
