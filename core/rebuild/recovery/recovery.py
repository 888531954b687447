"""What is known of a superquadric that was fitted to points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.recovery.normal_distance import Warps
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.posed_superquadric import posed_superquadric

Doubt = Literal[
    "too few points",
    "identical points",
    "collinear points",
    "coplanar points",
    "not converged",
    "at a bound",
    "folded",
    "flat",
    "one-sided",
    "loose",
]
"""Why not to believe a fit. The first four: nothing was fitted, the solid is an ellipsoid about
the points. *at a bound*: size, place or turn left what the extents of the points allow.
*folded*: the bend folds the solid. *flat*: not clearly thicker than the points scatter.
*one-sided*: part of the surface has no points near it. *loose*: the points are so few, or scatter
so much, that the surface may be off by more than 2 % of the diameter."""
NAMES = (
    *("log size x", "log size y", "log size z", "e1", "e2"),
    *("turn x", "turn y", "turn z", "position x", "position y", "position z"),
)
TAPER_NAMES = ("taper x", "taper y")
BEND_NAMES = ("bend x", "bend y")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recovery:
    """A superquadric, tapered and bent, and how well its points determine it."""

    size: Floats
    """Semi-axes (3,), m; x is the larger of the first two."""
    exponents: Floats
    """e1 and e2, (2,)."""
    pose: Floats
    """(7,): of the several that mean the same, the one that turns least."""
    taper: Floats
    """Widening of x and y at the top, (2,)."""
    bend: Bend
    """How the tapered solid is bent."""
    residuals: Floats
    """First-order distance of each point along the normal, (n,), m; negative inside."""
    inliers: Bools
    """Which points were fitted, (n,)."""
    rms: float
    """Root mean square of the residuals of the inliers, m."""
    covariance: Floats
    """Of the parameters, in the order of `names`."""
    names: tuple[str, ...]
    """Parameters: logarithms of the semi-axes; exponents; a small turn, rad, about the solid's
    own axes; position, m; widenings; curvature of the bend times its direction, 1/m."""
    rank: int
    """Parameters that the points determine to first order."""
    condition: float
    """Largest over smallest singular value of the Jacobian, its columns scaled to length 1 and
    those that are nothing left out; 0 if nothing was fitted."""
    uncovered: float
    """Share of the surface with no inlier as near as the spacing of the points explains."""
    looseness: float
    """Standard deviation of the surface along its normals, root mean square over it, m: how far off
    the scatter of the points lets it be."""
    converged: bool
    doubts: tuple[Doubt, ...]
    """Why not to believe the fit; empty if there is no reason."""
    choice: str | None
    """Name of the shape that was chosen, where the exponents were given a choice."""
    starts: int
    """Fits that were started."""
    steps: int
    """Steps of the one that was taken."""

    @property
    def fitted(self) -> bool:
        """False if the points could not be fitted, and the solid is but an ellipsoid about them."""
        return not any(doubt.endswith("points") for doubt in self.doubts)

    def shape(self) -> PosedShape:
        """The solid where it stands.

        Raises
        ------
        ValueError
            If it has no extent, as all points were in one place, or its bend folds it.
        """
        return posed_superquadric(self.size, self.exponents, self.pose, self.taper, self.bend)

    def deviations(self) -> dict[str, float]:
        """Standard deviation of each parameter, by name."""
        spread = np.sqrt(np.diagonal(self.covariance))
        return dict(zip(self.names, spread.tolist(), strict=True))


def names_of(warps: Warps) -> tuple[str, ...]:
    """Names of the parameters of a fit, in their order."""
    return NAMES + TAPER_NAMES * warps.taper + BEND_NAMES * warps.bend


def units_of(warps: Warps, unit: float) -> Floats:
    """Units (p,) of the parameters of a fit, where the unit of length is `unit`, m."""
    units = np.ones(warps.total)
    units[8:11] = unit
    units[warps.bend_columns] = 1.0 / unit
    return units


def bend_of(vector: Floats) -> Bend:
    """The bend of a curvature times direction (2,), 1/m."""
    curvature = float(np.hypot(*vector))
    return Bend(curvature, float(np.arctan2(vector[1], vector[0])) if curvature else 0.0)
