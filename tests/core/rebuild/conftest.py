"""What a perfect finger would have touched of a superquadric that stands on height 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints, stack_points
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.solid import LatticeSolid
from palpate.core.rebuild.surface.closed import Patch
from palpate.core.shapes.superquadrics import Superquadric

BAND = 6e-3  # Half the height of the band that is touched along a contour, m
AROUND = 120


class Oracle:
    """Points and normals of a superquadric whose foot is the origin."""

    def __init__(self, size: Sequence[float], exponents: Sequence[float], scale: float = 1.0):
        self.shape: Superquadric = Superquadric(scale * np.array(size), np.array(exponents))
        self.scale = scale
        self.middle = np.array([0.0, 0.0, self.shape.size[2]])

    def section(self, share: float) -> Floats:
        """Points (n, 3) at a height, given as a share of the half height over the middle."""
        height = share * self.shape.size[2]
        turn = 2 * np.pi * np.arange(AROUND) / AROUND
        away = np.column_stack([np.cos(turn), np.sin(turn)]) * self.shape.size[:2]
        low, high = np.zeros(AROUND), np.full(AROUND, 1.5)
        for _ in range(60):
            middle = 0.5 * (low + high)
            inside = self.shape.gauge(self._at(away * middle[:, None], height)) <= 1.0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return np.asarray(self._at(away * low[:, None], height) + self.middle)

    def contacts_at(self, points: Floats) -> ContactPoints:
        """The points with their outward normals, by central differences of the gauge."""
        local, step = points - self.middle, 1e-6 * self.scale
        gradient = np.stack(
            [
                self.shape.gauge(local + step * axis) - self.shape.gauge(local - step * axis)
                for axis in np.eye(3)
            ],
            axis=-1,
        )
        normals = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
        return ContactPoints(points, normals, np.zeros(len(points), np.int32))

    def band(self, share: float) -> ContactPoints:
        """What the touches along a contour meet above and below it."""
        half = BAND * self.scale / self.shape.size[2]
        around = np.linspace(share - half, share + half, 9)
        near = [self.section(one) for one in around if abs(one) < 1.0]
        return self.contacts_at(np.concatenate(near))

    def top(self) -> ContactPoints:
        """What touches from above meet over the middle 0.4 of the width."""
        along = np.linspace(-0.42, 0.42, 12)
        places = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
        origins = self._at(places * self.shape.size[:2], 3 * self.shape.size[2])
        ranges = self.shape.cast(origins, np.array([0.0, 0.0, -1.0]), 9 * self.shape.size[2])
        return self.contacts_at(origins - ranges[:, None] * [0.0, 0.0, 1.0] + self.middle)

    def rebuilt(self, shares: Sequence[float], top: bool = True, **options: Any) -> LatticeSolid:
        """From contours at these heights, contacts along them and from above."""
        contours, contacts, tops = self.evidence(shares, top)
        options = {"method": "skin", **options}
        return reconstruct(contours, patches=contacts, tops=tops, **options)

    def evidence(
        self, shares: Sequence[float], top: bool = True
    ) -> tuple[list[Floats], ContactPoints, Floats]:
        """Contours, all contacts, and touches of the ends."""
        height = 2.0 * self.middle[2]
        parts = [self.band(share) for share in shares]
        tops = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, height]])[: 1 + top]
        contacts = stack_points([*parts, self.top()] if top else parts)
        return [self.section(share) for share in shares], contacts, tops

    def distances(self, points: Floats) -> Floats:
        """Radial distance of points (n, 3) from the surface, m."""
        local = points - self.middle
        return np.asarray(np.linalg.norm(local, axis=1) * (1 - 1 / self.shape.gauge(local)))

    @staticmethod
    def _at(places: Floats, height: float) -> Floats:
        return np.column_stack([places, np.full(len(places), height)])


@pytest.fixture(scope="session")
def oracle() -> Callable[..., Oracle]:
    return Oracle


class Traced:
    """Contours of an object (turns (k,), height) -> (k, 2), as different hands would trace it."""

    def __init__(self, section: Callable[[Floats, float], Floats], seed: int = 0):
        self.section = section
        self.rng = np.random.default_rng(seed)

    def contour(self, height: float, points: int, shuffled: bool = True) -> Floats:
        """Points (n, 3) at even lengths: a quarter more or fewer, begun and directed anyhow."""
        around = self.section(np.arange(4000) / 4000, height)
        closed = np.vstack([around, around[:1]])
        lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        count = int(points * self.rng.uniform(0.8, 1.25)) if shuffled else points
        begin = self.rng.uniform() if shuffled else 0.0
        at = np.mod(begin + np.arange(count) / count, 1.0) * ends[-1]
        found = np.column_stack([np.interp(at, ends, closed[:, axis]) for axis in (0, 1)])
        if shuffled and self.rng.uniform() < 0.5:
            found = found[::-1]
        return np.column_stack([found, np.full(count, height)])

    def contours(self, heights: Floats, points: int, noise: float = 0.0) -> list[Floats]:
        """One at each height, with noise in all three coordinates."""
        traced = [self.contour(float(height), points) for height in heights]
        return [one + noise * self.rng.normal(size=one.shape) for one in traced]


def polar(turns: Floats, radius: Floats | float) -> Floats:
    """Points (k, 2) at these distances from the origin."""
    angle = 2 * np.pi * turns
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(np.asarray(radius).reshape(-1, 1) * around)


def turned(points: Floats, angle: float) -> Floats:
    """Points (k, 2) about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def superellipse(turns: Floats, exponent: float, a: float, b: float) -> Floats:
    """Points (k, 2) at given azimuths."""
    c, s = np.abs(np.cos(2 * np.pi * turns)) / a, np.abs(np.sin(2 * np.pi * turns)) / b
    power = 2 / exponent
    return polar(turns, (c**power + s**power) ** (-exponent / 2))


def lobed(turns: Floats, z: float) -> Floats:
    """A zigzag of lobes that wander."""
    angle = 2 * np.pi * turns
    wave = 1 + 0.12 * np.cos(3 * angle) + 0.08 * np.sin(2 * angle + 2 * z)
    return polar(turns, np.sqrt(1.04 - z * z) * (0.75 + 0.18 * np.sin(9 * z)) * wave)


def bent_tube(turns: Floats, z: float) -> Floats:
    """Ellipses that move sideways, farther than they are wide."""
    middle = np.array([0.9 * z * z + 0.3 * z, 0.2 * np.sin(2.5 * z)])
    return np.asarray((1 - 0.3 * z * z) * superellipse(turns, 1.0, 0.4, 0.26) + middle)


def kidney(turns: Floats, z: float) -> Floats:
    """A bent sausage that turns with the height; the middle of its area lies outside."""
    bend = 1.9 * np.sin(2 * np.pi * turns)
    width = 0.52 + 0.16 * np.cos(2 * np.pi * turns)
    return turned(polar(bend / (2 * np.pi), width) - [0.28, 0.0], 0.6 * z)


# Objects between the heights -1 and 1: places at even parameters belong together.
SECTIONS: dict[str, Callable[[Floats, float], Floats]] = {
    "lobed": lobed,
    "three lobes": lambda t, z: turned(
        polar(t, 0.6 + 0.132 * np.cos(6 * np.pi * t)), 1.5 * (z + 1)
    ),
    "four lobes": lambda t, z: turned(
        polar(t, 0.6 + 0.09 * np.cos(8 * np.pi * t) + 0.03 * np.cos(2 * np.pi * t)), 2.0 * (z + 1)
    ),
    "square": lambda t, z: turned(superellipse(t, 0.3, 0.55, 0.55), z + 1),
    "bent tube": bent_tube,
    "star": lambda t, z: polar(t, 0.55 * (1 + 0.4 * np.cos(10 * np.pi * t)) * (1 - 0.2 * z * z)),
    "kidney": kidney,
    "box": lambda t, z: (1 - 0.1 * z) * superellipse(t, 0.1, 0.6, 0.45),
}


@pytest.fixture(scope="session")
def sections() -> dict[str, Callable[[Floats, float], Floats]]:
    return SECTIONS


@pytest.fixture(scope="session")
def traced() -> Callable[..., Traced]:
    return Traced


class EllipsoidSide(Patch):
    """The side of an ellipsoid between two latitudes, in closed form, as a piece of a surface."""

    def __init__(self, size: Sequence[float], low: float = -np.pi / 2, high: float = np.pi / 2):
        self.size, self.low, self.high = np.asarray(size, float), low, high

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), or derivatives of them."""
        step = self.high - self.low
        latitude = self.low + step * np.asarray(v) + 0.5 * np.pi * by[0]
        angle = 2 * np.pi * np.asarray(turns) + 0.5 * np.pi * by[1]
        across = np.cos(latitude) * step ** by[0] * (2 * np.pi) ** by[1]
        up = np.sin(latitude) * step ** by[0] * (by[1] == 0)
        found = np.column_stack([across * np.cos(angle), across * np.sin(angle), up])
        return np.asarray(self.size * found)


@pytest.fixture(scope="session")
def ellipsoid_side() -> Callable[..., EllipsoidSide]:
    return EllipsoidSide
