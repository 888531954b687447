"""Families of shapes in which a solid narrows from its last contour to its end.

A profile tells the radius as a share of the last contour's, over the way to the end: 0 at that
contour, 1 at the end. Slope and bend come from the squared radius, which is a quadratic of the
height for every quadric.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.rounded import Rounded

TREND_CONTOURS = 3
"""Contours through which the squared radius is carried on."""
WIDEST = 0.5
"""A flat end's wall flares by no more than this share."""
CONE = 1e-6
"""A conic that is nearer to a cone than this is one: its tip is sharp."""
SHOULDER_CONTOURS = 6
"""Contours to which a superellipse is fitted."""
SHOULDER_REACH = 10
"""The contour, counted from the end, at which a superellipse is widest."""
EXPONENTS = np.geomspace(1.0, 32.0, 41)
"""Exponents of superellipses that are tried, along the height and across: eight from each to its
double, so that those of a ball are among them."""
FLARED = np.geomspace(1.0, 128.0, 57)
"""Those that are tried where contours lie so close together that they show sharper edges."""
LEAST_TREND, MOST_TREND = -0.9, 2.0
"""Of a wall: it must be there when the end comes."""
NEAR_END = 1e-9
"""A contour lies at least this share before the end."""


class Flat(NamedTuple):
    """A straight wall, then a level disc."""

    slope: float
    """Change of the radius over the whole way, from -1, a cone, upwards."""

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last contour's."""
        shares: Floats = 1.0 + self.slope * way
        return shares


class Conic(NamedTuple):
    """A conic section that closes at the end: r^2 = 1 + 2 s x - (1 + 2 s) x^2."""

    slope: float
    """s: 0 is half an ellipse, -1/2 a paraboloid, near -1 a cone."""

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last contour's."""
        square = (1.0 - way) * (1.0 + (1.0 + 2.0 * self.slope) * way)
        shares: Floats = np.sqrt(np.maximum(square, 0.0))
        return shares


class Superellipse(NamedTuple):
    """A shoulder: (1 - zeta^p)^(1/q) (1 + trend zeta), with zeta = 1 at the end."""

    begin: float
    """zeta at the last contour."""
    p: float
    """Exponent along the height."""
    q: float
    """Exponent across."""
    trend: float = 0.0
    """Change of the radius besides, as a share: of a wall that flares or narrows."""

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last contour's."""
        zeta = self.begin + (1.0 - self.begin) * np.asarray(way)
        shares: Floats = self._radius(zeta) / self._radius(np.array(self.begin))
        return shares

    def _radius(self, zeta: Floats) -> Floats:
        radius: Floats = shoulder(zeta, self.p, self.q) * (1.0 + self.trend * zeta)
        return radius


Profile = Flat | Conic | Superellipse | Rounded


class Beyond(NamedTuple):
    """What was felt of an end beyond the last contour."""

    depths: Floats
    """Outward coordinates, (n,), between the last contour and the end."""
    radii: Floats
    """Mean radii there, (n,), as if the last contour's had shrunk or grown as a whole."""
    weights: Floats
    """Level part of the normals, (n,), by which a radius counts."""

    def miss(self, profile: Profile, rim: float, end: float, radius: float) -> float:
        """Root mean square distance of a profile that has `radius` at the rim."""
        shares = profile.shares((self.depths - rim) / (end - rim))
        return float(np.sqrt(np.mean((self.weights * (radius * shares - self.radii)) ** 2)))


class Trend(NamedTuple):
    """Squared radius over the outward coordinate, about the last contour."""

    square: float
    """At the last contour."""
    slope: float
    bend: float
    """Half its second derivative."""

    def at(self, beyond: float) -> float:
        """Squared radius this far beyond the last contour; negative beyond a pole."""
        return self.square + beyond * (self.slope + beyond * self.bend)


def trend_of(depths: Floats, radii: Floats) -> Trend:
    """Quadratic through the last three squared radii; of lower degree through fewer.

    Parameters
    ----------
    depths : (n,) array
        Outward coordinates of the contours, ascending.
    radii : (n,) array
        Mean radii there.
    """
    count = min(TREND_CONTOURS, len(depths))
    depths, square = depths[-count:] - depths[-1], radii[-count:] ** 2
    if count == 1:
        return Trend(float(square[-1]), 0.0, 0.0)
    scale = float(-depths[0])
    rows = np.vander(depths / scale, count, increasing=True)
    found = np.linalg.solve(rows, square)
    bend = float(found[2]) / scale**2 if count == TREND_CONTOURS else 0.0
    return Trend(float(square[-1]), float(found[1]) / scale, bend)


def flat(depths: Floats, radii: Floats, end: float) -> Profile:
    """Wall that goes on as the contours do; parameters as of `superellipse`."""
    return Flat(float(np.clip(_slope(depths, radii, end), -1.0, WIDEST)))


def conic(depths: Floats, radii: Floats, end: float) -> Profile:
    """Conic that goes on as the contours do; parameters as of `superellipse`."""
    slope = float(np.clip(_slope(depths, radii, end), -1.0, 0.0))
    return Flat(-1.0) if slope < CONE - 1.0 else Conic(slope)


def superellipse(depths: Floats, radii: Floats, end: float) -> Profile:
    """Superellipse that best follows the last contours.

    Parameters
    ----------
    depths : (n,) array
        Outward coordinates of the contours, ascending.
    radii : (n,) array
        Mean radii there.
    end : float
        Outward coordinate of the end, beyond the last contour.

    Notes
    -----
    For each pair of exponents the scale follows by projection, for all pairs at once.
    """
    begin = depths[max(0, len(depths) - SHOULDER_REACH)]
    zeta = np.clip((depths - begin) / (end - begin), 0.0, 1.0 - NEAR_END)
    near, seen = zeta[-SHOULDER_CONTOURS:], radii[-SHOULDER_CONTOURS:]
    shares = shoulder(near, EXPONENTS[:, None, None], EXPONENTS[:, None])
    scale = shares @ seen / np.einsum("pqn,pqn->pq", shares, shares)
    misfit = np.sum((scale[:, :, None] * shares - seen) ** 2, axis=-1)
    p, q = np.unravel_index(int(misfit.argmin()), misfit.shape)
    return Superellipse(float(zeta[-1]), float(EXPONENTS[p]), float(EXPONENTS[q]))


def flared(depths: Floats, radii: Floats, end: float, beyond: Beyond | None = None) -> Profile:
    """Superellipse on a wall that flares or narrows; parameters as of `superellipse`.

    It follows all the contours that are given, which have to lie close together, and what was
    felt beyond them.

    Notes
    -----
    For each pair of exponents width and trend follow by orthogonal projection (QR), for all
    pairs at once.
    """
    begin, last = depths[0], len(depths) - 1
    weights = np.ones(len(depths))
    if beyond is not None:
        depths = np.concatenate([depths, beyond.depths])
        radii = np.concatenate([radii, beyond.radii])
        weights = np.concatenate([weights, beyond.weights])
    zeta = np.clip((depths - begin) / (end - begin), 0.0, 1.0 - NEAR_END)
    shares = shoulder(zeta, FLARED[:, None, None], FLARED[:, None])
    radii, shares = weights * radii, weights * shares
    basis = np.stack([shares, shares * zeta], axis=-1)
    directions, triangle = np.linalg.qr(basis)
    along = np.einsum("pqnk,n->pqk", directions, radii)
    misfit = np.sum((radii - np.einsum("pqnk,pqk->pqn", directions, along)) ** 2, axis=-1)
    best = np.unravel_index(int(misfit.argmin()), misfit.shape)
    width, change = np.linalg.solve(triangle[best], along[best])
    trend = float(np.clip(change / width, LEAST_TREND, MOST_TREND)) if width > 0.0 else 0.0
    p, q = best
    return Superellipse(float(zeta[last]), float(FLARED[p]), float(FLARED[q]), trend)


def shoulder(zeta: Floats, p: Floats | float, q: Floats | float) -> Floats:
    """(1 - zeta^p)^(1/q), and 0 beyond the end."""
    result: Floats = np.maximum(1.0 - np.clip(zeta, 0.0, 1.0) ** p, 0.0) ** (1.0 / q)
    return result


def _slope(depths: Floats, radii: Floats, end: float) -> float:
    """Relative change of the radius from the last contour to the end, to first order."""
    trend = trend_of(depths, radii)
    return float((end - depths[-1]) * trend.slope / (2.0 * trend.square))
