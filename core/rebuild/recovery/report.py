"""A recovered superquadric: covariance, rank, cover, looseness, and warnings.

Parameters may be open and the surface yet be certain, as the turn of a ball is: looseness says how
far the surface may be off. What no point has been near is another matter, and told by itself. Of
the descriptions that mean the same (half turns about the axes; a quarter turn about z with the
widths exchanged) one is given. Points in a place, line or plane get an ellipsoid, and why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from palpate.core import shapes
from palpate.core.arrays import Bools, Floats
from palpate.core.poses import Pose, principal_axes, rotations_from_vectors
from palpate.core.rebuild.recovery.distances import RIGID, Warps, distances_alone, normal_distances
from palpate.reprs import readable

MOST_UNCOVERED = 0.1  # The most in some hundred fits to 60 points all around was 0.08
COVER_LEVEL = 2  # 320 facets: enough to draw a few hundred places from
FLAT = 3.0  # Root mean square residuals that the least semi-axis must exceed
LOOSE = 0.02  # Of the points' diameter: what a surface may be off and still be recovered
UNKNOWN = 1.0  # Of the points' diameter: the scatter of points that are no more than the parameters
NEGLIGIBLE = 1e-6  # Of the longest column, and of the largest singular value: counts as nothing
# Standard deviation, in the units of the fit (points of diameter 1, logarithms, radians), that each
# parameter has before there are points; no variance is infinite.
PRIOR = 1.0
TAIL = 0.1  # Probability that the scatter is larger than it is taken to be
SAMPLES = 400
# Of the root of the area for each point. With points strewn evenly, one place in 23 is farther than
# that from all of them: the probability is exp(-pi).
SPACING = 1.0
FAR = 3.0  # Standard deviations by which points may stand off
# Why not to believe a fit. The first four: nothing was fitted, the solid is an ellipsoid about the
# points. *at a bound*: size, place or turn left what the points' extents allow. *flat*: not clearly
# thicker than the points scatter. *one-sided*: part of the surface has no points near it. *loose*:
# by few or scattered points, the surface may be off by more than 2 % of the diameter.
Unfitted = Literal["too few points", "identical points", "collinear points", "coplanar points"]
Doubt = Literal["not converged", "at a bound", "folded", "flat", "one-sided", "loose"]
RecoveryWarning = Unfitted | Doubt
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
LEAST_SPREAD = 1e-9  # Of the variance, added in every direction: flat points have distances too


class Scaled(NamedTuple):
    """Points in a unit of their own."""

    points: Floats  # (n, 3), about the origin, none but outliers farther from it than 1/2
    middle: Floats  # Where the origin is, (3,), m
    unit: float  # m


def scaled_down(points: Floats, core: Bools | None = None) -> Scaled:
    """Points (n, 3) about the mean of the `core`, over twice its largest distance from it."""
    if core is None or together(float(np.ptp(points[core], axis=0).max()), points):
        core = np.ones(len(points), bool)
    middle = points[0] + (points[core] - points[0]).mean(axis=0)
    away = points - middle
    unit = 2.0 * float(np.sqrt(np.einsum("ni,ni->n", away, away)[core].max()))
    return Scaled(away / unit, middle, unit)


def reported(
    scaled: Scaled, warps: Warps, found: SearchResult, noise: float | None, *, chosen: bool
) -> Recovery:
    """What is known of a fit; `noise` in its unit, `chosen`: whether the exponents were."""
    (points, middle, unit), inliers = scaled, found.inliers
    solid, place, parameters = _own_form(warps, found)
    (residuals,), (jacobian,) = normal_distances(parameters[None], points, solid.axes[None], warps)
    rms = float(np.sqrt(np.mean(residuals[inliers] ** 2)))
    free = np.ones(warps.total, bool)
    free[3:5] = not chosen
    left = int(inliers.sum()) - int(free.sum())
    near = residuals[inliers]
    # Unknown if the fit bent to all of them.
    scatter = float(np.sqrt(near @ near / left)) if left > 0 else UNKNOWN
    covariance, rank, condition = certainty(jacobian[inliers], noise or scatter, free)
    share, loose = 1.0, 1.0  # of what is folded, nothing is known
    if not found.folded:
        places, area = _places_on(solid, place)
        share = uncovered(places, area, points[inliers], rms)
        slopes = normal_distances(parameters[None], places, solid.axes[None], warps)[1][0]
        loose = looseness(slopes, covariance, solid.exponents)
    cautious = loose * (caution(left) if noise is None else 1.0)
    units = np.diag(units_of(warps, unit))
    units[8:11, 8:11] = unit * solid.axes
    names = {pair: name for name, pair in CHOICES.items()}
    return Recovery(
        size=unit * solid.size,
        exponents=solid.exponents,
        pose=Pose(middle + unit * place, solid.axes).array,
        taper=solid.taper,
        bend=bend_of(solid.bend / unit),
        residuals=unit * residuals,
        inliers=inliers,
        rms=unit * rms,
        covariance=np.asarray(units @ covariance @ units.T),
        names=names_of(warps),
        rank=rank,
        condition=condition,
        uncovered=share,
        looseness=unit * loose,
        converged=found.converged,
        warnings=_warnings(
            found, flat=float(solid.size.min()) < FLAT * rms, share=share, loose=cautious
        ),
        choice=names[solid.exponents[0], solid.exponents[1]] if chosen else None,
        starts=found.starts,
        steps=found.steps,
    )


def _own_form(warps: Warps, found: SearchResult) -> tuple[CanonicalSolid, Floats, Floats]:
    """The solid as it is reported, its place (3,), and the parameters (p,) in its own axes."""
    place = found.axes @ found.parameters[8:11]
    none, size = np.zeros(2), np.exp(found.parameters[:3])
    taper = found.parameters[warps.taper_columns] if warps.taper else none
    bend = found.parameters[warps.bend_columns] if warps.bend else none
    turned = found.axes @ rotations_from_vectors(found.parameters[None, 5:8])[0]
    solid = canonical(CanonicalSolid(size, found.parameters[3:5], turned, taper, bend))
    parts = [np.log(solid.size), solid.exponents, np.zeros(3), solid.axes.T @ place]
    parts += [solid.taper] * warps.taper + [solid.bend] * warps.bend
    return solid, place, np.concatenate(parts)


def _places_on(solid: CanonicalSolid, place: Floats) -> tuple[Floats, float]:
    """Places (n, 3) spread evenly over a solid, the same each time; and its area."""
    base = shapes.Superquadric(solid.size, solid.exponents)
    surface = shapes.sampled_surface(base, solid.taper, bend_of(solid.bend), COVER_LEVEL)
    sampled = shapes.area_samples(surface, SAMPLES, np.random.default_rng(0))
    return sampled @ solid.axes.T + place, surface.area


def _warnings(
    found: SearchResult, *, flat: bool, share: float, loose: float
) -> tuple[RecoveryWarning, ...]:
    reasons: list[tuple[bool, RecoveryWarning]] = [
        (not found.converged, "not converged"),
        (found.bounded, "at a bound"),
        (found.folded, "folded"),
        (flat, "flat"),
        (share > MOST_UNCOVERED, "one-sided"),
        (loose > LOOSE, "loose"),
    ]
    return tuple(warning for applies, warning in reasons if applies)


def certainty(jacobian: Floats, noise: float, free: Bools) -> tuple[Floats, int, float]:
    """Covariance (p, p), rank and condition number of parameters, `free` ones (p,) of them fitted.

    From derivatives (n, p) of residuals with the standard deviation `noise`. Columns and directions
    that count as nothing lower the rank, and keep the variance that they have before there are
    points. The condition is that of the other columns.
    """
    columns = jacobian[:, free]
    length = np.sqrt(np.einsum("np,np->p", columns, columns))
    kept = length > NEGLIGIBLE * length.max()
    singular = np.linalg.svd(columns[:, kept] / length[kept], compute_uv=False)
    rank = int((singular > NEGLIGIBLE * singular[0]).sum())
    condition = float(singular[0] / max(singular[-1], NEGLIGIBLE**2 * singular[0]))
    noise = max(noise, NEGLIGIBLE**2)  # Of Jacobian and prior together: no square is formed
    prior = noise / PRIOR * np.eye(len(length))
    triangle = np.linalg.qr(np.concatenate([columns, prior]), mode="r")
    root = np.linalg.solve(triangle, noise * np.eye(len(length)))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = root @ root.T
    return covariance, rank, condition


def bend_of(vector: Floats) -> shapes.Bend:
    """The bend of a curvature times direction (2,), 1/m."""
    curvature = float(np.hypot(*vector))
    return shapes.Bend(curvature, float(np.arctan2(vector[1], vector[0])) if curvature else 0.0)


def uncovered(surface: Floats, area: float, points: Floats, noise: float) -> float:
    """Share of places (k, 3) of a surface of an area that are far from points (n, 3)."""
    squares = np.einsum("ki,ki->k", surface, surface)[:, None]
    squares = squares + np.einsum("ni,ni->n", points, points)
    squares -= 2.0 * surface @ points.T
    near = SPACING * math.sqrt(area / len(points)) + FAR * noise
    return float((squares.min(axis=1) > near * near).mean())


def looseness(jacobian: Floats, covariance: Floats, exponents: Floats) -> float:
    """Standard deviation of a surface along its normals, root mean square over it.

    By derivatives (k, p) of the distances of places spread evenly over it, the covariance (p, p) of
    the parameters, and the exponents (2,): none counts as off by more than itself.
    """
    likely = np.ones(len(covariance))
    likely[3:5] = exponents / np.maximum(np.sqrt(np.diagonal(covariance)[3:5]), exponents)
    slopes = jacobian * likely
    return float(np.sqrt(np.einsum("kp,pq,kq->", slopes, covariance, slopes) / len(slopes)))


def caution(left: int) -> float:
    """Factor by which the scatter may be larger, with `left` points over the parameters."""
    from scipy.special import chdtri

    return float(np.sqrt(left / chdtri(left, 1.0 - TAIL))) if left > 0 else 1.0


class SearchResult(NamedTuple):
    """The best fit."""

    parameters: Floats  # (p,), see `distances.RIGID`
    axes: Floats  # (3, 3): what its rotation vector turns
    inliers: Bools  # (n,)
    converged: bool
    folded: bool  # True if no start led to a solid that its bend does not fold; this one does
    bounded: bool  # Whether a size, the place, a widening or the bend is at its limit
    starts: int  # Starts tried
    steps: int  # Steps tried by the fit that was taken, those of its first stage left out


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recovery(shapes.FittedSuperquadric):
    """A superquadric, tapered and bent, and how well its points determine it.

    Of poses that mean the same, the least turned; x is no less than y; inliers' residuals count.
    """

    inliers: Bools  # Which points were fitted, (n,)
    covariance: Floats  # Of the parameters, in the order of `names`
    # Parameters: logarithms of the semi-axes; exponents; a small turn, rad, about the solid's own
    # axes; position, m; widenings; curvature of the bend times its direction, 1/m.
    names: tuple[str, ...]
    rank: int = 0  # Parameters that the points determine to first order
    # Largest over smallest singular value of the Jacobian, its columns scaled to length 1 and those
    # that are nothing left out; 0 if nothing was fitted.
    condition: float = 0.0
    uncovered: float = 1.0  # Of the surface with no inlier as near as the points' spacing explains
    # Standard deviation of the surface along its normals, root mean square over it, m: how far off
    # the scatter of the points lets it be.
    looseness: float
    converged: bool = False
    warnings: tuple[RecoveryWarning, ...]
    choice: str | None = None  # Name of the chosen shape, where exponents were given a choice
    starts: int = 0  # Fits that were started
    steps: int = 0  # Steps of the one that was taken

    @property
    def lattice(self) -> None:
        """It has no control lattice."""

    @property
    def figures(self) -> dict[str, float]:
        """How good the fit is, by name."""
        names = ("rms", "rank", "condition", "looseness")
        figures = {name: float(getattr(self, name)) for name in names}
        return figures | {
            "uncovered_share": self.uncovered,
            "warnings": float(len(self.warnings)),
        }

    def deviations(self) -> dict[str, float]:
        """Standard deviation of each parameter, by name."""
        return dict(zip(self.names, np.sqrt(np.diagonal(self.covariance)).tolist(), strict=True))


class CanonicalSolid(NamedTuple):
    """A superquadric, tapered and bent, in some unit of length."""

    size: Floats
    exponents: Floats
    axes: Floats  # (3, 3), as columns
    taper: Floats
    bend: Floats  # Curvature times direction, (2,)


def degeneracy(points: Floats, needed: int) -> Unfitted | None:
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


def unfitted(points: Floats, warps: Warps, warning: RecoveryWarning) -> Recovery:
    """An ellipsoid in the box of the points' principal axes, and why there is nothing better."""
    size, axes, middle = _ellipsoid_about(points)
    solid = canonical(CanonicalSolid(size, np.ones(2), axes, np.zeros(2), np.zeros(2)))
    unit = float(size.max())
    residuals = np.zeros(len(points))
    if unit > 0.0:
        parameters = np.zeros((1, RIGID))
        parameters[0, :5] = np.concatenate([np.log(solid.size / unit), solid.exponents])
        rigid = Warps(taper=False, bend=False)
        away = (points - middle) / unit
        residuals = unit * distances_alone(parameters, away, solid.axes[None], rigid)[0]
    units = units_of(warps, unit) if unit > 0.0 else np.ones(warps.total)
    return Recovery(
        size=solid.size,
        exponents=solid.exponents,
        pose=Pose(middle, solid.axes).array,
        taper=np.zeros(2),
        bend=shapes.Bend(0.0),
        residuals=residuals,
        inliers=np.zeros(len(points), bool),
        rms=float(np.sqrt(np.mean(residuals**2))) if len(points) else 0.0,
        covariance=np.diag(units**2),
        names=names_of(warps),
        looseness=unit,
        warnings=(warning,),
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


def together(extent: float, points: Floats) -> bool:
    """True if some of points (n, 3), of this extent, are in one place."""
    return not extent > max(ROUNDING * float(np.abs(points).max()), LEAST)


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
    axes, taper, bend = solid.axes * signs, solid.taper * signs[2], solid.bend * signs[:2]
    return solid._replace(axes=axes, taper=taper, bend=bend)


def units_of(warps: Warps, unit: float) -> Floats:
    """Units (p,) of the parameters of a fit, where the unit of length is `unit`, m."""
    units = np.ones(warps.total)
    units[8:11] = unit
    units[warps.bend_columns] = 1.0 / unit
    return units


def names_of(warps: Warps) -> tuple[str, ...]:
    """Names of the parameters of a fit, in their order."""
    return NAMES + TAPER_NAMES * warps.taper + BEND_NAMES * warps.bend


def outlyingness(points: Floats) -> Floats:
    """How far each of points (n, 3) is from the middle of most, in their spread, (n,).

    Mahalanobis distance over a reweighted covariance, about the point with the least sum of
    distances, which turns with the points (Weiszfeld, 1937).
    """
    centre = points.mean(axis=0)
    for _ in range(MEDIAN_STEPS):
        away = points - centre
        distance = np.sqrt(np.einsum("ij,ij->i", away, away))
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
    return np.asarray(distance)


def core_of(points: Floats, share: float) -> Bools:
    """Which of points (n, 3) are left when the share that is most outlying is taken away."""
    apart = outlyingness(points)
    return np.asarray(apart <= np.quantile(apart, 1.0 - share))
