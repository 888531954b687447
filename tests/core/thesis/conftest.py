"""Contours of known objects, and plane figures that are hard to fit."""

import numpy as np
import pytest


def around(corners, count):
    """Points (count, 2) evenly along a closed polygon."""
    closed = np.vstack([corners, corners[:1]])
    ways = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    places = np.arange(count) * ways[-1] / count
    return np.column_stack([np.interp(places, ways, closed[:, axis]) for axis in (0, 1)])


def u_corners():
    """A U open upwards: the middle of its box is outside."""
    return np.array(
        [[-1, 1], [-1, -1], [1, -1], [1, 1], [0.6, 1], [0.6, -0.6], [-0.6, -0.6], [-0.6, 1.0]]
    )


def c_corners():
    """A C open to the left, bent around its own centroid's place."""
    turn = np.linspace(-2.2, 2.2, 120)
    outer = np.column_stack([np.cos(turn), np.sin(turn)])
    return np.vstack([outer, 0.55 * outer[::-1]])


def lobes():
    """Three lobes with 16 vertices."""
    turn = 2.0 * np.pi * np.arange(16) / 16
    plane = np.column_stack([np.cos(turn), np.sin(turn)])
    return np.asarray((1 + 0.45 * np.cos(3 * turn))[:, None] * plane)


@pytest.fixture(scope="session")
def figure():
    """Points (count, 2) evenly around a named figure, counter-clockwise."""
    corners = {"u": u_corners, "c": c_corners, "lobes": lobes}

    def make(name, count):
        return around(corners[name](), count)

    return make


@pytest.fixture(scope="session")
def vase():
    """Contours (m, count + 1, 3) of a lobed vase 2 high, each closed, begun at azimuth -pi."""

    def make(rows=13, count=40):
        height = np.linspace(-1.0, 1.0, rows)[:, None]
        turn = np.linspace(-np.pi, np.pi, count + 1)
        radius = (0.7 + 0.15 * np.sin(3 * height)) * (1 + 0.1 * np.cos(3 * turn))
        level = np.broadcast_to(height, radius.shape)
        return np.stack([radius * np.cos(turn), radius * np.sin(turn), level], axis=-1)

    return make


@pytest.fixture(scope="session")
def prism():
    """The same contour (n, 2) at so many even heights from 0 to 2: (m, n, 3)."""

    def make(points, rows):
        return np.stack(
            [
                np.column_stack([points, np.full(len(points), height)])
                for height in np.linspace(0.0, 2.0, rows)
            ]
        )

    return make
