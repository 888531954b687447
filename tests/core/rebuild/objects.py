"""Objects of known shape, and ideal contacts with them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.geometry import solidity
from palpate.core.rebuild import LatticeSolid, reconstruct
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.shapes import Superquadric

Section = Callable[[Floats, float], Floats]
Orders = tuple[int, int]
BAND = 6e-3  # Half the height of the band that is touched along a contour [m]


def circle(count: int) -> Floats:
    """Points (count, 2) of the unit circle at even azimuths, counter-clockwise from x."""
    return polar(np.arange(count) / count, 1.0)


def polar(turns: Floats, radius: Floats | float = 1.0) -> Floats:
    """Points (k, 2) at polar angles [turns] and distances from the origin."""
    angle = 2.0 * np.pi * turns
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(np.asarray(radius).reshape(-1, 1) * rim)


def along(polygon: Floats, turns: Floats) -> Floats:
    """Points (k, 2) of a closed polygon (n, 2), at shares of its length."""
    closed = np.vstack([polygon, polygon[:1]])
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    return np.column_stack([np.interp(turns * lengths[-1], lengths, one) for one in closed.T])


def at_height(plane: Floats, height: float) -> Floats:
    """Points (k, 3) of points (k, 2) at a height."""
    return np.column_stack([plane, np.full(len(plane), height)])


def column(count: int) -> list[Floats]:
    """Contours of a round column of radius 30, from -49.5 to 49.5."""
    return [at_height(30.0 * circle(60), z) for z in np.linspace(-49.5, 49.5, count)]


def slow(*values: Any) -> Any:
    """A slow case of a parametrised test."""
    return pytest.param(*values, marks=pytest.mark.slow)


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def assert_derivatives(
    at: Callable[[Floats, Floats, Orders], Floats],
    v: Floats,
    turns: Floats,
    tolerance: float = 1e-5,
    share: float = 1.0,
    on_grid: Callable[[Floats, Floats, Orders], Floats] | None = None,
) -> None:
    """Assert that derivatives (n, 3), up to second order, equal differences at a share of places.

    If `on_grid` is given, its results equal those at each place of the grid.
    """
    for by in [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]:
        values = at(v, turns, by)
        size = max(float(np.abs(values).max()), float(np.abs(at(v, turns, (0, 0))).max()))
        if on_grid is not None:
            grid = on_grid(v, turns, by)[np.arange(len(v)), np.arange(len(v))]
            assert np.abs(grid - values).max() < 1e-9 * size
        h, t = (1e-5, 0.0) if by[0] else (0.0, 1e-5)
        lower = (by[0] - 1, by[1]) if by[0] else (0, by[1] - 1)
        if sum(by):
            slopes = (at(v + h, turns + t, lower) - at(v - h, turns - t, lower)) / 2e-5
            assert np.quantile(np.abs(values - slopes).max(axis=1), share) < tolerance * size


def contacts(points: Floats, normals: Floats | None, touch: Any = None) -> ContactPoints:
    """Contact points, all of one touch unless numbered."""
    numbers = np.zeros(len(points)) if touch is None else touch
    return ContactPoints(points, normals, np.asarray(numbers, np.int32))


def only(touched: ContactPoints, kept: Any) -> ContactPoints:
    """Some of the contact points: those of a mask, or of a slice."""
    return ContactPoints(*(np.asarray(field)[kept] for field in touched))


def is_closed(solid: LatticeSolid, tolerance: float | None = None) -> bool:
    """Whether the mesh is closed and of genus 0, and all figures are finite."""
    mesh = solid.mesh(tolerance)
    body = solidity(mesh.vertices, mesh.faces)
    finite = np.isfinite(mesh.vertices).all() and np.isfinite([*solid.health().values()]).all()
    return bool(finite and body.watertight and body.genus == 0)


class Oracle:
    """Points and normals of a superquadric that stands on height 0."""

    def __init__(self, size: Sequence[float], exponents: Sequence[float], scale: float = 1.0):
        self.shape = Superquadric(scale * np.array(size), np.array(exponents))
        self.scale = scale
        self.middle = np.array([0.0, 0.0, self.shape.size[2]])

    def section(self, share: float, count: int = 120) -> Floats:
        """Points (n, 3) at a height, as a share of the half height over the middle."""
        (a, b, c), (e1, e2) = self.shape.size, self.shape.exponents
        wide = (1.0 - abs(share) ** (2.0 / e1)) ** (0.5 * e1)
        plane = wide * superellipse(np.arange(count) / count, e2, a, b)
        return at_height(plane, share * c) + self.middle

    def contacts_at(self, points: Floats) -> ContactPoints:
        """The points with their outward normals, by central differences of the gauge."""
        local, step = points - self.middle, 1e-6 * self.scale * np.eye(3)
        slopes = [self.shape.gauge(local + one) - self.shape.gauge(local - one) for one in step]
        gradient = np.stack(slopes, axis=-1)
        return contacts(points, gradient / np.linalg.norm(gradient, axis=1, keepdims=True))

    def band(self, share: float) -> ContactPoints:
        """Contacts of touches along a contour, in a band above and below it."""
        half = BAND * self.scale / self.shape.size[2]
        levels = np.linspace(share - half, share + half, 9)
        rings = [self.section(level) for level in levels if abs(level) < 1.0]
        return self.contacts_at(np.concatenate(rings))

    def top(self) -> ContactPoints:
        """Contacts of touches from above, over the middle 0.42 of the width."""
        grid = np.stack(np.meshgrid(*2 * (np.linspace(-0.42, 0.42, 12),)), axis=-1)
        reach = 3.0 * self.shape.size[2]
        origins = at_height(grid.reshape(-1, 2) * self.shape.size[:2], reach)
        ranges = self.shape.cast(origins, np.array([0.0, 0.0, -1.0]), 3.0 * reach)
        return self.contacts_at(origins - ranges[:, None] * [0.0, 0.0, 1.0] + self.middle)

    def evidence(
        self, shares: Sequence[float], top: bool = True
    ) -> tuple[list[Floats], ContactPoints, Floats]:
        """Contours, all contacts, and touches of the ends."""
        parts = [self.band(share) for share in shares]
        tops = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * self.middle[2]]])[: 1 + top]
        stacked = stack_points([*parts, self.top()] if top else parts)
        return [self.section(share) for share in shares], stacked, tops

    def rebuilt(self, shares: Sequence[float], top: bool = True, **options: Any) -> LatticeSolid:
        """The solid of contours at these heights, contacts along them and from above."""
        rings, touched, tops = self.evidence(shares, top)
        return reconstruct(rings, patches=touched, tops=tops, **{"method": "skin", **options})

    def distances(self, points: Floats) -> Floats:
        """Radial distance of points (n, 3) from the surface [m]."""
        local = points - self.middle
        return np.asarray(np.linalg.norm(local, axis=1) * (1 - 1 / self.shape.gauge(local)))


def turned(points: Floats, angle: float) -> Floats:
    """Points (k, 2) turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def superellipse(turns: Floats, exponent: float, a: float, b: float) -> Floats:
    """Points (k, 2) at given azimuths."""
    c, s = np.abs(np.cos(2 * np.pi * turns)) / a, np.abs(np.sin(2 * np.pi * turns)) / b
    power = 2 / exponent
    return polar(turns, (c**power + s**power) ** (-exponent / 2))


def _lobed(turns: Floats, z: float) -> Floats:
    angle = 2 * np.pi * turns
    wave = 1 + 0.12 * np.cos(3 * angle) + 0.08 * np.sin(2 * angle + 2 * z)
    return polar(turns, np.sqrt(1.04 - z * z) * (0.75 + 0.18 * np.sin(9 * z)) * wave)


def _bent_tube(turns: Floats, z: float) -> Floats:
    middle = np.array([0.9 * z * z + 0.3 * z, 0.2 * np.sin(2.5 * z)])
    return np.asarray((1 - 0.3 * z * z) * superellipse(turns, 1.0, 0.4, 0.26) + middle)


def _kidney(turns: Floats, z: float) -> Floats:
    """A bent sausage that turns with the height; the middle of its area lies outside."""
    bend = 1.9 * np.sin(2 * np.pi * turns)
    width = 0.52 + 0.16 * np.cos(2 * np.pi * turns)
    return turned(polar(bend / (2 * np.pi), width) - [0.28, 0.0], 0.6 * z)


# Objects between the heights -1 and 1: places at equal parameters correspond.
SECTIONS: dict[str, Section] = {
    "lobed": _lobed,
    "three lobes": lambda t, z: turned(
        polar(t, 0.6 + 0.132 * np.cos(6 * np.pi * t)), 1.5 * (z + 1)
    ),
    "four lobes": lambda t, z: turned(
        polar(t, 0.6 + 0.09 * np.cos(8 * np.pi * t) + 0.03 * np.cos(2 * np.pi * t)), 2.0 * (z + 1)
    ),
    "square": lambda t, z: turned(superellipse(t, 0.3, 0.55, 0.55), z + 1),
    "bent tube": _bent_tube,
    "star": lambda t, z: polar(t, 0.55 * (1 + 0.4 * np.cos(10 * np.pi * t)) * (1 - 0.2 * z * z)),
    "kidney": _kidney,
    "box": lambda t, z: (1 - 0.1 * z) * superellipse(t, 0.1, 0.6, 0.45),
}


def curve_distances(rim: Floats, points: Floats) -> Floats:
    """Distances (n,) of points (n, 2) near a closed curve (k, 2), to its nearest tangents."""
    nearest = cKDTree(rim).query(points)[1]
    ahead = (np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0))[nearest]
    off = points - rim[nearest]
    across = off[:, 0] * ahead[:, 1] - off[:, 1] * ahead[:, 0]
    return np.abs(across) / np.linalg.norm(ahead, axis=1)


class Traced:
    """Contours of an object with random starts, directions and numbers of points."""

    def __init__(self, section: str):
        self.section = SECTIONS[section]
        self.rng = np.random.default_rng(0)

    def contour(self, height: float, points: int) -> Floats:
        """Points (n, 3) at even lengths, 0.8 to 1.25 times as many as `points`."""
        count = int(points * self.rng.uniform(0.8, 1.25))
        turns = np.mod(self.rng.uniform() + np.arange(count) / count, 1.0)
        traced = along(self.section(np.arange(4000) / 4000, height), turns)
        return at_height(traced[::-1] if self.rng.uniform() < 0.5 else traced, height)

    def contours(self, heights: Floats, points: int, noise: float = 0.0) -> list[Floats]:
        """A contour at each height, with noise in all three coordinates."""
        traced = [self.contour(float(height), points) for height in heights]
        return [one + noise * self.rng.normal(size=one.shape) for one in traced]
