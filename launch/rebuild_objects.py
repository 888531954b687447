"""Objects with a simple formula, on which rebuilding from contours is measured.

None of them was used to choose a constant of the methods.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

HEIGHT = 2.0
"""Of every object that is measured; its contours lie from -1 to 1."""
STEP = 1e-5
"""Over which slopes are taken."""

Radius = Callable[[Floats, Floats], Floats]
Middle = Callable[[Floats], Floats]


class RoundObject(NamedTuple):
    """What its contours at heights z and azimuths t about its axis are."""

    radius: Radius
    """Of the arrays z and t."""
    axis: Middle
    """Places (..., 2) of the axis at heights."""

    def contours(self, heights: Floats, turns: int) -> Floats:
        """Points (m, turns, 2) at even azimuths."""
        angle = 2.0 * np.pi * np.arange(turns) / turns
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        radius = self.radius(heights[:, None], angle)
        return np.asarray(self.axis(heights)[:, None] + radius[..., None] * rim)

    def distances(self, places: Floats, heights: Floats) -> tuple[Floats, Floats]:
        """Normal distances (m, k) of places (m, k, 2) at heights (m,), and area elements.

        To first order: how far outside, over its slope.
        """
        z = np.broadcast_to(heights[:, None], places.shape[:2])
        outside = self._outside(places, z)
        slopes = [
            (self._outside(places + step, z) - self._outside(places - step, z)) / (2.0 * STEP)
            for step in STEP * np.eye(2)
        ]
        low, high = np.maximum(z - STEP, -1.0), np.minimum(z + STEP, 1.0)
        slopes.append((self._outside(places, high) - self._outside(places, low)) / (high - low))
        level = np.hypot(slopes[0], slopes[1])
        whole = np.hypot(level, slopes[2])
        around = np.linalg.norm(np.roll(places, -1, 1) - places, axis=-1)
        return outside / whole, around * whole / level

    def _outside(self, places: Floats, z: Floats) -> Floats:
        away = places - self.axis(z)
        angle = np.arctan2(away[..., 1], away[..., 0])
        return np.asarray(np.hypot(away[..., 0], away[..., 1]) - self.radius(z, angle))


def straight(z: Floats) -> Floats:
    """The axis through the origin."""
    return np.zeros((*z.shape, 2))


def bent(z: Floats) -> Floats:
    """An axis that leans and bends sideways by a third of the height."""
    return np.stack([0.6 * z**2 + 0.2 * z, 0.15 * np.sin(2.0 * z)], axis=-1)


def _wavy(z: Floats, t: Floats) -> Floats:
    """The lobed zig-zag on which lattices and skins were compared."""
    lobes = 1.0 + 0.12 * np.cos(3.0 * t) + 0.08 * np.sin(2.0 * t + 2.0 * z)
    return np.asarray(np.sqrt(1.04 - z**2) * (0.75 + 0.18 * np.sin(9.0 * z)) * lobes)


def _barrel(z: Floats, t: Floats) -> Floats:
    return np.asarray((0.62 - 0.2 * z**2) * (1.0 + 0.06 * np.cos(2.0 * t)))


def _pear(z: Floats, t: Floats) -> Floats:
    return np.asarray(np.sqrt(1.1 - z**2) * (0.5 - 0.22 * np.tanh(2.5 * z)) + 0.0 * t)


def _hourglass(z: Floats, t: Floats) -> Floats:
    return np.asarray(np.sqrt(0.1 + 0.25 * z**2) * (1.0 + 0.1 * np.sin(4.0 * t + z)))


def _screw(z: Floats, t: Floats) -> Floats:
    return np.asarray((0.5 - 0.08 * z) * (1.0 + 0.12 * np.cos(3.0 * t - 2.2 * z)))


def _tile(z: Floats, t: Floats) -> Floats:
    square = (np.abs(np.cos(t)) ** 6.0 + np.abs(np.sin(t) / 0.7) ** 6.0) ** (-1.0 / 6.0)
    return np.asarray(0.6 * square * (1.0 - 0.2 * z) * (1.08 - z**4) ** 0.25)


def _tube(z: Floats, t: Floats) -> Floats:
    oval = 1.0 / np.sqrt(np.cos(t) ** 2 + (np.sin(t) / 0.7) ** 2)
    return np.asarray(0.4 * oval * (1.0 - 0.25 * z**2))


def _ogive(z: Floats, t: Floats) -> Floats:
    return np.asarray(np.sqrt(2.1**2 - (z + 1.0) ** 2) - 0.35 + 0.04 * np.cos(5.0 * t))


def _rings(z: Floats, t: Floats) -> Floats:
    return np.asarray(0.55 + 0.06 * np.cos(7.0 * z + 0.5 * np.sin(t)) - 0.1 * z)


WAVY = RoundObject(_wavy, straight)
OBJECTS: Mapping[str, RoundObject] = {
    "barrel": RoundObject(_barrel, straight),
    "pear": RoundObject(_pear, straight),
    "hourglass": RoundObject(_hourglass, straight),
    "screw": RoundObject(_screw, straight),
    "tile": RoundObject(_tile, straight),
    "bent tube": RoundObject(_tube, bent),
    "ogive": RoundObject(_ogive, straight),
    "rings": RoundObject(_rings, straight),
}
