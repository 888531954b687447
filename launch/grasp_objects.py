"""Objects on which the grasp is measured: plain ones, featured ones, and two without an axis.

No constant of the grasp was chosen for one of them alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.triangles import TriangleShape
from palpate.core.shapes.warped import WarpedSuperquadric

RINGS, TURNS = 160, 96
Radius = Callable[[Floats, Floats], Floats]
"""Of heights from -1 to 1 and azimuths, m."""


def turned(radius: Radius, half_height: float) -> TriangleShape:
    """The solid about the z axis with this radius, and flat ends where it is not 0 there."""
    z = -np.cos(np.linspace(0.0, np.pi, RINGS))
    angle = 2.0 * np.pi * np.arange(TURNS) / TURNS
    r = np.maximum(radius(z[:, None], angle[None, :]), 1e-6)
    level = np.broadcast_to(half_height * z[:, None], r.shape)
    side = np.stack([r * np.cos(angle), r * np.sin(angle), level], axis=-1).reshape(-1, 3)
    ends = np.array([[0.0, 0.0, -half_height], [0.0, 0.0, half_height]])
    i, j = np.meshgrid(np.arange(RINGS - 1), np.arange(TURNS), indexing="ij")
    here, beside = (i * TURNS + j).ravel(), (i * TURNS + (j + 1) % TURNS).ravel()
    first = np.column_stack([here, beside, beside + TURNS])
    second = np.column_stack([here, beside + TURNS, here + TURNS])
    rim = np.arange(TURNS)
    after, last = (rim + 1) % TURNS, (RINGS - 1) * TURNS
    low = np.column_stack([np.full(TURNS, len(side)), after, rim])
    high = np.column_stack([np.full(TURNS, len(side) + 1), last + rim, last + after])
    faces = np.concatenate([first, second, low, high]).astype(np.int32)
    return TriangleShape(np.concatenate([side, ends]), faces)


def _round(profile: Callable[[Floats], Floats]) -> Radius:
    return lambda z, t: np.asarray(profile(z) + 0.0 * t)


def _step(z: Floats, at: float, width: float) -> Floats:
    """0 below a height, 1 above it."""
    return np.asarray(0.5 * (1.0 + np.tanh((z - at) / width)))


def _bottle(z: Floats) -> Floats:
    return np.asarray((0.032 - 0.018 * _step(z, 0.45, 0.08)) * (1.02 - z**20) ** 0.2)


def _vase(z: Floats) -> Floats:
    return np.asarray(0.024 + 0.008 * np.sin(4.0 * z + 0.5))


def _pear(z: Floats) -> Floats:
    return np.asarray(np.sqrt(np.maximum(1.0 - z**2, 0.0)) * (0.028 - 0.01 * np.tanh(2.5 * z)))


def _groove(z: Floats) -> Floats:
    return np.asarray(0.028 - 0.0035 * np.exp(-((z / 0.16) ** 4)))


def _stepped(z: Floats) -> Floats:
    return np.asarray(0.03 - 0.012 * _step(z, 0.1, 0.01))


def _star(z: Floats, t: Floats) -> Floats:
    return np.asarray(0.026 * (1.0 + 0.06 * np.cos(4.0 * t - 1.2 * z)) + 0.0 * z)


def _leaning(z: Floats, t: Floats) -> Floats:
    """Lobed and not symmetric: its middle leaves the axis."""
    lobes = 1.0 + 0.15 * np.cos(t + 1.5 * z) + 0.08 * np.cos(3.0 * t)
    return np.asarray(0.024 * lobes * np.sqrt(np.maximum(1.02 - z**4, 0.0)))


def _superquadric(size: tuple[float, float, float], e1: float, e2: float) -> Superquadric:
    return Superquadric(np.array(size), np.array([e1, e2]))


OBJECTS: Mapping[str, Callable[[], Shape]] = {
    "egg": lambda: WarpedSuperquadric(
        _superquadric((0.026, 0.026, 0.038), 1.0, 1.0), np.array([-0.3, -0.3])
    ),
    "ellipsoid": lambda: _superquadric((0.022, 0.03, 0.042), 1.0, 1.0),
    "box": lambda: _superquadric((0.03, 0.02, 0.04), 0.1, 0.1),
    "cylinder": lambda: _superquadric((0.022, 0.022, 0.045), 0.1, 1.0),
    "tapered and bent": lambda: WarpedSuperquadric(
        _superquadric((0.02, 0.018, 0.045), 0.5, 0.7), np.array([0.3, 0.3]), Bend(6.0)
    ),
    "tile": lambda: _superquadric((0.04, 0.04, 0.015), 0.2, 1.0),
    "bottle": lambda: turned(_round(_bottle), 0.05),
    "vase": lambda: turned(_round(_vase), 0.045),
    "pear": lambda: turned(_round(_pear), 0.045),
    "groove": lambda: turned(_round(_groove), 0.045),
    "step": lambda: turned(_round(_stepped), 0.045),
    "twisted star": lambda: turned(_star, 0.045),
    "lobed": lambda: turned(_leaning, 0.045),
    "ball": lambda: _superquadric((0.03, 0.03, 0.03), 1.0, 1.0),
    "cube": lambda: _superquadric((0.03, 0.03, 0.03), 0.1, 0.1),
}
