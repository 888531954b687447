"""Radii of objects on which no planner was tuned: twenty with names, and random ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners import Radius


def _ball(z: Floats, power: float = 1.0) -> Floats:
    """Outline of a superellipse: 1 in the middle, 0 at both ends."""
    away = np.abs(2.0 * z - 1.0)
    return np.asarray(np.maximum(1.0 - away ** (2.0 / power), 1e-9) ** (power / 2.0))


def _rise(z: Floats, at: float, width: float) -> Floats:
    """A smooth step from 0 to 1 at a height."""
    return np.asarray(0.5 * (1.0 + np.tanh((z - at) / width)))


def _bump(z: Floats, at: float, width: float) -> Floats:
    return np.asarray(np.exp(-(((z - at) / width) ** 2)))


def _square(t: Floats, power: float = 6.0) -> Floats:
    return np.asarray((np.abs(np.cos(t)) ** power + np.abs(np.sin(t)) ** power) ** (-1.0 / power))


def _oval(t: Floats, ratio: float) -> Floats:
    return np.asarray(1.0 / np.sqrt(np.cos(t) ** 2 + (np.sin(t) / ratio) ** 2))


HELD_OUT: Mapping[str, Radius] = {
    "spheroid": lambda z, t: 0.3 * _ball(z) * _oval(t, 1.2),
    "pillow": lambda z, t: 0.4 * _ball(z, 0.7) * _square(t, 4.0),
    "tile": lambda z, t: 0.35 * _ball(z, 0.3) * _square(t, 8.0) * (1.0 - 0.2 * z),
    "barrel": lambda z, t: 0.36 - 0.4 * (z - 0.5) ** 2 + 0.01 * np.cos(2.0 * t),
    "ogive": lambda z, t: np.sqrt(2.0 - z**2) - 0.9 + 0.008 * np.cos(5.0 * t),
    "drop": lambda z, t: 0.75 * np.sqrt(z * np.maximum(1.0 - z, 1e-9)) * (1.2 - z) + 0.0 * t,
    "flask": lambda z, t: 0.13 + 0.2 * _rise(z, 0.6, -0.07) * (1.0 - 0.4 * z) + 0.0 * t,
    "jar": lambda z, t: 0.24 + 0.07 * _rise(z, 0.75, -0.05) + 0.02 * _bump(z, 0.3, 0.2) + 0.0 * t,
    "goblet": lambda z, t: 0.12 + 0.18 * _rise(z, 0.55, 0.1) + 0.14 * _bump(z, 0.0, 0.13) + 0.0 * t,
    "spindle": lambda z, t: 0.2 + 0.06 * np.sin(11.0 * z) + 0.05 * z + 0.0 * t,
    "collar": lambda z, t: 0.27 + 0.035 * _bump(z, 0.63, 0.075) + 0.0 * t,
    "waist": lambda z, t: 0.33 - 0.09 * _bump(z, 0.37, 0.12) + 0.01 * np.cos(3.0 * t),
    "screw": lambda z, t: (0.3 - 0.05 * z) * (1.0 + 0.08 * np.cos(3.0 * t - 2.6 * z)),
    "clover": lambda z, t: 0.3 * _ball(z, 0.8) * (1.0 + 0.06 * np.cos(4.0 * t + 1.0)),
    "dimple": lambda z, t: (
        0.36 * _ball(z, 0.8) * (1.0 - 0.08 * _bump(z, 0.35, 0.1) * (1.0 + np.cos(t)) / 2.0)
    ),
    "potato": lambda z, t: (
        0.34 * _ball(z, 0.9) * (1.0 + 0.08 * np.sin(4.0 * z + t) + 0.05 * np.cos(3.0 * z - 2.0 * t))
    ),
    "cone": lambda z, t: 0.4 - 0.25 * z + 0.0 * t,
    "two steps": lambda z, t: (
        0.18 + 0.07 * _rise(z, 0.35, -0.045) + 0.07 * _rise(z, 0.7, -0.045) + 0.0 * t
    ),
    "knob": lambda z, t: np.sqrt(0.02 + 0.3 * (z - 0.35) ** 2 * (1.25 - z)) + 0.0 * t,
    "leaning": lambda z, t: 0.3 * _ball(z, 0.5) * (1.0 + 0.25 * (z - 0.4) * np.cos(t)),
}
KINDS = ("round", "round necked", "round wavy", "straight necked", "straight stepped", "wavy")


def drawn_objects(count: int, seed: int) -> Mapping[str, Radius]:
    """Random objects: round or straight, plain, lobed, twisted, necked, stepped or wavy."""
    rng = np.random.default_rng(seed)
    return {f"drawn {i}": _drawn(rng) for i in range(count)}


def _drawn(rng: np.random.Generator) -> Radius:
    kind = KINDS[rng.integers(len(KINDS))]
    power, width_share, taper = (
        rng.uniform(0.3, 1.0),
        rng.uniform(0.22, 0.4),
        rng.uniform(-0.3, 0.3),
    )
    lobes, phase = rng.integers(2, 6), rng.uniform(0.0, 6.0)
    lobe = rng.uniform(0.0, 0.08) * (rng.random() < 0.5)
    twist = rng.uniform(0.0, 4.0) * (rng.random() < 0.4)
    at, width, depth = rng.uniform(0.25, 0.75), rng.uniform(0.06, 0.2), rng.uniform(-0.3, 0.3)
    side, pace = rng.choice([-1.0, 1.0]), rng.uniform(3.0, 10.0)

    def radius(z: Floats, t: Floats) -> Floats:
        around = 1.0 + lobe * np.cos(lobes * t + phase - twist * z)
        radii = width_share * (1.0 + taper * (z - 0.5)) * around
        if kind.startswith("round"):
            radii = radii * _ball(z, power)
        if kind.endswith("necked"):
            radii = radii * (1.0 + depth * _bump(z, at, width))
        if kind.endswith("wavy"):
            radii = radii * (1.0 + 0.6 * abs(depth) * np.sin(pace * z + phase))
        if kind.endswith("stepped"):
            radii = radii * (0.65 + 0.35 * _rise(z, at, side * max(0.6 * width, 0.04)))
        return np.asarray(radii)

    return radius
