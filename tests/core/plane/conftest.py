from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats


def lobes(depth: float, count: int = 3000) -> Floats:
    angle = 2 * np.pi * np.arange(count) / count
    radius = 1.0 + depth * np.cos(3 * angle)
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def fine(polygon: Floats, each: int = 50) -> Floats:
    ends = np.roll(polygon, -1, axis=0)
    share = np.arange(each)[:, None] / each
    return np.concatenate([a + share * (b - a) for a, b in zip(polygon, ends, strict=True)])


@pytest.fixture
def three_lobes() -> Callable[..., Floats]:
    """1 + depth cos 3a around the origin."""
    return lobes


@pytest.fixture
def u_shape() -> Floats:
    """A U, 5 wide and 4 high, of legs 1 wide; counter-clockwise."""
    return np.array([[0, 0], [5, 0], [5, 4], [4, 4], [4, 1], [1, 1], [1, 4], [0, 4.0]])


@pytest.fixture
def refined() -> Callable[..., Floats]:
    """A polygon with further vertices on its edges."""
    return fine
