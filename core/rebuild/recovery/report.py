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

    `core` says which; with None it is all of them.
    """
    which = slice(None) if core is None else core
    middle = points[0] + (points[which] - points[0]).mean(axis=0)
    away = points - middle
    unit = 2.0 * float(np.sqrt(np.einsum("ni,ni->n", away, away)[which].max()))
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
    points, middle, unit = scaled
    solid, place = _solid(found, warps), found.place()
    parameters = _parameters(solid, place, warps)
    distances, jacobian = normal_distances(parameters[None], points, solid.axes[None], warps)
    residuals, inliers = distances[0], found.inliers
    count = int(inliers.sum())
    rms = float(np.sqrt(np.mean(residuals[inliers] ** 2)))
    free = np.ones(warps.total, bool)
    free[3:5] = not chosen
    spread = noise or rms * float(np.sqrt(count / max(count - int(free.sum()), 1)))
    known = certainty(jacobian[0][inliers], spread, free)
    units = np.diag(units_of(warps, unit))
    units[8:11, 8:11] = unit * solid.axes  # positions were along these
    share = 1.0 if found.folded else _uncovered(solid, place, points[inliers], rms)
    return Recovery(
        size=unit * solid.size,
        exponents=solid.exponents,
        pose=pose_of(middle + unit * place, solid.axes),
        taper=solid.taper,
        bend=bend_of(solid.bend / unit),
        residuals=unit * residuals,
        inliers=inliers,
        rms=unit * rms,
        covariance=units @ known.covariance @ units.T,
        names=names_of(warps),
        rank=known.rank,
        condition=known.condition,
        uncovered=share,
        converged=found.converged,
        doubts=_doubts(found, solid, rms, share),
        choice=name_of(solid.exponents) if chosen else None,
        starts=found.starts,
        steps=found.steps,
    )


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


def _uncovered(solid: Solid, place: Floats, points: Floats, noise: float) -> float:
    base = Superquadric(solid.size, solid.exponents)
    surface = surface_of(base, solid.taper, bend_of(solid.bend), COVER_LEVEL)
    # The same places each time: nothing here is left to chance.
    sampled = area_samples(surface, SAMPLES, np.random.default_rng(0))
    return uncovered(sampled @ solid.axes.T + place, surface.area, points, noise)


def _doubts(found: Found, solid: Solid, rms: float, share: float) -> tuple[Doubt, ...]:
    doubts: list[tuple[bool, Doubt]] = [
        (not found.converged, "not converged"),
        (found.bounded, "at a bound"),
        (found.folded, "folded"),
        (float(solid.size.min()) < FLAT * rms, "flat"),
        (share > MOST_UNCOVERED, "one-sided"),
    ]
    return tuple(doubt for applies, doubt in doubts if applies)
