"""From the best fit to what is said of it, in metres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.frames import pose_of
from palpate.core.rebuild.recovery.canonical import Solid, canonical
from palpate.core.rebuild.recovery.certainty import certainty
from palpate.core.rebuild.recovery.choices import name_of
from palpate.core.rebuild.recovery.cover import SAMPLES, uncovered
from palpate.core.rebuild.recovery.degenerate import together
from palpate.core.rebuild.recovery.looseness import caution, looseness
from palpate.core.rebuild.recovery.normal_distance import Warps, normal_distances
from palpate.core.rebuild.recovery.recovery import Doubt, Recovery, bend_of, names_of, units_of
from palpate.core.rebuild.recovery.search import Found
from palpate.core.shapes.area_samples import area_samples, surface_of
from palpate.core.shapes.superquadric import Superquadric

MOST_UNCOVERED = 0.1
"""The most in some hundred fits to 60 points all around was 0.08."""
COVER_LEVEL = 2
"""320 facets: enough to draw a few hundred places from."""
FLAT = 3.0
"""Root mean square residuals that the least semi-axis must exceed."""
LOOSE = 0.02
"""Of the points' diameter: what a surface may be off and still be recovered."""
UNKNOWN = 1.0
"""Of the points' diameter: the scatter of points that are no more than the parameters."""


class Scaled(NamedTuple):
    """Points in a unit of their own."""

    points: Floats
    """(n, 3), about the origin, none but outliers farther from it than 1/2."""
    middle: Floats
    """Where the origin is, (3,), m."""
    unit: float
    """m."""


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
    scaled: Scaled, warps: Warps, found: Found, noise: float | None, *, chosen: bool
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
        doubts=_doubts(found, solid, rms, share, cautious),
        choice=name_of(solid.exponents) if chosen else None,
        starts=found.starts,
        steps=found.steps,
    )


def _free(warps: Warps, *, chosen: bool) -> Bools:
    """Which parameters were fitted, (p,)."""
    free = np.ones(warps.total, bool)
    free[3:5] = not chosen
    return free


def _in_metres(covariance: Floats, axes: Floats, warps: Warps, unit: float) -> Floats:
    """A covariance (p, p) of parameters in a unit of length, with positions along `axes`."""
    units = np.diag(units_of(warps, unit))
    units[8:11, 8:11] = unit * axes
    return np.asarray(units @ covariance @ units.T)


def _scatter(residuals: Floats, left: int) -> float:
    """Standard deviation of points, from what a fit left of it; unknown if it bent to them all."""
    if left <= 0:
        return UNKNOWN
    return float(np.sqrt(residuals @ residuals / left))


def _solid(found: Found, warps: Warps) -> Solid:
    parameters = found.parameters
    return canonical(
        Solid(
            np.exp(parameters[:3]),
            parameters[3:5],
            found.turned_axes(),
            parameters[warps.taper_columns] if warps.taper else np.zeros(2),
            parameters[warps.bend_columns] if warps.bend else np.zeros(2),
        )
    )


def _parameters(solid: Solid, place: Floats, warps: Warps) -> Floats:
    """Those of `normal_distance`, in the solid's own axes."""
    parts = [np.log(solid.size), solid.exponents, np.zeros(3), solid.axes.T @ place]
    parts += [solid.taper] * warps.taper + [solid.bend] * warps.bend
    return np.concatenate(parts)


def _surface(solid: Solid, place: Floats) -> tuple[Floats, float]:
    """Places spread evenly over a solid, and its area."""
    base = Superquadric(solid.size, solid.exponents)
    surface = surface_of(base, solid.taper, bend_of(solid.bend), COVER_LEVEL)
    # The same places each time: nothing here is left to chance.
    sampled = area_samples(surface, SAMPLES, np.random.default_rng(0))
    return sampled @ solid.axes.T + place, surface.area


def _doubts(
    found: Found, solid: Solid, rms: float, share: float, loose: float
) -> tuple[Doubt, ...]:
    doubts: list[tuple[bool, Doubt]] = [
        (not found.converged, "not converged"),
        (found.bounded, "at a bound"),
        (found.folded, "folded"),
        (float(solid.size.min()) < FLAT * rms, "flat"),
        (share > MOST_UNCOVERED, "one-sided"),
        (loose > LOOSE, "loose"),
    ]
    return tuple(doubt for applies, doubt in doubts if applies)
