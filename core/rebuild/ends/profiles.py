"""Families of shapes in which a solid narrows from its last contour to its end, and their curves.

A profile tells the radius as a share of the last contour's, over the way to the end: 0 at that
contour, 1 at the end. Slope and bend come from the squared radius. As curves, profiles are
walked by the angle about their centre: there neither a rounded edge nor a pole nor the tip of a
cone is singular, as each is in height or in radius. A wall that an arc rounds off into a level
end is a family of its own, for a superellipse comes down too early there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import polynomial

from palpate.core.arrays import Floats

ROUNDS = 60  # Most steps of Newton's method; from its start it converges from one side
# Radius below which a curvature is told as it is there: at the tip of some superellipses it has no
# bound.
LEAST_SHARE = 1e-6
TREND_CONTOURS = 3  # Contours through which the squared radius is carried on
WIDEST = 0.5  # A flat end's wall flares by no more than this share
CONE = 1e-6  # A conic that is nearer to a cone than this is one: its tip is sharp
SHOULDER_CONTOURS = 6  # Contours to which a superellipse is fitted
SHOULDER_REACH = 10  # The contour, counted from the end, at which a superellipse is widest
# Exponents of superellipses that are tried, along the height and across: eight from each to its
# double, so that those of a ball are among them.
EXPONENTS = np.geomspace(1.0, 32.0, 41)
FLARED = np.geomspace(1.0, 128.0, 57)  # Where close contours show sharper edges
LEAST_TREND, MOST_TREND = -0.9, 2.0  # Of a wall: it must be there when the end comes
NEAR_END = 1e-9  # A contour lies at least this share before the end
ROWS = 9  # Rows of the side to which it is fitted
# Radius of the arc over the way from the last row to the end, at most; at least it is 1: a smaller
# arc would begin where nothing was seen.
LARGEST = 12.0
TRIED = 49  # Radii that are tried
DEGREE = 4  # Of a relief
LEAST_DISC = 0.05  # Of the last row's radius: a smaller disc is none


class ProfileCurve(Protocol):
    """Part of a profile."""

    def at(self, way: Floats, by: int = 0) -> Floats:
        """Height and radius (n, 2) by the way (n,) from 0, outside, to 1; or derivatives, to 2."""


@dataclass(frozen=True, slots=True)
class StraightCurve:
    """A straight part."""

    begin: tuple[float, float]
    end: tuple[float, float]

    def at(self, way: Floats, by: int = 0) -> Floats:
        """See `ProfileCurve.at`."""
        begin, step = np.array(self.begin), np.array(self.end) - self.begin
        if by == 0:
            return np.asarray(begin + way[:, None] * step)
        return np.broadcast_to(step if by == 1 else 0.0 * step, (len(way), 2))


@dataclass(frozen=True, slots=True)
class RoundCurve:
    """A conic or a superellipse."""

    profile: Conic | Superellipse

    def at(self, way: Floats, by: int = 0) -> Floats:
        """See `ProfileCurve.at`."""
        zeta, radius = 0.0, 1.0  # at the rim, from the curve's centre
        if isinstance(self.profile, Superellipse):
            zeta, p, q, trend = self.profile
            radius = float(shoulder(np.array(zeta), p, q)) * (1.0 + trend * zeta)
        first = math.atan2(zeta, radius / (1.0 + self._trend * zeta))
        rate = 0.5 * math.pi - first
        polar = self._polar(first + rate * way)
        found = (polar[by] if self._trend == 0.0 else self._flared(*polar)[by]) * rate**by
        if by == 0:
            found = found - np.array([zeta, 0.0])
        return np.asarray(found / np.array([1.0 - zeta, radius]))

    @property
    def _trend(self) -> float:
        return 0.0 if isinstance(self.profile, Conic) else self.profile.trend

    def _flared(self, place: Floats, first: Floats, second: Floats) -> tuple[Floats, ...]:
        """The same with radii that change along the height besides: the product rule."""
        more = 1.0 + self._trend * place[:, :1]
        along = self._trend * first[:, :1]
        radius = (
            place[:, 1:] * more,
            first[:, 1:] * more + place[:, 1:] * along,
            second[:, 1:] * more
            + 2.0 * first[:, 1:] * along
            + place[:, 1:] * self._trend * second[:, :1],
        )
        heights = place[:, :1], first[:, :1], second[:, :1]
        return tuple(np.concatenate(pair, axis=1) for pair in zip(heights, radius, strict=True))

    def _polar(self, angle: Floats) -> tuple[Floats, Floats, Floats]:
        """Places and their first two derivatives by the angle, (n, 2) each, by implicit slopes."""
        ahead = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        aside = np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
        distance = self._distance(ahead)[:, None]
        place = distance * ahead
        gradient, bend = self._slopes(place)
        along = _dot(gradient, ahead)
        rate = -distance * _dot(gradient, aside) / along
        first = rate * ahead + distance * aside
        rest = 2.0 * rate * aside - distance * ahead
        second = rest - (_dot(bend, first**2) + _dot(gradient, rest)) / along * ahead
        return place, first, second

    def _distance(self, ahead: Floats) -> Floats:
        """Distance (n,) of the curve from its centre in directions (n, 2)."""
        sine, cosine = np.maximum(ahead, 0.0).T
        if isinstance(self.profile, Conic):
            slope = self.profile.slope
            return np.asarray(1.0 / (np.hypot(cosine, (1.0 + slope) * sine) - slope * sine))
        _, p, q, _ = self.profile
        distance = 1.0 / np.maximum(sine, cosine)
        for _ in range(ROUNDS):  # convex and rising: no step goes past the root
            up, out = (distance * sine) ** p, (distance * cosine) ** q
            step = (up + out - 1.0) / (p * up + q * out)
            distance = distance * (1.0 - step)
            if float(np.abs(step).max(initial=0.0)) <= np.finfo(float).eps:
                break
        return np.asarray(distance)

    def _slopes(self, place: Floats) -> tuple[Floats, Floats]:
        """Gradient (n, 2), and the Hessian's diagonal (n, 2), of what is 0 on the curve."""
        zeta, radius = np.maximum(place, 0.0).T
        if isinstance(self.profile, Conic):
            slope = self.profile.slope
            curve = 2.0 * (1.0 + 2.0 * slope)
            gradient = np.stack([curve * zeta - 2.0 * slope, 2.0 * radius], axis=-1)
            return gradient, np.broadcast_to(np.array([curve, 2.0]), place.shape)
        _, p, q, _ = self.profile
        gradient = np.stack([p * zeta ** (p - 1.0), q * radius ** (q - 1.0)], axis=-1)
        zeta, radius = np.maximum(zeta, LEAST_SHARE), np.maximum(radius, LEAST_SHARE)
        second = p * (p - 1.0) * zeta ** (p - 2.0), q * (q - 1.0) * radius ** (q - 2.0)
        return gradient, np.stack(second, axis=-1)


def _dot(one: Floats, other: Floats) -> Floats:
    return np.asarray(np.einsum("ni,ni->n", one, other)[:, None])


def profile_curves(profile: Profile, gap: float) -> tuple[ProfileCurve, ...]:
    """A profile's smooth parts, from the rim to the middle; a disc where there is no `gap`."""
    if isinstance(profile, Rounded):
        leaves = float(profile.shares(np.array([1.0]))[0])
        return ArcCurve(profile), StraightCurve((1.0, leaves), (1.0, 0.0))
    if not isinstance(profile, Flat):
        return (RoundCurve(profile),)
    if not abs(gap) > 0.0:
        return (StraightCurve((0.0, 1.0), (0.0, 0.0)),)
    wall = StraightCurve((0.0, 1.0), (1.0, 1.0 + profile.slope))
    if wall.end[1] <= LEAST_SHARE:
        return (StraightCurve((0.0, 1.0), (1.0, 0.0)),)
    return wall, StraightCurve(wall.end, (1.0, 0.0))


class Flat(NamedTuple):
    """A straight wall, then a level disc."""

    slope: float  # Change of the radius over the whole way, from -1, a cone, upwards

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last contour's."""
        return 1.0 + self.slope * way


class Conic(NamedTuple):
    """A conic section that closes at the end: r^2 = 1 + 2 s x - (1 + 2 s) x^2."""

    slope: float  # s: 0 is half an ellipse, -1/2 a paraboloid, near -1 a cone

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last contour's."""
        square = (1.0 - way) * (1.0 + (1.0 + 2.0 * self.slope) * way)
        return np.sqrt(np.maximum(square, 0.0))


class Superellipse(NamedTuple):
    """A shoulder: (1 - zeta^p)^(1/q) (1 + trend zeta), with zeta = 1 at the end."""

    begin: float  # zeta at the last contour
    p: float  # Exponent along the height
    q: float  # Exponent across
    trend: float = 0.0  # Change of the radius besides, as a share: of a wall that flares or narrows

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last contour's."""
        zeta = self.begin + (1.0 - self.begin) * np.asarray(way)
        return self._radius(zeta) / self._radius(np.array(self.begin))

    def _radius(self, zeta: Floats) -> Floats:
        return shoulder(zeta, self.p, self.q) * (1.0 + self.trend * zeta)


class Relief(NamedTuple):
    """What an end rises over its profile, by the place: in full at its height, not at the rim."""

    middle: Floats  # About which it is told, (2,)
    scale: float  # Radius about it
    coefficients: Floats  # (5, 5), of powers of x and of y, over the scale
    deviation: float  # Its standard deviation, root mean square over the face, m

    def at(self, places: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Over places (..., 2): (...), or derivatives by x and y."""
        x, y = np.moveaxis((places - self.middle) / self.scale, -1, 0)
        along = polynomial.polyder(self.coefficients, by[0], axis=0)
        across = polynomial.polyder(along, by[1], axis=1)
        return np.asarray(polynomial.polyval2d(x, y, across) / self.scale ** sum(by))


class EdgeSamples(NamedTuple):
    """What was touched of an end beyond the last contour."""

    depths: Floats  # Outward coordinates, (n,), between the last contour and the end
    radii: Floats  # Mean radii there, (n,), as if the last contour's had shrunk or grown as a whole
    weights: Floats  # Level part of the normals, (n,), by which a radius counts

    def off(self, profile: Profile, rim: float, end: float, radius: float) -> Floats:
        """Weighted distances (n,) from a profile that has `radius` at the rim."""
        shares = profile.shares((self.depths - rim) / (end - rim))
        return np.asarray(self.weights * (radius * shares - self.radii))


class Trend(NamedTuple):
    """Squared radius over the outward coordinate, about the last contour."""

    square: float  # At the last contour
    slope: float
    bend: float  # Half its second derivative

    def at(self, beyond: float) -> float:
        """Squared radius this far beyond the last contour; negative beyond a pole."""
        return self.square + beyond * (self.slope + beyond * self.bend)


def trend_of(depths: Floats, radii: Floats) -> Trend:
    """Quadratic through the last three squared radii at ascending outward coordinates (n,)."""
    count = min(TREND_CONTOURS, len(depths))
    depths, square = depths[-count:] - depths[-1], radii[-count:] ** 2
    if count == 1:
        return Trend(float(square[-1]), 0.0, 0.0)
    scale = float(-depths[0])
    found = np.linalg.solve(np.vander(depths / scale, count, increasing=True), square)
    bend = float(found[2]) / scale**2 if count == TREND_CONTOURS else 0.0
    return Trend(float(square[-1]), float(found[1]) / scale, bend)


def flat(depths: Floats, radii: Floats, end: float) -> Profile:
    """Wall that goes on as the contours do; parameters as of `superellipse`."""
    return Flat(float(np.clip(_slope(depths, radii, end), -1.0, WIDEST)))


def conic(depths: Floats, radii: Floats, end: float) -> Profile:
    """Conic that goes on as the contours do; parameters as of `superellipse`."""
    slope = float(np.clip(_slope(depths, radii, end), -1.0, 0.0))
    return Flat(-1.0) if slope < CONE - 1.0 else Conic(slope)


def _slope(depths: Floats, radii: Floats, end: float) -> float:
    """Relative change of the radius from the last contour to the end, to first order."""
    trend = trend_of(depths, radii)
    return float((end - depths[-1]) * trend.slope / (2.0 * trend.square))


def superellipse(depths: Floats, radii: Floats, end: float) -> Profile:
    """Superellipse that best follows the last contours before an end beyond them.

    By ascending outward coordinates (n,), mean radii there, and the end's outward coordinate.
    """
    begin = depths[max(0, len(depths) - SHOULDER_REACH)]
    zeta = np.clip((depths - begin) / (end - begin), 0.0, 1.0 - NEAR_END)
    near, seen = zeta[-SHOULDER_CONTOURS:], radii[-SHOULDER_CONTOURS:]
    misfit = shoulder_misfits(near, seen)
    p, q = np.unravel_index(int(misfit.argmin()), misfit.shape)
    return Superellipse(float(zeta[-1]), float(EXPONENTS[p]), float(EXPONENTS[q]))


def shoulder_misfits(zeta: Floats, radii: Floats) -> Floats:
    """Sums of squares (p, q) by which the best of each pair of exponents misses radii (n,)."""
    shares = shoulder(zeta, EXPONENTS[:, None, None], EXPONENTS[:, None])
    scale = shares @ radii / np.einsum("pqn,pqn->pq", shares, shares)
    return np.asarray(np.sum((scale[:, :, None] * shares - radii) ** 2, axis=-1))


def flared(depths: Floats, radii: Floats, end: float, beyond: EdgeSamples | None = None) -> Profile:
    """Superellipse on a wall that flares or narrows; parameters as of `superellipse`.

    It follows all the contours, close together, and what was touched beyond them. For each pair of
    exponents width and trend follow by orthogonal projection (Gram and Schmidt), all at once.
    """
    begin, last = depths[0], len(depths) - 1
    weights = np.ones(len(depths))
    if beyond is not None:
        depths = np.concatenate([depths, beyond.depths])
        radii = np.concatenate([radii, beyond.radii])
        weights = np.concatenate([weights, beyond.weights])
    zeta = np.clip((depths - begin) / (end - begin), 0.0, 1.0 - NEAR_END)
    shoulders = np.maximum(1.0 - zeta ** FLARED[:, None], 0.0)
    with np.errstate(divide="ignore"):  # 0 to any power is 0
        shares = weights * np.exp(np.log(shoulders)[:, None] / FLARED[:, None])
    lengths, first = _unit(shares)
    mixed = np.einsum("pqn,pqn->pq", first, shares * zeta)
    rises, second = _unit(shares * zeta - mixed[..., None] * first)
    along = first @ (weights * radii)
    left = weights * radii - along[..., None] * first
    beside = np.einsum("pqn,pqn->pq", second, left)
    misfit = np.sum((left - beside[..., None] * second) ** 2, axis=-1)
    p, q = np.unravel_index(int(misfit.argmin()), misfit.shape)
    change = beside[p, q] / rises[p, q]
    width = (along[p, q] - mixed[p, q] * change) / lengths[p, q]
    trend = float(np.clip(change / width, LEAST_TREND, MOST_TREND)) if width > 0.0 else 0.0
    return Superellipse(float(zeta[last]), float(FLARED[p]), float(FLARED[q]), trend)


def _unit(vectors: Floats) -> tuple[Floats, Floats]:
    """Lengths (...) of vectors (..., n), and the vectors of length 1."""
    lengths = np.maximum(np.linalg.norm(vectors, axis=-1), np.finfo(float).tiny)
    return lengths, vectors / lengths[..., None]


def shoulder(zeta: Floats, p: Floats | float, q: Floats | float) -> Floats:
    """(1 - zeta^p)^(1/q), and 0 beyond the end."""
    return np.maximum(1.0 - np.clip(zeta, 0.0, 1.0) ** p, 0.0) ** (1.0 / q)


class Rounded(NamedTuple):
    """A wall and an arc; shares are of the last row's radius, ways of the way to the end."""

    arc: float  # Radius of the arc, as a way: 1 or more
    width: float  # The same as a share
    wall: tuple[float, float, float]  # Polynomial of the way, by ascending powers, shares

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last row's."""
        inside = np.clip(1.0 - (1.0 - np.asarray(way)) / self.arc, 0.0, 1.0)
        level, slope, bend = self.wall
        wall = level + way * (slope + way * bend)
        return wall - self.width * (1.0 - np.sqrt(1.0 - inside**2))


@dataclass(frozen=True, slots=True)
class ArcCurve:
    """The arc of a rounded end, walked by its angle: smooth where it meets the disc."""

    profile: Rounded

    def at(self, way: Floats, by: int = 0) -> Floats:
        """See `ProfileCurve.at`."""
        arc, width, (level, slope, bend) = self.profile
        first = math.asin(1.0 - 1.0 / arc)
        rate = 0.5 * math.pi - first
        sine, cosine = np.sin(first + rate * way), np.cos(first + rate * way)
        x = 1.0 - arc * (1.0 - sine)
        if by == 0:
            wall = level + x * (slope + x * bend)
            return np.stack([x, wall - width * (1.0 - cosine)], axis=-1)
        along, lean = arc * cosine * rate, slope + 2.0 * bend * x
        if by == 1:
            return np.stack([along, lean * along - width * sine * rate], axis=-1)
        more = -arc * sine * rate**2
        second = 2.0 * bend * along**2 + lean * more - width * cosine * rate**2
        return np.stack([more, second], axis=-1)


def rounded(depths: Floats, radii: Floats, end: float) -> Rounded | None:
    """Wall and arc that best follow the last rows; None if no arc leaves a disc within."""
    depths, radii, last = depths[-ROWS:], radii[-ROWS:], float(radii[-1])
    gap = end - float(depths[-1])
    way = (depths - depths[-1]) / gap
    arcs = np.geomspace(1.0, LARGEST, TRIED)
    inside = np.clip(1.0 - (1.0 - way) / arcs[:, None], 0.0, 1.0)
    widths = arcs * gap / last
    cut = widths[:, None] * (1.0 - np.sqrt(1.0 - inside**2))
    powers = np.vander(way, 3, increasing=True)
    walls = np.linalg.lstsq(powers, (radii / last + cut).T, rcond=None)[0]
    missed = ((powers @ walls).T - cut - radii / last) ** 2
    best = int(missed.sum(axis=1).argmin())
    level, slope, bend = walls[:, best].tolist()
    # The arc begins where the last row is: the share there is 1 by definition.
    level += 1.0 - (level - float(cut[best, -1]))
    found = Rounded(float(arcs[best]), float(widths[best]), (level, slope, bend))
    leaves = float(found.shares(np.array([1.0]))[0])
    return found if best > 0 and LEAST_DISC < leaves < 1.0 + WIDEST else None


Profile = Flat | Conic | Superellipse | Rounded
