"""From the best fit to what is said of it, in metres: covariance, rank, cover, looseness, warnings.

The covariance tells how well points determine each parameter; parameters may be open and the
surface yet be certain, as the turn of a ball is: looseness says how far the surface may be off.
What no point has been near is another matter, and told by itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import pose_of, rotations_from_vectors
from palpate.core.rebuild.recovery.distances import Warps, normal_distances
from palpate.core.rebuild.recovery.record import (
    CanonicalSolid,
    Recovery,
    RecoveryWarning,
    bend_of,
    canonical,
    name_of,
    names_of,
    together,
    units_of,
)
from palpate.core.shapes import Superquadric, area_samples, sampled_surface

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


class Scaled(NamedTuple):
    """Points in a unit of their own."""

    points: Floats  # (n, 3), about the origin, none but outliers farther from it than 1/2
    middle: Floats  # Where the origin is, (3,), m
    unit: float  # m


def scaled_down(points: Floats, core: Bools | None = None) -> Scaled:
    """Points (n, 3) about the mean of some, divided by twice these' largest distance from it.

    `core` says which; with None, or if those are all in one place, it is all of them.
    """
    if core is None or together(float(np.ptp(points[core], axis=0).max()), points):
        core = np.ones(len(points), bool)
    middle = points[0] + (points[core] - points[0]).mean(axis=0)
    away = points - middle
    unit = 2.0 * float(np.sqrt(np.einsum("ni,ni->n", away, away)[core].max()))
    return Scaled(away / unit, middle, unit)


def reported(
    scaled: Scaled, warps: Warps, found: SearchResult, noise: float | None, *, chosen: bool
) -> Recovery:
    """What is said of a fit.

    Parameters
    ----------
    scaled : Scaled
        The points that were fitted.
    warps : Warps
        What was fitted.
    found : Found
        The fit.
    noise : float or None
        Standard deviation of the points in their unit, if it is known.
    chosen : bool
        Whether the exponents were chosen, not fitted.
    """
    (points, middle, unit), inliers = scaled, found.inliers
    solid, place = _solid(found, warps), found.place()
    parameters = _parameters(solid, place, warps)
    (residuals,), (jacobian,) = normal_distances(parameters[None], points, solid.axes[None], warps)
    rms = float(np.sqrt(np.mean(residuals[inliers] ** 2)))
    free = _free(warps, chosen=chosen)
    left = int(inliers.sum()) - int(free.sum())
    known = certainty(jacobian[inliers], noise or _scatter(residuals[inliers], left), free)
    share, loose = 1.0, 1.0  # of what is folded, nothing is known
    if not found.folded:
        places, area = _surface(solid, place)
        share = uncovered(places, area, points[inliers], rms)
        slopes = normal_distances(parameters[None], places, solid.axes[None], warps)[1][0]
        loose = looseness(slopes, known.covariance, solid.exponents)
    cautious = loose * (caution(left) if noise is None else 1.0)
    return Recovery(
        size=unit * solid.size,
        exponents=solid.exponents,
        pose=pose_of(middle + unit * place, solid.axes),
        taper=solid.taper,
        bend=bend_of(solid.bend / unit),
        residuals=unit * residuals,
        inliers=inliers,
        rms=unit * rms,
        covariance=_in_metres(known.covariance, solid.axes, warps, unit),
        names=names_of(warps),
        rank=known.rank,
        condition=known.condition,
        uncovered=share,
        looseness=unit * loose,
        converged=found.converged,
        doubts=_warnings(found, solid, rms, share, cautious),
        choice=name_of(solid.exponents) if chosen else None,
        starts=found.starts,
        steps=found.steps,
    )


def _solid(found: SearchResult, warps: Warps) -> CanonicalSolid:
    parameters = found.parameters
    return canonical(
        CanonicalSolid(
            np.exp(parameters[:3]),
            parameters[3:5],
            found.turned_axes(),
            parameters[warps.taper_columns] if warps.taper else np.zeros(2),
            parameters[warps.bend_columns] if warps.bend else np.zeros(2),
        )
    )


def _parameters(solid: CanonicalSolid, place: Floats, warps: Warps) -> Floats:
    """Those of `normal_distance`, in the solid's own axes."""
    parts = [np.log(solid.size), solid.exponents, np.zeros(3), solid.axes.T @ place]
    parts += [solid.taper] * warps.taper + [solid.bend] * warps.bend
    return np.concatenate(parts)


def _free(warps: Warps, *, chosen: bool) -> Bools:
    """Which parameters were fitted, (p,)."""
    free = np.ones(warps.total, bool)
    free[3:5] = not chosen
    return free


def certainty(jacobian: Floats, noise: float, free: Bools) -> Certainty:
    """How well points determine parameters.

    Parameters
    ----------
    jacobian : (n, p) array
        Derivatives of the residuals by the parameters.
    noise : float
        Standard deviation of the residuals.
    free : (p,) array
        Which parameters were fitted; the others have no variance.

    Returns
    -------
    Certainty
        Columns and directions that count as nothing lower the rank, and keep the variance that
        they have before there are points. The condition is that of the other columns.
    """
    columns = jacobian[:, free]
    length = np.sqrt(np.einsum("np,np->p", columns, columns))
    kept = length > NEGLIGIBLE * length.max()
    singular = np.linalg.svd(columns[:, kept] / length[kept], compute_uv=False)
    rank = int((singular > NEGLIGIBLE * singular[0]).sum())
    condition = float(singular[0] / max(singular[-1], NEGLIGIBLE**2 * singular[0]))
    # By the triangle of Jacobian and prior together: no square of either is formed.
    noise = max(noise, NEGLIGIBLE**2)
    prior = noise / PRIOR * np.eye(len(length))
    triangle = np.linalg.qr(np.concatenate([columns, prior]), mode="r")
    root = np.linalg.solve(triangle, noise * np.eye(len(length)))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = root @ root.T
    return Certainty(covariance, rank, condition)


def _scatter(residuals: Floats, left: int) -> float:
    """Standard deviation of points, from what a fit left of it; unknown if it bent to them all."""
    if left <= 0:
        return UNKNOWN
    return float(np.sqrt(residuals @ residuals / left))


def _surface(solid: CanonicalSolid, place: Floats) -> tuple[Floats, float]:
    """Places spread evenly over a solid, and its area."""
    base = Superquadric(solid.size, solid.exponents)
    surface = sampled_surface(base, solid.taper, bend_of(solid.bend), COVER_LEVEL)
    # The same places each time: nothing here is left to chance.
    sampled = area_samples(surface, SAMPLES, np.random.default_rng(0))
    return sampled @ solid.axes.T + place, surface.area


def uncovered(surface: Floats, area: float, points: Floats, noise: float) -> float:
    """Share of places spread evenly over a surface that are far from all points.

    Parameters
    ----------
    surface : (k, 3) array
        The places.
    area : float
        Of the surface.
    points : (n, 3) array
        What the surface was fitted to.
    noise : float
        Standard deviation of the points.
    """
    squares = np.einsum("ki,ki->k", surface, surface)[:, None] + np.einsum(
        "ni,ni->n", points, points
    )
    squares -= 2.0 * surface @ points.T
    near = SPACING * math.sqrt(area / len(points)) + FAR * noise
    return float((squares.min(axis=1) > near * near).mean())


def looseness(jacobian: Floats, covariance: Floats, exponents: Floats) -> float:
    """Standard deviation of a surface along its normals, root mean square over it.

    Parameters
    ----------
    jacobian : (k, p) array
        Derivatives of the distances of places spread evenly over the surface.
    covariance : (p, p) array
        Of the parameters: see `normal_distance.RIGID`.
    exponents : (2,) array
        What was fitted. To first order an exponent near 0 might be anything; here none is off by
        more than itself.
    """
    likely = np.ones(len(covariance))
    likely[3:5] = exponents / np.maximum(np.sqrt(np.diagonal(covariance)[3:5]), exponents)
    slopes = jacobian * likely
    return float(np.sqrt(np.einsum("kp,pq,kq->", slopes, covariance, slopes) / len(slopes)))


def caution(left: int) -> float:
    """Factor by which the scatter may be larger than it was found, with some points left over.

    `left` is by how many points there are more than parameters; none at all, and it was not found.
    """
    from scipy.special import chdtri

    return float(np.sqrt(left / chdtri(left, 1.0 - TAIL))) if left > 0 else 1.0


def _in_metres(covariance: Floats, axes: Floats, warps: Warps, unit: float) -> Floats:
    """A covariance (p, p) of parameters in a unit of length, with positions along `axes`."""
    units = np.diag(units_of(warps, unit))
    units[8:11, 8:11] = unit * axes
    return np.asarray(units @ covariance @ units.T)


def _warnings(
    found: SearchResult, solid: CanonicalSolid, rms: float, share: float, loose: float
) -> tuple[RecoveryWarning, ...]:
    doubts: list[tuple[bool, RecoveryWarning]] = [
        (not found.converged, "not converged"),
        (found.bounded, "at a bound"),
        (found.folded, "folded"),
        (float(solid.size.min()) < FLAT * rms, "flat"),
        (share > MOST_UNCOVERED, "one-sided"),
        (loose > LOOSE, "loose"),
    ]
    return tuple(doubt for applies, doubt in doubts if applies)


class SearchResult(NamedTuple):
    """The best fit."""

    parameters: Floats  # (p,), see `normal_distance.RIGID`
    axes: Floats  # (3, 3): what its rotation vector turns
    inliers: Bools  # (n,)
    converged: bool
    folded: bool  # True if no start led to a solid that its bend does not fold; this one does
    # True if a size, the place, a widening or the bend is at the end of what its start allows.
    bounded: bool
    starts: int  # Starts tried
    steps: int  # Steps tried by the fit that was taken, those of its first stage left out

    def turned_axes(self) -> Floats:
        """The solid's axes (3, 3)."""
        result: Floats = self.axes @ rotations_from_vectors(self.parameters[None, 5:8])[0]
        return result

    def place(self) -> Floats:
        """Where the solid's middle is, (3,)."""
        result: Floats = self.axes @ self.parameters[8:11]
        return result


class Certainty(NamedTuple):
    """Covariance and rank of a fit."""

    covariance: Floats  # (p, p)
    rank: int
    condition: float
