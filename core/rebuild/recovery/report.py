"""A recovered superquadric: covariance, rank, uncovered share, looseness, and warnings.

Parameters may be undetermined and the surface yet certain, as with the rotation of a ball: the
looseness is the uncertainty of the surface itself. The share of the surface without points nearby
is reported separately. Of equivalent descriptions (half turns about the axes; a quarter turn about
z with the widths exchanged) one is reported. Points in one place, line or plane give an ellipsoid,
with a warning.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from palpate.core import shapes
from palpate.core.arrays import Bools, Floats
from palpate.core.poses import Pose, principal_axes, rotations_from_vectors
from palpate.core.rebuild.recovery.distances import (
    N_RIGID,
    Warps,
    distances_alone,
    normal_distances,
)
from palpate.reprs import readable

# Reasons to doubt a fit. Unfitted: the solid is an ellipsoid about the points. *at a bound*: size,
# position, taper or bend reached the bounds from the points' extents. *folded*: the bend folds the
# solid. *flat*: not clearly thicker than the scatter of the points. *one-sided*: a part of the
# surface has no points nearby. *loose*: by few or scattered points, the surface may be off by more
# than 2 % of the diameter.
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
ROUNDING = 1e-14  # fraction of the distance from the origin: points nearer together are one
MIN_EXTENT = 1e-150  # [m]: so are points nearer together than this, whose squares underflow


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportSettings:
    """How the certainty of a fit is estimated, and when it is doubted."""

    max_uncovered: float = 0.1  # share of the surface; at most 0.08 in 100 fits to 60 points
    max_looseness: float = 0.02  # fraction of the points' diameter
    min_thickness: float = 3.0  # least semi-axis over the root mean square residual
    cover_level: int = 2  # subdivisions of the mesh that places are drawn from: 320 facets
    n_samples: int = 400  # places of the surface
    # Distance of a place from the nearest point, over the root of the area per point. With points
    # spread at random, one place in 23 is farther away (probability exp(-pi)); noise is allowed for
    # with `noise_sigmas` standard deviations.
    max_gap: float = 1.0
    noise_sigmas: float = 3.0
    # Fraction of the points' diameter, if there are no more points than parameters.
    unknown_scatter: float = 1.0
    negligible: float = 1e-6  # of the longest column and the largest singular value: counts as 0
    # Standard deviation of each parameter before there are points, in the units of the fit (points
    # of diameter 1, logarithms, radians), so that no variance is infinite.
    prior: float = 1.0
    tail: float = 0.1  # probability that the scatter is larger than its upper estimate


class Scaled(NamedTuple):
    """Points in a unit of their own."""

    points: Floats  # (n, 3), about the origin; only outliers are farther from it than 1/2
    middle: Floats  # place of the origin, (3,) [m]
    unit: float  # [m]


def scaled_down(points: Floats, core: Bools | None = None) -> Scaled:
    """Points (n, 3) about the mean of the `core`, over twice its largest distance from there."""
    if core is None or are_identical(float(np.ptp(points[core], axis=0).max()), points):
        core = np.ones(len(points), bool)
    middle = points[0] + (points[core] - points[0]).mean(axis=0)
    away = points - middle
    unit = 2.0 * float(np.sqrt(np.einsum("ni,ni->n", away, away)[core].max()))
    return Scaled(away / unit, middle, unit)


def reported(
    scaled: Scaled,
    warps: Warps,
    result: SearchResult,
    noise: float | None,
    settings: ReportSettings,
    *,
    chosen: bool,
) -> Recovery:
    """A fit with its certainty; `noise` in its unit, `chosen`: whether exponents were a choice."""
    (points, middle, unit), inliers = scaled, result.inliers
    solid, place, parameters = _own_form(warps, result)
    (residuals,), (jacobian,) = normal_distances(parameters[None], points, solid.axes[None], warps)
    rms = float(np.sqrt(np.mean(residuals[inliers] ** 2)))
    free = np.ones(warps.total, bool)
    free[3:5] = not chosen
    left, near = int(inliers.sum()) - int(free.sum()), residuals[inliers]
    scatter = float(np.sqrt(near @ near / left)) if left > 0 else settings.unknown_scatter
    covariance, rank, condition = certainty(jacobian[inliers], noise or scatter, free, settings)
    share, loose = 1.0, 1.0  # of a folded solid, nothing is known
    if not result.folded:
        places, area = _places_on(solid, place, settings)
        share = uncovered_share(places, area, points[inliers], rms, settings)
        slopes = normal_distances(parameters[None], places, solid.axes[None], warps)[1][0]
        loose = looseness(slopes, covariance, solid.exponents)
    upper_loose = loose * (scatter_factor(left, settings.tail) if noise is None else 1.0)
    warnings = _warnings(
        result,
        flat=float(solid.size.min()) < settings.min_thickness * rms,
        one_sided=share > settings.max_uncovered,
        loose=upper_loose > settings.max_looseness,
    )
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
        converged=result.converged,
        warnings=warnings,
        choice=names[solid.exponents[0], solid.exponents[1]] if chosen else None,
        starts=result.starts,
        steps=result.steps,
    )


def _own_form(warps: Warps, result: SearchResult) -> tuple[CanonicalSolid, Floats, Floats]:
    """The solid as it is reported, its place (3,), and the parameters (p,) in its own axes."""
    fitted = result.parameters
    place = result.axes @ fitted[8:11]
    none, size = np.zeros(2), np.exp(fitted[:3])
    taper = fitted[warps.taper_columns] if warps.taper else none
    bend = fitted[warps.bend_columns] if warps.bend else none
    turned = result.axes @ rotations_from_vectors(fitted[None, 5:8])[0]
    solid = canonical(CanonicalSolid(size, fitted[3:5], turned, taper, bend))
    parts = [np.log(solid.size), solid.exponents, np.zeros(3), solid.axes.T @ place]
    parts += [solid.taper] * warps.taper + [solid.bend] * warps.bend
    return solid, place, np.concatenate(parts)


def _places_on(
    solid: CanonicalSolid, place: Floats, settings: ReportSettings
) -> tuple[Floats, float]:
    """Places (n, 3) spread at random over a solid, with a fixed seed; and its area."""
    base = shapes.Superquadric(solid.size, solid.exponents)
    surface = shapes.sampled_surface(base, solid.taper, bend_of(solid.bend), settings.cover_level)
    sampled = shapes.area_samples(surface, settings.n_samples, np.random.default_rng(0))
    return sampled @ solid.axes.T + place, surface.area


def _warnings(
    result: SearchResult, *, flat: bool, one_sided: bool, loose: bool
) -> tuple[RecoveryWarning, ...]:
    reasons: list[tuple[bool, RecoveryWarning]] = [
        (not result.converged, "not converged"),
        (result.bounded, "at a bound"),
        (result.folded, "folded"),
        (flat, "flat"),
        (one_sided, "one-sided"),
        (loose, "loose"),
    ]
    return tuple(warning for applies, warning in reasons if applies)


def certainty(
    jacobian: Floats, noise: float, free: Bools, settings: ReportSettings
) -> tuple[Floats, int, float]:
    """Covariance (p, p), rank and condition number of parameters, of which `free` (p,) were fitted.

    From derivatives (n, p) of residuals with the standard deviation `noise`. Negligible columns and
    directions lower the rank and keep their prior variance; the condition is that of the remaining
    columns.
    """
    columns, negligible = jacobian[:, free], settings.negligible
    length = np.sqrt(np.einsum("np,np->p", columns, columns))
    kept = length > negligible * length.max()
    singular = np.linalg.svd(columns[:, kept] / length[kept], compute_uv=False)
    rank = int((singular > negligible * singular[0]).sum())
    condition = float(singular[0] / max(singular[-1], negligible**2 * singular[0]))
    noise = max(noise, negligible**2)
    prior = noise / settings.prior * np.eye(len(length))
    triangle = np.linalg.qr(np.concatenate([columns, prior]), mode="r")
    root = np.linalg.solve(triangle, noise * np.eye(len(length)))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = root @ root.T
    return covariance, rank, condition


def bend_of(vector: Floats) -> shapes.Bend:
    """The bend of a curvature times direction (2,) [1/m]."""
    curvature = float(np.hypot(*vector))
    return shapes.Bend(curvature, float(np.arctan2(vector[1], vector[0])) if curvature else 0.0)


def uncovered_share(
    surface: Floats, area: float, points: Floats, noise: float, settings: ReportSettings
) -> float:
    """Share of places (k, 3) of a surface of an area that are far from points (n, 3)."""
    squares = np.einsum("ki,ki->k", surface, surface)[:, None]
    squares = squares + np.einsum("ni,ni->n", points, points)
    squares -= 2.0 * surface @ points.T
    near = settings.max_gap * math.sqrt(area / len(points)) + settings.noise_sigmas * noise
    return float((squares.min(axis=1) > near * near).mean())


def looseness(jacobian: Floats, covariance: Floats, exponents: Floats) -> float:
    """Standard deviation of a surface along its normals, root mean square over it.

    From derivatives (k, p) of the distances of places spread over it, and the covariance (p, p) of
    the parameters. The standard deviation of each of the `exponents` (2,) is limited to its value.
    """
    likely = np.ones(len(covariance))
    likely[3:5] = exponents / np.maximum(np.sqrt(np.diagonal(covariance)[3:5]), exponents)
    slopes = jacobian * likely
    return float(np.sqrt(np.einsum("kp,pq,kq->", slopes, covariance, slopes) / len(slopes)))


def scatter_factor(n_free: int, tail: float) -> float:
    """Upper estimate of the scatter over its estimate, with `n_free` degrees of freedom."""
    from scipy.special import chdtri

    return float(np.sqrt(n_free / chdtri(n_free, 1.0 - tail))) if n_free > 0 else 1.0


class SearchResult(NamedTuple):
    """The best fit."""

    parameters: Floats  # (p,), in the order of `distances.N_RIGID`
    axes: Floats  # (3, 3), before the rotation
    inliers: Bools  # (n,)
    converged: bool
    folded: bool  # whether the bend folds this solid, and those of all other starts
    bounded: bool  # whether a size, the position, a taper or the bend is at a bound
    starts: int  # number of starts
    steps: int  # of this fit, without the first two stages


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recovery(shapes.FittedSuperquadric):
    """A superquadric, tapered and bent, and how well its points determine it.

    Of equivalent poses it has the least turned one, with x no less than y. The rms is that of the
    inliers' residuals.
    """

    inliers: Bools  # whether each point was fitted, (n,)
    covariance: Floats  # of the parameters, in the order of `names`
    # Parameters: logarithms of the semi-axes; exponents; a small rotation [rad] about the solid's
    # own axes; position [m]; tapers; curvature of the bend times its direction [1/m].
    names: tuple[str, ...]
    rank: int = 0  # number of parameters that the points determine to first order
    # Largest over smallest singular value of the Jacobian, whose columns are scaled to length 1,
    # without negligible ones; 0 if nothing was fitted.
    condition: float = 0.0
    uncovered: float = 1.0  # share of the surface with no inlier as near as their spacing explains
    # Standard deviation of the surface along its normals, root mean square over it [m], that
    # results from the scatter of the points.
    looseness: float
    converged: bool = False
    warnings: tuple[RecoveryWarning, ...]
    choice: str | None = None  # name of the chosen shape, where exponents were a choice
    starts: int = 0  # number of starts
    steps: int = 0  # of the fit that was taken

    @property
    def lattice(self) -> None:
        """None: a superquadric has no control lattice."""

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the fit, by name."""
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
    bend: Floats  # curvature times direction, (2,)


def degeneracy(points: Floats, needed: int, min_aspect: float = 1e-6) -> Unfitted | None:
    """Why points (n, 3) cannot be fitted, or None if they can.

    `needed`: number of points; `min_aspect`: least extent over the largest, else they are flat.
    """
    if not len(points):
        return "too few points"
    centred = points - points.mean(axis=0)
    widths = np.ptp(centred @ principal_axes(centred), axis=0)
    if are_identical(float(widths.max()), points):
        return "identical points"
    thin = int((widths <= min_aspect * widths.max()).sum())
    if thin:
        return "collinear points" if thin == 2 else "coplanar points"
    return "too few points" if len(points) < needed else None


def unfitted(points: Floats, warps: Warps, warning: RecoveryWarning) -> Recovery:
    """An ellipsoid in the box along the points' principal axes, and why nothing was fitted."""
    size, axes, middle = _ellipsoid_about(points)
    solid = canonical(CanonicalSolid(size, np.ones(2), axes, np.zeros(2), np.zeros(2)))
    unit = float(size.max())
    residuals = np.zeros(len(points))
    if unit > 0.0:
        parameters = np.zeros((1, N_RIGID))
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


def _ellipsoid_about(points: Floats, min_aspect: float = 1e-3) -> tuple[Floats, Floats, Floats]:
    """Semi-axes (3,), at least `min_aspect` of the largest, axes (3, 3) and middle (3,)."""
    if not len(points):
        return np.zeros(3), np.eye(3), np.zeros(3)
    mean = points.mean(axis=0)
    axes = principal_axes(points - mean)
    places = (points - mean) @ axes
    low, high = places.min(axis=0), places.max(axis=0)
    size = 0.5 * (high - low)
    if are_identical(2.0 * float(size.max()), points):
        return np.zeros(3), axes, mean
    return np.maximum(size, min_aspect * size.max()), axes, mean + axes @ (0.5 * (low + high))


def are_identical(extent: float, points: Floats) -> bool:
    """Whether an extent [m] among points (n, 3) is only rounding."""
    return not extent > max(ROUNDING * float(np.abs(points).max()), MIN_EXTENT)


def canonical(solid: CanonicalSolid) -> CanonicalSolid:
    """The equivalent solid with its larger width along x, least turned from the world's axes."""
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
    """Units (p,) of the parameters of a fit, where the unit of length is `unit` [m]."""
    units = np.ones(warps.total)
    units[8:11] = unit
    units[warps.bend_columns] = 1.0 / unit
    return units


def names_of(warps: Warps) -> tuple[str, ...]:
    """Names of the parameters of a fit, in their order."""
    return NAMES + TAPER_NAMES * warps.taper + BEND_NAMES * warps.bend


def outlyingness(
    points: Floats,
    n_median_steps: int = 30,
    n_weight_steps: int = 10,
    full_weight: float = 1.45,
    min_spread: float = 1e-9,
) -> Floats:
    """Robust Mahalanobis distance (n,) of each of points (n, 3) from their middle.

    The middle begins at the point with the least sum of distances, which turns with the points
    (Weiszfeld, 1937), the covariance is reweighted. Points within `full_weight` median distances
    have full weight; `min_spread` of the variance is added in all directions, for flat points.
    """
    centre = points.mean(axis=0)
    for _ in range(n_median_steps):
        away = points - centre
        distance = np.sqrt(np.einsum("ij,ij->i", away, away))
        weight = 1.0 / np.maximum(distance, min_spread * float(distance.max()) + 1e-300)
        centre = weight @ points / weight.sum()
    weight, distance = np.ones(len(points)), np.ones(len(points))
    for _ in range(n_weight_steps):
        away = points - centre
        spread = (weight[:, None] * away).T @ away / weight.sum()
        least = min_spread * float(np.einsum("ij,ij->", away, away)) / len(points)
        spread += (least + 1e-300) * np.eye(3)
        distance = np.sqrt(np.einsum("ij,ij->i", away, np.linalg.solve(spread, away.T).T))
        limit = full_weight * float(np.median(distance))
        weight = np.minimum(1.0, limit / np.maximum(distance, limit + 1e-300)) ** 4
        weight[distance <= limit] = 1.0
        centre = weight @ points / weight.sum()
    return np.asarray(distance)


def core_of(points: Floats, share: float) -> Bools:
    """Points (n, 3) that are left when the most outlying share is removed, as a mask (n,)."""
    apart = outlyingness(points)
    return np.asarray(apart <= np.quantile(apart, 1.0 - share))
