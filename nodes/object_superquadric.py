"""The words with which scenes describe superquadrics."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.shapes.superquadric import Superquadric
from palpate.nodes.object_units import Degrees, Exponent, Length

if TYPE_CHECKING:
    from palpate.core.shapes.warped import WarpedSuperquadric

TaperShare = Annotated[float, Meta(gt=-1, lt=1, description="1")]


class SuperquadricSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A superquadric about its frame's origin."""

    size: tuple[Length, Length, Length]
    """Semi-axes along x, y, z, m."""
    exponents: tuple[Exponent, Exponent]
    """e1 along z and e2 across: 0.02 nearly a box, 1 an ellipsoid, 2 an octahedron."""
    taper: tuple[TaperShare, TaperShare] = (0.0, 0.0)
    """Widening of x and y at the top, as a share."""
    bend: float = 0.0
    """Curvature to which the tapered solid's axis is bent, 1/m."""
    bend_direction: Degrees = 0.0
    """Azimuth towards which its ends are bent, degrees."""

    def __post_init__(self) -> None:
        if self.bend != 0.0:
            build_superquadric(self)  # which refuses to fold it

    @property
    def plain(self) -> bool:
        """Whether it is neither tapered nor bent."""
        return self.bend == 0.0 and self.taper == (0.0, 0.0)


def build_superquadric(spec: SuperquadricSpec) -> Superquadric | WarpedSuperquadric:
    """The solid, tapered, then bent."""
    base = plain_superquadric(spec)
    if spec.plain:
        return base
    from palpate.core.shapes.bend import Bend
    from palpate.core.shapes.warped import WarpedSuperquadric

    return WarpedSuperquadric(
        base, np.array(spec.taper), Bend(spec.bend, math.radians(spec.bend_direction))
    )


def plain_superquadric(spec: SuperquadricSpec) -> Superquadric:
    """The solid before taper and bend."""
    return Superquadric(np.array(spec.size), np.array(spec.exponents))
