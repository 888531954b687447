"""Lofts of objects between the heights -1 and 1, with what they were fitted to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.side.lofting import ContourLoft, fit_contour_loft


def ring(radius: Floats) -> Floats:
    """Points (k, 2) at even azimuths."""
    angle = 2 * np.pi * np.arange(len(radius)) / len(radius)
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def angles(count: int) -> Floats:
    return np.asarray(2 * np.pi * np.arange(count) / count)


def turned(points: Floats, angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def rounded_box(z: float, count: int) -> Floats:
    angle = angles(count)
    c, s = np.abs(np.cos(angle)) / 0.6, np.abs(np.sin(angle)) / 0.45
    return (1 - 0.1 * z) * ring((c**8 + s**8) ** (-1 / 8))


def star(z: float, count: int) -> Floats:
    return ring(0.55 * (1 + 0.3 * np.cos(5 * angles(count))) * (1 - 0.2 * z * z))


def lobed(z: float, count: int) -> Floats:
    angle = angles(count)
    wave = 1 + 0.12 * np.cos(3 * angle) + 0.08 * np.sin(2 * angle + 2 * z)
    return ring(np.sqrt(1.04 - z * z) * (0.75 + 0.18 * np.sin(9 * z)) * wave)


SECTIONS: dict[str, Callable[[float, int], Floats]] = {
    "lobed": lobed,
    "rounded box": rounded_box,
    "flat ellipse": lambda z, n: turned(ring(np.ones(n)) * [0.6, 0.2], 0.3 + 0.5 * z),
    "twisted lobes": lambda z, n: turned(ring(0.6 + 0.09 * np.cos(4 * angles(n))), 2.0 * (z + 1)),
    "star": star,
    "bent tube": lambda z, n: (
        ring(np.ones(n)) * [0.4, 0.26] * (1 - 0.3 * z * z)
        + [0.9 * z * z + 0.3 * z, 0.2 * np.sin(2.5 * z)]
    ),
}


class SampledObject:
    """An object, sampled at some heights."""

    def __init__(self, name: str, rows: int = 27, around: int = 80, noise: float = 0.0):
        self.section = SECTIONS[name]
        self.heights = np.linspace(-0.98, 0.98, rows)
        grid = np.stack([self.section(float(z), around) for z in self.heights])
        rng = np.random.default_rng(0)
        self.grid = grid + noise * rng.normal(size=grid.shape)

    def loft(self) -> ContourLoft:
        return fit_contour_loft(self.heights, self.grid, low=-1.0, high=1.0)

    def contours(self) -> list[Floats]:
        return [
            np.column_stack([row, np.full(len(row), z)])
            for row, z in zip(self.grid, self.heights, strict=True)
        ]

    def off(self, points: Floats) -> Floats:
        """Distance (n,) within their level of points (n, 3) from the object."""
        found = np.empty(len(points))
        for number, (x, y, z) in enumerate(points):
            rim = self.section(float(z), 720)
            along = np.roll(rim, -1, axis=0) - rim
            share = np.sum(([x, y] - rim) * along, axis=1) / np.sum(along**2, axis=1)
            foot = rim + np.clip(share, 0.0, 1.0)[:, None] * along
            found[number] = np.linalg.norm(foot - [x, y], axis=1).min()
        return found


@pytest.fixture(scope="session")
def sampled() -> Callable[..., SampledObject]:
    return SampledObject
