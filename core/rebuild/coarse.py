"""A superquadric as a closed solid, tapered and bent if that explains its points better.

Models are compared by the Bayesian information criterion (Schwarz, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.poses import Pose
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.recovery import Recovery, recover
from palpate.core.rebuild.solid import LatticeSolid
from palpate.core.rebuild.surface import (
    SampledPatch,
    closed_surface,
    placed,
    sampled_patch,
)
from palpate.core.shapes import Superquadric, Taper, regular_points

WARPS = ((False, False), (True, False), (True, True))  # whether tapered, whether bent
UNSOUND = frozenset({"folded", "not converged"})  # warnings of fits that are a last resort


def coarse_solid(evidence: Evidence) -> LatticeSolid:
    """The superquadric of the contours; ValueError if they do not determine one."""
    points = np.concatenate(_raised(evidence.slices.points, evidence.slices.heights))
    fit = fit_coarse(points, evidence.noise)
    if not fit.fitted:
        raise ValueError(f"contours must determine a superquadric, got {fit.warnings[0]}")
    surface = placed(closed_surface((coarse_patch(fit),)), evidence.frame)
    return LatticeSolid(surface=surface, method="coarse", evidence=evidence, model=fit)


def coarse_patch(recovery: Recovery) -> SampledPatch:
    """The surface of a superquadric, from the lower to the upper end of its own axis."""
    base = Superquadric(recovery.size, recovery.exponents)
    taper = Taper(float(recovery.taper[0]), float(recovery.taper[1]), float(recovery.size[2]))
    position, axes = Pose.from_array(recovery.pose)

    def grid(v: Floats, turns: Floats) -> Floats:
        eta, omega = np.meshgrid(np.pi * (v - 0.5), np.pi * (2.0 * turns - 1.0), indexing="ij")
        points = regular_points(base, eta.ravel(), omega.ravel()).points
        points = recovery.bend(taper(points)) @ axes.T + position
        return points.reshape(*eta.shape, 3)

    return sampled_patch(grid)


def _raised(rings: Sequence[Floats], heights: Floats) -> list[Floats]:
    """Rings (n, 2) at their heights, (n, 3) each."""
    pairs = zip(rings, heights, strict=True)
    return [np.column_stack([ring, np.full(len(ring), height)]) for ring, height in pairs]


def fit_coarse(points: ArrayLike, noise: float | None = None, max_points: int = 600) -> Recovery:
    """The superquadric that explains points (n, 3) best for its number of parameters.

    `noise` is the standard deviation of a coordinate, if it is known: smaller residuals are no
    better. Points beyond `max_points` are thinned. The superquadric is tapered and bent where the
    criterion improves. Of too few points, or points in a plane, it is an ellipsoid in their
    extents, with a warning. Raises ValueError if points are not finite, or the noise is not
    positive. Fung, 1999, 3.2.2, step 1, with pose, taper, bend and free exponents; Schwarz,
    *Estimating the dimension of a model*, 1978.
    """
    places = finite_array("points", points, (None, 3))
    if noise is not None:
        positive("noise", noise, "in the unit of the points")
    if len(places) > max_points:
        places = places[np.linspace(0, len(places) - 1, max_points).round().astype(int)]
    count = len(places)

    def criterion(rms: float, n_parameters: int) -> float:
        """Schwarz's criterion: smaller is better."""
        return 2.0 * count * math.log(rms) + n_parameters * math.log(count)

    def information(fit: Recovery) -> float:
        rounding = max(np.finfo(float).eps * float(fit.size.max()), np.finfo(float).tiny)
        return criterion(max(math.hypot(fit.rms, noise or 0.0), rounding), len(fit.names))

    fits: list[Recovery] = []
    for taper, bend in WARPS:
        if noise is not None and (sound := _sound(fits)):
            best = min(map(information, sound))
            # With two more parameters, even residuals as small as the noise are no improvement.
            if best <= criterion(noise, len(fits[-1].names) + 2):
                break
        fits.append(recover(places, taper=taper, bend=bend, noise=noise))
    sound = _sound(fits)
    fitted = [fit for fit in fits if fit.fitted]
    return min(sound, key=information) if sound else (fitted or fits)[0]


def _sound(fits: Sequence[Recovery]) -> list[Recovery]:
    return [fit for fit in fits if fit.fitted and not UNSOUND.intersection(fit.warnings)]
