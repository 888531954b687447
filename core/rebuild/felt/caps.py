"""Closing the ends: what the side promises, corrected by what was felt.

Towards an end the side narrows as a superellipse does, from a ball's over a rounded edge's to
a sharp one's. The superellipse that fits the side's last stretch is carried on to the end's
known height; where the end was touched, a thin plate through what the touches found beside it
corrects the promise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator

from palpate.core.arrays import Floats

RINGS = 24
"""Rings from the rim of an end to its middle."""
EXPONENTS = np.geomspace(1.0, 128.0, 57)
"""Exponents that are tried: 1 a cone, 2 an ellipse, 128 an edge; eight from each to its double,
so that those of a ball are among them."""
TABLE = 512
"""Places at which a profile is tabulated to be inverted."""
REFINEMENTS = 8
"""Fixed-point steps by which a place from the table is refined."""
LEAST_TREND = -0.99
"""A side may narrow by no more than this share besides: it has to reach its end."""
MOST_SITES = 240
"""Points through which a plate is laid."""
PLATE_SMOOTHING = 1e-6
"""Of the plate, in units of its radius."""
LARGEST_SHARE = 0.9
"""Nearer to the rim a height says nothing: the profile may be vertical there."""
OVERSHOOT = 0.05
"""A corrected end may rise past its known height by this share of its own height or width: a
touch feels the highest point only to the nearest taxel, and a plate must not swing."""
LEAST_SITES = 12
"""Fewer felt points correct nothing."""


@dataclass(frozen=True, slots=True)
class Profile:
    """How the radius goes to zero: (1 - zeta^p)^(1/q) (1 + trend zeta), zeta from 0 to 1."""

    begin: float
    """Height at which zeta is 0, m."""
    end: float
    """Height at which it is 1 and the surface closes, m; above `begin` or below it."""
    p: float
    """Exponent along the height."""
    q: float
    """Exponent across."""
    trend: float
    """Change of the radius besides, from `begin` to `end`, as a share."""
    misfit: float
    """Root mean square distance of the radii to which it was fitted, m."""

    def heights(self, rim: float, shares: Floats) -> Floats:
        """Heights at which the radius is these shares of the rim's radius, m.

        Parameters
        ----------
        rim : float
            Height of the rim, m.
        shares : array
            From 1 at the rim to 0 at the end.
        """
        at_rim = (rim - self.begin) / (self.end - self.begin)
        left = np.linspace(1.0, 0.0, TABLE) ** 4  # close together where the radius falls
        zeta = 1.0 - (1.0 - at_rim) * left
        radius = _radii(zeta, self.p, self.q) * (1.0 + self.trend * zeta)
        falling = np.minimum.accumulate(radius / radius[0])
        found = np.interp(shares, falling[::-1], zeta[::-1])
        for _ in range(REFINEMENTS):  # exact at once where there is no trend
            wide = np.maximum(shares * radius[0] / (1.0 + self.trend * found), 0.0)
            found = np.maximum(1.0 - wide**self.q, 0.0) ** (1.0 / self.p)
        result: Floats = self.begin + (self.end - self.begin) * found
        return result


def fit_profile(heights: Floats, radii: Floats, end: float) -> Profile:
    """Superellipse that best follows mean radii towards an end of known height.

    Parameters
    ----------
    heights : (n,) array
        From inside the object towards the end, m.
    radii : (n,) array
        Mean radius of the side there, m.
    end : float
        Height at which the object ends, m.

    Notes
    -----
    The radius may change linearly besides. For each pair of exponents the two coefficients
    follow by orthogonal projection (QR), for all pairs at once.
    """
    begin = float(heights[0])
    zeta = np.clip((heights - begin) / (end - begin), 0.0, 1.0 - 1e-12)
    share = _radii(zeta, EXPONENTS[:, None, None], EXPONENTS[None, :, None])
    basis = np.stack([share, share * zeta], axis=-1)
    directions, triangle = np.linalg.qr(basis)
    along = np.einsum("pqnk,n->pqk", directions, radii)
    rest = radii - np.einsum("pqnk,pqk->pqn", directions, along)
    misfit = np.sqrt(np.mean(rest**2, axis=-1))
    best = np.unravel_index(int(misfit.argmin()), misfit.shape)
    constant, linear = np.linalg.solve(triangle[best], along[best])
    return Profile(
        begin=begin,
        end=end,
        p=float(EXPONENTS[best[0]]),
        q=float(EXPONENTS[best[1]]),
        trend=max(float(linear / constant), LEAST_TREND),
        misfit=float(misfit[best]),
    )


def _radii(zeta: Floats, p: Floats | float, q: Floats | float) -> Floats:
    result: Floats = np.maximum(1.0 - zeta**p, 0.0) ** (1.0 / q)
    return result


def cap_rings(profile: Profile, middle: Floats, rim: Floats, sites: Floats) -> Floats:
    """Rings (rings, n, 3) from a rim to the middle of an end, the last one a point.

    Parameters
    ----------
    profile : Profile
        How the side narrows.
    middle : (2,) array
        Place of the axis, m.
    rim : (n, 3) array
        The last ring of the side, level, evenly around the axis, m.
    sites : (k, 3) array
        Points felt on the end, m; none if it was not touched.
    """
    shares = np.cos(0.5 * np.pi * np.arange(1, RINGS + 1) / RINGS)
    shares[-1] = 0.0
    places = middle + shares[:, None, None] * (rim[:, :2] - middle)
    level = profile.heights(float(rim[0, 2]), shares)
    heights = np.repeat(level[:, None], len(rim), axis=1)
    if len(sites) >= LEAST_SITES:
        corrected = heights + _correction(profile, middle, rim, thin_out(sites), places)
        height = float(rim[0, 2])
        radius = float(np.linalg.norm(rim[:, :2] - middle, axis=1).min())
        room = OVERSHOOT * min(radius, abs(profile.end - height))
        beyond = profile.end + np.copysign(room, profile.end - height)
        heights = np.clip(corrected, min(height, beyond), max(height, beyond))
    return np.concatenate([places, heights[:, :, None]], axis=-1)


def _correction(
    profile: Profile, middle: Floats, rim: Floats, sites: Floats, places: Floats
) -> Floats:
    """What the touches found above the profile, as a thin plate that is 0 at the rim."""
    scale = float(np.linalg.norm(rim[:, :2] - middle, axis=1).max())
    shares = shares_of(middle, rim, sites)
    sites, shares = sites[shares < LARGEST_SHARE], shares[shares < LARGEST_SHARE]
    found = sites[:, 2] - profile.heights(float(rim[0, 2]), shares)
    every = max(1, len(rim) // 48)
    knots = np.concatenate([sites[:, :2], rim[::every, :2]])
    values = np.concatenate([found, np.zeros(len(rim[::every]))])
    plate = RBFInterpolator(
        (knots - middle) / scale,
        values / scale,
        kernel="thin_plate_spline",
        smoothing=PLATE_SMOOTHING,
    )
    flat = ((places - middle) / scale).reshape(-1, 2)
    result: Floats = scale * plate(flat).reshape(places.shape[:2])
    return result


def shares_of(middle: Floats, rim: Floats, points: Floats) -> Floats:
    """Distance of points (n, 3) from the axis, as a share of the rim's on their azimuth."""
    away, edge = points[:, :2] - middle, rim[:, :2] - middle
    turns = np.arctan2(edge[:, 1], edge[:, 0])
    radius = np.interp(
        np.arctan2(away[:, 1], away[:, 0]),
        *_sorted(turns, np.linalg.norm(edge, axis=1)),
        period=2.0 * np.pi,
    )
    shares: Floats = np.minimum(np.linalg.norm(away, axis=1) / radius, 1.0)
    return shares


def _sorted(keys: Floats, values: Floats) -> tuple[Floats, Floats]:
    order = np.argsort(keys)
    return keys[order], values[order]


def thin_out(points: Floats, most: int = MOST_SITES) -> Floats:
    """At most this many of the points (n, 3), evenly taken from their order."""
    if len(points) <= most:
        return points
    chosen: Floats = points[np.linspace(0, len(points) - 1, most).round().astype(int)]
    return chosen
