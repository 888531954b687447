"""The object as one superquadric, tapered and bent where its points ask for it."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.rebuild.recovery.recover import recover
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.surface.sampled_patch import SampledPatch, sampled_patch
from palpate.core.shapes.parametric import regular
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper

MOST_POINTS = 600
"""More are thinned out: a superquadric has 15 parameters."""


def fit_coarse(points: Floats, noise: float | None = None) -> Recovery:
    """The superquadric that explains points best for its number of parameters.

    Parameters
    ----------
    points : (n, 3) array
        On the surface.
    noise : float, optional
        Standard deviation of a coordinate, if it is known.

    Notes
    -----
    With and without taper and bend, chosen by Schwarz, *Estimating the dimension of a model*,
    1978.
    """
    chosen = np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).round().astype(int)
    fits = [
        recover(points[chosen], taper=warped, bend=warped, noise=noise) for warped in (False, True)
    ]
    fits = [fit for fit in fits if fit.fitted] or fits[:1]
    return min(fits, key=lambda fit: _information(fit, len(chosen)))


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


def _information(fit: Recovery, count: int) -> float:
    """Schwarz's criterion: smaller is better."""
    smallest = max(fit.rms, np.finfo(float).eps * float(fit.size.max()), np.finfo(float).tiny)
    return 2.0 * count * float(np.log(smallest)) + len(fit.names) * float(np.log(count))
