"""What is known of a recovered superquadric, and of points to which none can be fitted.

A superquadric is the same after a half turn about each of its axes, and after a quarter turn
about z with its two widths exchanged: one description of those that mean the same is given.
Points in one place, on a line or in a plane get an ellipsoid about them and the reason; points
that stand apart are found before anything is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import pose_of, principal_axes
from palpate.core.rebuild.recovery.distances import RIGID, Warps, distances_alone
from palpate.core.shapes import Bend, PosedShape, posed_superquadric

# Why not to believe a fit. The first four: nothing was fitted, the solid is an ellipsoid about the
# points. *at a bound*: size, place or turn left what the extents of the points allow. *folded*: the
# bend folds the solid. *flat*: not clearly thicker than the points scatter. *one-sided*: part of
# the surface has no points near it. *loose*: the points are so few, or scatter so much, that the
# surface may be off by more than 2 % of the diameter.
RecoveryWarning = Literal[
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
NAMES = (
    *("log size x", "log size y", "log size z", "e1", "e2"),
    *("turn x", "turn y", "turn z", "position x", "position y", "position z"),
)
TAPER_NAMES = ("taper x", "taper y")
BEND_NAMES = ("bend x", "bend y")
# Exponents e1 and e2: Fung, 1999, 3.2.2, step 1.
CHOICES: dict[str, tuple[float, float]] = {
    "sphere": (1.0, 1.0),
    "box": (0.2, 0.2),
    "cylinder": (0.2, 1.0),
}
QUARTER_TURN: Floats = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
# Diagonals of the rotations by half a turn about no axis, x, y and z.
HALF_TURNS: Floats = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
NO_EXTENT = 1e-6  # Of the largest extent
ROUNDING = 1e-14  # Of the distance from the origin: points that are nearer together are one
LEAST = 1e-150  # m: so are points nearer together than this, whose squares would underflow
THINNEST = 1e-3  # Of the largest extent: no ellipsoid is given thinner than this
MEDIAN_STEPS = 30
WEIGHT_STEPS = 10
FULL_WEIGHT = 1.45  # Of the median distance: what is nearer counts fully
# Of the variance, added in every direction, so that flat points have distances too.
LEAST_SPREAD = 1e-9


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recovery:
    """A superquadric, tapered and bent, and how well its points determine it."""

    size: Floats  # Semi-axes (3,), m; x is the larger of the first two
    exponents: Floats  # e1 and e2, (2,)
    pose: Floats  # (7,): of the several that mean the same, the one that turns least
    taper: Floats  # Widening of x and y at the top, (2,)
    bend: Bend  # How the tapered solid is bent
    # First-order distance of each point along the normal, (n,), m; negative inside.
    residuals: Floats
    inliers: Bools  # Which points were fitted, (n,)
    rms: float  # Root mean square of the residuals of the inliers, m
    covariance: Floats  # Of the parameters, in the order of `names`
    # Parameters: logarithms of the semi-axes; exponents; a small turn, rad, about the solid's own
    # axes; position, m; widenings; curvature of the bend times its direction, 1/m.
    names: tuple[str, ...]
    rank: int  # Parameters that the points determine to first order
    # Largest over smallest singular value of the Jacobian, its columns scaled to length 1 and those
    # that are nothing left out; 0 if nothing was fitted.
    condition: float
    # Share of the surface with no inlier as near as the spacing of the points explains.
    uncovered: float
    # Standard deviation of the surface along its normals, root mean square over it, m: how far off
    # the scatter of the points lets it be.
    looseness: float
    converged: bool
    doubts: tuple[RecoveryWarning, ...]  # Why not to believe the fit; empty if there is no reason
    choice: str | None  # Name of the shape that was chosen, where the exponents were given a choice
    starts: int  # Fits that were started
    steps: int  # Steps of the one that was taken

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


def name_of(exponents: Floats) -> str:
    """Which of the three has these exponents (2,)."""
    return next(name for name, pair in CHOICES.items() if pair == tuple(exponents.tolist()))


class CanonicalSolid(NamedTuple):
    """A superquadric, tapered and bent, in some unit of length."""

    size: Floats
    exponents: Floats
    axes: Floats  # (3, 3), as columns
    taper: Floats
    bend: Floats  # Curvature times direction, (2,)


def canonical(solid: CanonicalSolid) -> CanonicalSolid:
    """The description with the larger width along x and the axes least turned from the world's."""
    if solid.size[1] > solid.size[0]:
        solid = CanonicalSolid(
            solid.size[[1, 0, 2]],
            solid.exponents,
            solid.axes @ QUARTER_TURN,
            solid.taper[::-1],
            np.array([solid.bend[1], -solid.bend[0]]),
        )
    signs = HALF_TURNS[int(np.argmax(HALF_TURNS @ np.diagonal(solid.axes)))]
    return solid._replace(
        axes=solid.axes * signs, taper=solid.taper * signs[2], bend=solid.bend * signs[:2]
    )


def degeneracy(points: Floats, needed: int) -> RecoveryWarning | None:
    """Why points (n, 3) cannot be fitted, or None if nothing is the matter."""
    if not len(points):
        return "too few points"
    centred = points - points.mean(axis=0)
    widths = np.ptp(centred @ principal_axes(centred), axis=0)
    if together(float(widths.max()), points):
        return "identical points"
    thin = int((widths <= NO_EXTENT * widths.max()).sum())
    if thin:
        return "collinear points" if thin == 2 else "coplanar points"
    return "too few points" if len(points) < needed else None


def together(extent: float, points: Floats) -> bool:
    """True if some of points (n, 3), of this extent, are in one place."""
    return not extent > max(ROUNDING * float(np.abs(points).max()), LEAST)


def unfitted(points: Floats, warps: Warps, doubt: RecoveryWarning) -> Recovery:
    """An ellipsoid in the box of the points' principal axes, and why there is nothing better."""
    size, axes, middle = _ellipsoid_about(points)
    solid = canonical(CanonicalSolid(size, np.ones(2), axes, np.zeros(2), np.zeros(2)))
    unit = float(size.max())
    residuals = np.zeros(len(points))
    if unit > 0.0:
        residuals = unit * _distances(solid, (points - middle) / unit, unit)
    units = units_of(warps, unit) if unit > 0.0 else np.ones(warps.total)
    return Recovery(
        size=solid.size,
        exponents=solid.exponents,
        pose=pose_of(middle, solid.axes),
        taper=np.zeros(2),
        bend=Bend(0.0),
        residuals=residuals,
        inliers=np.zeros(len(points), bool),
        rms=float(np.sqrt(np.mean(residuals**2))) if len(points) else 0.0,
        covariance=np.diag(units**2),
        names=names_of(warps),
        rank=0,
        condition=0.0,
        uncovered=1.0,
        looseness=unit,
        converged=False,
        doubts=(doubt,),
        choice=None,
        starts=0,
        steps=0,
    )


def _ellipsoid_about(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Semi-axes (3,), axes (3, 3) and middle (3,)."""
    if not len(points):
        return np.zeros(3), np.eye(3), np.zeros(3)
    mean = points.mean(axis=0)
    axes = principal_axes(points - mean)
    places = (points - mean) @ axes
    low, high = places.min(axis=0), places.max(axis=0)
    size = 0.5 * (high - low)
    if together(2.0 * float(size.max()), points):
        return np.zeros(3), axes, mean
    return np.maximum(size, THINNEST * size.max()), axes, mean + axes @ (0.5 * (low + high))


def _distances(solid: CanonicalSolid, points: Floats, unit: float) -> Floats:
    """Distances (n,) of points about an ellipsoid's middle, all in the same unit."""
    parameters = np.zeros((1, RIGID))
    parameters[0, :5] = np.concatenate([np.log(solid.size / unit), solid.exponents])
    rigid = Warps(taper=False, bend=False)
    return np.asarray(distances_alone(parameters, points, solid.axes[None], rigid)[0])


def outlyingness(points: Floats) -> Floats:
    """How far each of points (n, 3) is from the middle of most, in their spread, (n,).

    Notes
    -----
    Mahalanobis distance over a reweighted covariance, about the point with the least sum of
    distances: unlike the median of each coordinate, that one turns with the points. Weiszfeld,
    1937.
    """
    centre = points.mean(axis=0)
    for _ in range(MEDIAN_STEPS):
        distance = _lengths(points - centre)
        weight = 1.0 / np.maximum(distance, LEAST_SPREAD * float(distance.max()) + 1e-300)
        centre = weight @ points / weight.sum()
    weight, distance = np.ones(len(points)), np.ones(len(points))
    for _ in range(WEIGHT_STEPS):
        away = points - centre
        spread = (weight[:, None] * away).T @ away / weight.sum()
        least = LEAST_SPREAD * float(np.einsum("ij,ij->", away, away)) / len(points)
        spread += (least + 1e-300) * np.eye(3)
        distance = np.sqrt(np.einsum("ij,ij->i", away, np.linalg.solve(spread, away.T).T))
        limit = FULL_WEIGHT * float(np.median(distance))
        weight = np.minimum(1.0, limit / np.maximum(distance, limit + 1e-300)) ** 4
        weight[distance <= limit] = 1.0
        centre = weight @ points / weight.sum()
    return distance


def _lengths(vectors: Floats) -> Floats:
    result: Floats = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return result


def core_of(points: Floats, share: float) -> Bools:
    """Which of points (n, 3) are left when the share that is most outlying is taken away."""
    apart = outlyingness(points)
    result: Bools = apart <= np.quantile(apart, 1.0 - share)
    return result
