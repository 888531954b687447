"""Contours of known objects, and plane figures that are hard to fit."""

import numpy as np

from palpate.core.arrays import Floats


def circle(turns: Floats) -> Floats:
    return np.column_stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)])


BEND = np.linspace(-2.2, 2.2, 120) / (2 * np.pi)
CORNERS = {
    # Open upwards: the middle of its box is outside
    "u": np.array(
        [[-1, 1], [-1, -1], [1, -1], [1, 1], [0.6, 1], [0.6, -0.6], [-0.6, -0.6], [-0.6, 1.0]]
    ),
    # Open to the left: its centroid is outside
    "c": np.vstack([circle(BEND), 0.55 * circle(BEND)[::-1]]),
    "lobes": (1 + 0.45 * np.cos(6 * np.pi * np.arange(16) / 16))[:, None]
    * circle(np.arange(16) / 16),
}


def figure(name: str, count: int) -> Floats:
    """Points (count, 2) evenly around a named figure, counter-clockwise."""
    closed = np.vstack([CORNERS[name], CORNERS[name][:1]])
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    places = np.arange(count) * lengths[-1] / count
    return np.column_stack([np.interp(places, lengths, closed[:, axis]) for axis in (0, 1)])


def prism(points: Floats, rows: int) -> Floats:
    """The same contour (n, 2) at even heights from 0 to 2: (rows, n, 3)."""
    levels = np.linspace(0.0, 2.0, rows)
    return np.stack([np.column_stack([points, np.full(len(points), z)]) for z in levels])


def vase_radius(height: Floats, azimuth: Floats) -> Floats:
    return (0.7 + 0.15 * np.sin(3 * height)) * (1 + 0.1 * np.cos(3 * azimuth))


def vase(rows: int = 13, count: int = 40) -> Floats:
    """Contours (rows, count + 1, 3) of a lobed vase 2 high, closed, begun at azimuth -pi."""
    height = np.linspace(-1.0, 1.0, rows)[:, None]
    turn = np.linspace(-np.pi, np.pi, count + 1)
    radius = vase_radius(height, turn)
    level = np.broadcast_to(height, radius.shape)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), level], axis=-1)
