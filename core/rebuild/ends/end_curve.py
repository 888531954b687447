"""The profile of an end as smooth curves, from the rim to the middle.

Each curve runs in a plane of two shares: way from the last contour to the end, and radius over
the last contour's. Curved profiles are walked by the angle about their centre: there neither a
rounded edge nor a pole nor the tip of a cone is singular, as each is in height or in radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import Conic, Flat, Profile, Superellipse, shoulder
from palpate.core.rebuild.ends.rounded import Arc, Rounded

ROUNDS = 60
"""Most steps of Newton's method; from its start it converges from one side."""
LEAST_SHARE = 1e-6
"""Radius below which a curvature is told as it is there: at the tip of some superellipses it
has no bound."""


class Curve(Protocol):
    """Part of a profile."""

    def at(self, way: Floats, by: int = 0) -> Floats:
        """Height and radius (n, 2), as shares, or their derivatives up to the second.

        Parameters
        ----------
        way : (n,) array
            From 0 at its outer end to 1 at its inner.
        by : int
            How often it is differentiated.
        """


@dataclass(frozen=True, slots=True)
class Line:
    """A straight part."""

    begin: tuple[float, float]
    end: tuple[float, float]

    def at(self, way: Floats, by: int = 0) -> Floats:
        """See `Curve.at`."""
        begin, step = np.array(self.begin), np.array(self.end) - self.begin
        if by == 0:
            return np.asarray(begin + way[:, None] * step)
        return np.broadcast_to(step if by == 1 else 0.0 * step, (len(way), 2))


@dataclass(frozen=True, slots=True)
class Round:
    """A conic or a superellipse."""

    profile: Conic | Superellipse

    def at(self, way: Floats, by: int = 0) -> Floats:
        """See `Curve.at`."""
        zeta, radius = self._begin()
        first = math.atan2(zeta, radius / (1.0 + self._trend * zeta))
        rate = 0.5 * math.pi - first
        polar = self._polar(first + rate * way)
        found = (polar[by] if self._trend == 0.0 else self._flared(*polar)[by]) * rate**by
        if by == 0:
            found = found - np.array([zeta, 0.0])
        return np.asarray(found / np.array([1.0 - zeta, radius]))

    def _begin(self) -> tuple[float, float]:
        """Height and radius at the rim, from the curve's centre."""
        if isinstance(self.profile, Conic):
            return 0.0, 1.0
        begin, p, q, trend = self.profile
        return begin, float(shoulder(np.array(begin), p, q)) * (1.0 + trend * begin)

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
        """Places and their first two derivatives by the angle, (n, 2) each.

        The distance from the centre is an implicit function of the angle.
        """
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


def curves_of(profile: Profile, gap: float) -> tuple[Curve, ...]:
    """A profile's smooth parts, from the rim to the middle.

    Parameters
    ----------
    profile : Profile
        How the radius changes.
    gap : float
        Way from rim to end; where there is none, all that is left is a disc.
    """
    if isinstance(profile, Rounded):
        leaves = float(profile.shares(np.array([1.0]))[0])
        return Arc(profile), Line((1.0, leaves), (1.0, 0.0))
    if not isinstance(profile, Flat):
        return (Round(profile),)
    if not abs(gap) > 0.0:
        return (Line((0.0, 1.0), (0.0, 0.0)),)
    wall = Line((0.0, 1.0), (1.0, 1.0 + profile.slope))
    if wall.end[1] <= LEAST_SHARE:
        return (Line((0.0, 1.0), (1.0, 0.0)),)
    return wall, Line(wall.end, (1.0, 0.0))


def _dot(one: Floats, other: Floats) -> Floats:
    result: Floats = np.einsum("ni,ni->n", one, other)[:, None]
    return result
