"""Profile families: how the radius of a solid changes from its last contour to its end.

A profile maps the fraction of the height from the last contour, 0, to the end, 1, onto the ratio of
the radius to that of the last contour. Slope and bend come from the squared radius. As curves,
profiles are parametrised by the angle about their centre: neither a rounded edge nor a pole nor the
tip of a cone is singular there, as each is in height or in radius. A wall that an arc rounds off
into a level end is a family of its own: a superellipse falls too early there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import polynomial

from palpate.core.arrays import Floats

# A limit that is not reached: Newton's method converges from one side, and stops earlier.
MAX_NEWTON_STEPS = 60
# Ratio of a radius to the last contour's below which a curvature is that at this ratio: at the tip
# of some superellipses it is unbounded.
MIN_RADIUS_RATIO = 1e-6
N_TREND_CONTOURS = 3  # contours that determine a quadratic


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileSettings:
    """How each family is fitted to the last contours; tuned on the shipped scenes."""

    max_flare: float = 0.5  # largest relative growth of the radius from the rim to a flat end
    cone_tolerance: float = 1e-6  # distance of a conic's slope from -1, up to which it is a cone
    n_shoulder_contours: int = 6  # contours to which a superellipse is fitted
    shoulder_start: int = 10  # contour, counted from the end, at which a superellipse is widest
    exponents_per_octave: int = 8  # exponents that are tried, from 1; 2, a ball's, is one of them
    max_exponent: float = 32.0  # largest that is tried; larger, sharper edges
    max_flared_exponent: float = 128.0  # the same of dense rows, which show sharper edges
    min_trend: float = -0.9  # least relative change of a flared wall's radius from begin to end
    max_trend: float = 2.0  # largest one
    min_end_gap: float = 1e-9  # least distance of a contour from the end, over the fitted height
    n_rows: int = 9  # rows of the side to which an arc is fitted
    # Largest radius of an arc over the height from the last row to the end. The least is 1: a
    # smaller arc would begin beyond the last row, where no row shows it.
    max_arc_ratio: float = 12.0
    n_arcs: int = 49  # radii that are tried
    min_disc: float = 0.05  # fraction of the last row's radius, of the disc inside an arc


class ProfileCurve(Protocol):
    """Part of a profile."""

    def at(self, t: Floats, by: int = 0) -> Floats:
        """Height and radius (n, 2) at parameters (n,), from 0 at the rim to 1.

        Or their derivatives of order `by`, up to 2.
        """


@dataclass(frozen=True, slots=True)
class StraightCurve:
    """A straight part."""

    begin: tuple[float, float]
    end: tuple[float, float]

    def at(self, t: Floats, by: int = 0) -> Floats:
        """See `ProfileCurve.at`."""
        begin, step = np.array(self.begin), np.array(self.end) - self.begin
        if by == 0:
            return np.asarray(begin + t[:, None] * step)
        return np.broadcast_to(step if by == 1 else 0.0 * step, (len(t), 2))


@dataclass(frozen=True, slots=True)
class RoundCurve:
    """A conic or a superellipse."""

    profile: Conic | Superellipse

    def at(self, t: Floats, by: int = 0) -> Floats:
        """See `ProfileCurve.at`."""
        zeta, radius = 0.0, 1.0  # at the rim, from the curve's centre
        if isinstance(self.profile, Superellipse):
            zeta, p, q, trend = self.profile
            radius = float(shoulder(np.array(zeta), p, q)) * (1.0 + trend * zeta)
        first = math.atan2(zeta, radius / (1.0 + self._trend * zeta))
        rate = 0.5 * math.pi - first
        polar = self._polar(first + rate * t)
        place = (polar[by] if self._trend == 0.0 else self._flared(*polar)[by]) * rate**by
        if by == 0:
            place = place - np.array([zeta, 0.0])
        return np.asarray(place / np.array([1.0 - zeta, radius]))

    @property
    def _trend(self) -> float:
        return 0.0 if isinstance(self.profile, Conic) else self.profile.trend

    def _flared(self, place: Floats, first: Floats, second: Floats) -> tuple[Floats, ...]:
        """Place and derivatives times the trend of the radius, by the product rule."""
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
        """Places and their first two derivatives by the angle, (n, 2) each, implicitly."""
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
        for _ in range(MAX_NEWTON_STEPS):  # convex and rising: no step passes the root
            up, out = (distance * sine) ** p, (distance * cosine) ** q
            step = (up + out - 1.0) / (p * up + q * out)
            distance = distance * (1.0 - step)
            if float(np.abs(step).max(initial=0.0)) <= np.finfo(float).eps:
                break
        return np.asarray(distance)

    def _slopes(self, place: Floats) -> tuple[Floats, Floats]:
        """Gradient (n, 2) and diagonal of the Hessian (n, 2) of the curve's implicit function."""
        zeta, radius = np.maximum(place, 0.0).T
        if isinstance(self.profile, Conic):
            slope = self.profile.slope
            curve = 2.0 * (1.0 + 2.0 * slope)
            gradient = np.stack([curve * zeta - 2.0 * slope, 2.0 * radius], axis=-1)
            return gradient, np.broadcast_to(np.array([curve, 2.0]), place.shape)
        _, p, q, _ = self.profile
        gradient = np.stack([p * zeta ** (p - 1.0), q * radius ** (q - 1.0)], axis=-1)
        zeta, radius = np.maximum([zeta, radius], MIN_RADIUS_RATIO)
        second = p * (p - 1.0) * zeta ** (p - 2.0), q * (q - 1.0) * radius ** (q - 2.0)
        return gradient, np.stack(second, axis=-1)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ni,ni->n", a, b)[:, None])


def profile_curves(profile: Profile, gap: float) -> tuple[ProfileCurve, ...]:
    """Smooth parts of a profile, from the rim to the axis; a disc alone if the `gap` is 0."""
    if isinstance(profile, Rounded):
        disc = float(profile.radius_ratios(np.array([1.0]))[0])
        return ArcCurve(profile), StraightCurve((1.0, disc), (1.0, 0.0))
    if not isinstance(profile, Flat):
        return (RoundCurve(profile),)
    if not abs(gap) > 0.0:
        return (StraightCurve((0.0, 1.0), (0.0, 0.0)),)
    wall = StraightCurve((0.0, 1.0), (1.0, 1.0 + profile.slope))
    if wall.end[1] <= MIN_RADIUS_RATIO:
        return (StraightCurve((0.0, 1.0), (1.0, 0.0)),)
    return wall, StraightCurve(wall.end, (1.0, 0.0))


class Flat(NamedTuple):
    """A straight wall, then a level disc."""

    slope: float  # relative change of the radius up to the end; -1 is a cone

    def radius_ratios(self, fractions: Floats) -> Floats:
        """Radii (n,) over the last contour's, at fractions (n,) of the height to the end."""
        return 1.0 + self.slope * fractions


class Conic(NamedTuple):
    """A conic section that closes at the end: r^2 = 1 + 2 s x - (1 + 2 s) x^2."""

    slope: float  # s: 0 is half an ellipse, -1/2 a paraboloid, near -1 a cone

    def radius_ratios(self, fractions: Floats) -> Floats:
        """Radii (n,) over the last contour's, at fractions (n,) of the height to the end."""
        square = (1.0 - fractions) * (1.0 + (1.0 + 2.0 * self.slope) * fractions)
        return np.sqrt(np.maximum(square, 0.0))


class Superellipse(NamedTuple):
    """A shoulder: (1 - zeta^p)^(1/q) (1 + trend zeta), with zeta = 1 at the end."""

    begin: float  # zeta at the last contour
    p: float  # exponent along the height
    q: float  # exponent of the radius
    trend: float = 0.0  # relative change of the radius from 0 to 1, of a wall that flares

    def radius_ratios(self, fractions: Floats) -> Floats:
        """Radii (n,) over the last contour's, at fractions (n,) of the height to the end."""
        zeta = self.begin + (1.0 - self.begin) * np.asarray(fractions)
        return self._radius(zeta) / self._radius(np.array(self.begin))

    def _radius(self, zeta: Floats) -> Floats:
        return shoulder(zeta, self.p, self.q) * (1.0 + self.trend * zeta)


class Relief(NamedTuple):
    """Height of an end's face over its profile: in full at the profile's end, 0 at the rim."""

    middle: Floats  # origin of the polynomial, (2,) [m]
    scale: float  # radius that is its unit [m]
    coefficients: Floats  # (5, 5) of powers of x and of y, over the scale [m]
    deviation: float  # standard deviation, root mean square over the face [m]

    def at(self, places: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Height (...) over places (..., 2) [m], or its derivatives by x and y."""
        x, y = np.moveaxis((places - self.middle) / self.scale, -1, 0)
        along = polynomial.polyder(self.coefficients, by[0], axis=0)
        across = polynomial.polyder(along, by[1], axis=1)
        return np.asarray(polynomial.polyval2d(x, y, across) / self.scale ** sum(by))


class EdgeSamples(NamedTuple):
    """Mean radii of what was touched of an end beyond the last contour."""

    depths: Floats  # outward coordinates (n,), between the last contour and the end [m]
    radii: Floats  # (n,) [m], as if the last contour grew or shrank as a whole
    weights: Floats  # radial components of the normals (n,)

    def residuals(self, profile: Profile, rim: float, end: float, radius: float) -> Floats:
        """Weighted distances (n,) [m] from a profile that has `radius` at the rim."""
        ratios = profile.radius_ratios((self.depths - rim) / (end - rim))
        return np.asarray(self.weights * (radius * ratios - self.radii))


class Trend(NamedTuple):
    """Squared radius as a quadratic of the outward coordinate, about the last contour."""

    square: float  # at the last contour [m^2]
    slope: float  # [m]
    bend: float  # half the second derivative

    def at(self, distance: float) -> float:
        """Squared radius at a distance beyond the last contour; negative beyond a pole."""
        return self.square + distance * (self.slope + distance * self.bend)


def trend_of(depths: Floats, radii: Floats) -> Trend:
    """Quadratic through the last three squared radii at ascending outward coordinates (n,)."""
    count = min(N_TREND_CONTOURS, len(depths))
    depths, square = depths[-count:] - depths[-1], radii[-count:] ** 2
    if count == 1:
        return Trend(float(square[-1]), 0.0, 0.0)
    scale = float(-depths[0])
    powers = np.linalg.solve(np.vander(depths / scale, count, increasing=True), square)
    bend = float(powers[2]) / scale**2 if count == N_TREND_CONTOURS else 0.0
    return Trend(float(square[-1]), float(powers[1]) / scale, bend)


def flat(depths: Floats, radii: Floats, end: float, settings: ProfileSettings) -> Profile:
    """Straight wall with the slope of the last contours; parameters as of `superellipse`."""
    return Flat(float(np.clip(_slope(depths, radii, end), -1.0, settings.max_flare)))


def conic(depths: Floats, radii: Floats, end: float, settings: ProfileSettings) -> Profile:
    """Conic with the slope of the last contours; parameters as of `superellipse`."""
    slope = float(np.clip(_slope(depths, radii, end), -1.0, 0.0))
    return Flat(-1.0) if slope < settings.cone_tolerance - 1.0 else Conic(slope)


def _slope(depths: Floats, radii: Floats, end: float) -> float:
    """Relative change of the radius from the last contour to the end, to first order."""
    trend = trend_of(depths, radii)
    return float((end - depths[-1]) * trend.slope / (2.0 * trend.square))


def superellipse(depths: Floats, radii: Floats, end: float, settings: ProfileSettings) -> Profile:
    """Superellipse that best follows the last contours before an end beyond them.

    By ascending outward coordinates (n,) of contours, their mean radii (n,), and the outward
    coordinate of the end, all in one unit.
    """
    begin = depths[max(0, len(depths) - settings.shoulder_start)]
    zeta = np.clip((depths - begin) / (end - begin), 0.0, 1.0 - settings.min_end_gap)
    last = slice(-settings.n_shoulder_contours, None)
    misfit = shoulder_misfits(zeta[last], radii[last], settings)
    p, q = np.unravel_index(int(misfit.argmin()), misfit.shape)
    exponents = _exponents(settings.max_exponent, settings.exponents_per_octave)
    return Superellipse(float(zeta[-1]), float(exponents[p]), float(exponents[q]))


def shoulder_misfits(zeta: Floats, radii: Floats, settings: ProfileSettings) -> Floats:
    """Sums of squares (p, q) by which the best of each pair of exponents misses radii (n,)."""
    exponents = _exponents(settings.max_exponent, settings.exponents_per_octave)
    ratios = shoulder(zeta, exponents[:, None, None], exponents[:, None])
    scale = ratios @ radii / np.einsum("pqn,pqn->pq", ratios, ratios)
    return np.asarray(np.sum((scale[:, :, None] * ratios - radii) ** 2, axis=-1))


@lru_cache(maxsize=4)
def _exponents(maximum: float, per_octave: int) -> Floats:
    """Exponents from 1 to a maximum, evenly spaced in their logarithm."""
    exponents: Floats = np.geomspace(1.0, maximum, round(per_octave * math.log2(maximum)) + 1)
    exponents.setflags(write=False)
    return exponents


def flared(
    depths: Floats,
    radii: Floats,
    end: float,
    settings: ProfileSettings,
    samples: EdgeSamples | None = None,
) -> Profile:
    """Superellipse on a wall that flares or narrows; parameters as of `superellipse`.

    It is fitted to all contours, which are close together, and to `samples` beyond them. For each
    pair of exponents width and trend follow by orthogonal projection (Gram and Schmidt).
    """
    begin, last = depths[0], len(depths) - 1
    weights = np.ones(len(depths))
    if samples is not None:
        depths = np.concatenate([depths, samples.depths])
        radii = np.concatenate([radii, samples.radii])
        weights = np.concatenate([weights, samples.weights])
    zeta = np.clip((depths - begin) / (end - begin), 0.0, 1.0 - settings.min_end_gap)
    exponents = _exponents(settings.max_flared_exponent, settings.exponents_per_octave)
    shoulders = np.maximum(1.0 - zeta ** exponents[:, None], 0.0)
    with np.errstate(divide="ignore"):  # 0 to any power is 0
        ratios = weights * np.exp(np.log(shoulders)[:, None] / exponents[:, None])
    lengths, first = _unit(ratios)
    mixed = np.einsum("pqn,pqn->pq", first, ratios * zeta)
    rises, second = _unit(ratios * zeta - mixed[..., None] * first)
    along = first @ (weights * radii)
    rest = weights * radii - along[..., None] * first
    beside = np.einsum("pqn,pqn->pq", second, rest)
    misfit = np.sum((rest - beside[..., None] * second) ** 2, axis=-1)
    p, q = np.unravel_index(int(misfit.argmin()), misfit.shape)
    change = beside[p, q] / rises[p, q]
    width = (along[p, q] - mixed[p, q] * change) / lengths[p, q]
    limits = settings.min_trend, settings.max_trend
    trend = float(np.clip(change / width, *limits)) if width > 0.0 else 0.0
    return Superellipse(float(zeta[last]), float(exponents[p]), float(exponents[q]), trend)


def _unit(vectors: Floats) -> tuple[Floats, Floats]:
    """Lengths (...) of vectors (..., n), and the vectors of length 1."""
    lengths = np.maximum(np.linalg.norm(vectors, axis=-1), np.finfo(float).tiny)
    return lengths, vectors / lengths[..., None]


def shoulder(zeta: Floats, p: Floats | float, q: Floats | float) -> Floats:
    """(1 - zeta^p)^(1/q), and 0 beyond the end."""
    return np.maximum(1.0 - np.clip(zeta, 0.0, 1.0) ** p, 0.0) ** (1.0 / q)


class Rounded(NamedTuple):
    """A wall and an arc; radii are over the last row's, heights over that to the end."""

    arc: float  # radius of the arc over the height to the end, at least 1
    width: float  # the same radius over that of the last row
    wall: tuple[float, float, float]  # polynomial of the height, by ascending powers

    def radius_ratios(self, fractions: Floats) -> Floats:
        """Radii (n,) over the last row's, at fractions (n,) of the height to the end."""
        inside = np.clip(1.0 - (1.0 - np.asarray(fractions)) / self.arc, 0.0, 1.0)
        level, slope, bend = self.wall
        wall = level + fractions * (slope + fractions * bend)
        return wall - self.width * (1.0 - np.sqrt(1.0 - inside**2))


@dataclass(frozen=True, slots=True)
class ArcCurve:
    """The arc of a rounded end, parametrised by its angle: smooth where it meets the disc."""

    profile: Rounded

    def at(self, t: Floats, by: int = 0) -> Floats:
        """See `ProfileCurve.at`."""
        arc, width, (level, slope, bend) = self.profile
        first = math.asin(1.0 - 1.0 / arc)
        rate = 0.5 * math.pi - first
        sine, cosine = np.sin(first + rate * t), np.cos(first + rate * t)
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


def rounded(depths: Floats, radii: Floats, end: float, settings: ProfileSettings) -> Rounded | None:
    """Wall and arc that best follow the last rows; None if no arc leaves a disc inside."""
    depths, radii, last = depths[-settings.n_rows :], radii[-settings.n_rows :], float(radii[-1])
    gap = end - float(depths[-1])
    fractions = (depths - depths[-1]) / gap
    arcs = np.geomspace(1.0, settings.max_arc_ratio, settings.n_arcs)
    inside = np.clip(1.0 - (1.0 - fractions) / arcs[:, None], 0.0, 1.0)
    widths = arcs * gap / last
    cut = widths[:, None] * (1.0 - np.sqrt(1.0 - inside**2))
    powers = np.vander(fractions, 3, increasing=True)
    walls = np.linalg.lstsq(powers, (radii / last + cut).T, rcond=None)[0]
    squares = ((powers @ walls).T - cut - radii / last) ** 2
    best = int(squares.sum(axis=1).argmin())
    level, slope, bend = walls[:, best].tolist()
    # The arc begins at the last row, where the ratio is 1 by definition.
    level += 1.0 - (level - float(cut[best, -1]))
    profile = Rounded(float(arcs[best]), float(widths[best]), (level, slope, bend))
    disc = float(profile.radius_ratios(np.array([1.0]))[0])
    fits = best > 0 and settings.min_disc < disc < 1.0 + settings.max_flare
    return profile if fits else None


Profile = Flat | Conic | Superellipse | Rounded
