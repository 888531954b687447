"""Contours of known objects, and plane figures that are hard to fit."""

import numpy as np

from palpate.core.arrays import Floats
from tests.core.rebuild.objects import along, at_height, polar

BEND = np.linspace(-2.2, 2.2, 120) / (2 * np.pi)
CORNERS = {
    # Open upwards: the middle of its box is outside
    "u": np.array(
        [[-1, 1], [-1, -1], [1, -1], [1, 1], [0.6, 1], [0.6, -0.6], [-0.6, -0.6], [-0.6, 1.0]]
    ),
    # Open to the left: its centroid is outside
    "c": np.vstack([polar(BEND), 0.55 * polar(BEND)[::-1]]),
    "lobes": (1 + 0.45 * np.cos(6 * np.pi * np.arange(16) / 16))[:, None]
    * polar(np.arange(16) / 16),
}


def figure(name: str, count: int) -> Floats:
    """Points (count, 2) evenly around a named figure, counter-clockwise."""
    return along(CORNERS[name], np.arange(count) / count)


def prism(points: Floats, rows: int) -> Floats:
    """The same contour (n, 2) at even heights from 0 to 2: (rows, n, 3)."""
    return np.stack([at_height(points, z) for z in np.linspace(0.0, 2.0, rows)])


def vase_radius(height: Floats, azimuth: Floats) -> Floats:
    return (0.7 + 0.15 * np.sin(3 * height)) * (1 + 0.1 * np.cos(3 * azimuth))


def vase(rows: int = 13, count: int = 40) -> Floats:
    """Contours (rows, count + 1, 3) of a lobed vase 2 high, closed, begun at azimuth -pi."""
    height = np.linspace(-1.0, 1.0, rows)[:, None]
    turn = np.linspace(-np.pi, np.pi, count + 1)
    radius = vase_radius(height, turn)
    level = np.broadcast_to(height, radius.shape)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), level], axis=-1)
