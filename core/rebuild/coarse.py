"""The object as one superquadric, tapered and bent where its points ask for it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.frames import split_pose
from palpate.core.rebuild.recovery.recover import recover
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.surface.sampled_patch import SampledPatch, sampled_patch
from palpate.core.shapes.parametric import regular
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper

MOST_POINTS = 600
"""More are thinned out: a superquadric has 15 parameters."""
WARPS = ((False, False), (True, False), (True, True))
"""Of which fits the best is taken: neither tapered nor bent, tapered, both."""
USELESS = frozenset({"folded", "not converged"})
"""A fit with one of these doubts is taken only if there is no other."""


def fit_coarse(points: ArrayLike, noise: float | None = None) -> Recovery:
    """The superquadric that explains points best for its number of parameters.

    Parameters
    ----------
    points : (n, 3) array
        On the surface, in any unit; contacts of a hand, or points of contours.
    noise : float, optional
        Standard deviation of a coordinate, if it is known: what is less explains nothing.

    Returns
    -------
    Recovery
        Tapered and bent where that pays. If the points are too few, or all in a plane, it is an
        ellipsoid in their extents, and says so in its doubts.

    Raises
    ------
    ValueError
        If the points are not finite, or the noise is not positive.

    Notes
    -----
    Fung, 1999, 3.2.2, step 1, with pose, taper, bend and free exponents. Chosen by Schwarz,
    *Estimating the dimension of a model*, 1978.
    """
    places = finite_array("points", points, (None, 3))
    if noise is not None:
        positive("noise", noise, "in the unit of the points")
    if len(places) > MOST_POINTS:
        places = places[np.linspace(0, len(places) - 1, MOST_POINTS).round().astype(int)]
    fits = [recover(places, taper=taper, bend=bend, noise=noise) for taper, bend in WARPS]
    fitted = [fit for fit in fits if fit.fitted]
    if not fitted:
        return fits[0]
    sound = [fit for fit in fitted if not USELESS.intersection(fit.doubts)]
    return min(sound or fitted[:1], key=lambda fit: _information(fit, len(places), noise or 0.0))


def coarse_patch(recovery: Recovery) -> SampledPatch:
    """Its surface, from the lower end of its own axis to the upper one.

    Raises
    ------
    ValueError
        If it has no extent.
    """
    base = Superquadric(recovery.size, recovery.exponents)
    taper = Taper(float(recovery.taper[0]), float(recovery.taper[1]), float(recovery.size[2]))
    position, axes = split_pose(recovery.pose)

    def grid(v: Floats, turns: Floats) -> Floats:
        eta, omega = np.meshgrid(np.pi * (v - 0.5), np.pi * (2.0 * turns - 1.0), indexing="ij")
        points = regular(base, eta.ravel(), omega.ravel()).points
        points = recovery.bend(taper(points)) @ axes.T + position
        return points.reshape(*eta.shape, 3)

    return sampled_patch(grid)


def _information(fit: Recovery, count: int, noise: float) -> float:
    """Schwarz's criterion: smaller is better."""
    rounding = max(np.finfo(float).eps * float(fit.size.max()), np.finfo(float).tiny)
    missed = max(math.hypot(fit.rms, noise), rounding)
    return 2.0 * count * math.log(missed) + len(fit.names) * math.log(count)
