from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import Flat
from palpate.core.rebuild.ends.ends import End
from palpate.core.rebuild.surface.surface import close_surface
from palpate.core.rebuild.surface.surface_measures import measure_surface

SIZE = np.array([0.05, 0.04, 0.03])
VOLUME = 4.0 / 3.0 * np.pi * float(np.prod(SIZE))


class Moved:
    """A side somewhere else."""

    def __init__(self, side: Any, shift: Floats):
        self.side, self.shift = side, shift

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), or derivatives of them."""
        return np.asarray(self.side.at(v, turns, by) + self.shift * (by == (0, 0)))


def test_an_ellipsoid_has_its_volume_and_its_inertia(ellipsoid_side: Callable[..., Any]) -> None:
    found = measure_surface(close_surface(ellipsoid_side(SIZE)))

    a, b, c = SIZE**2
    assert found.moments.volume == pytest.approx(VOLUME, rel=1e-12)
    np.testing.assert_allclose(found.moments.centroid, 0.0, atol=1e-15)
    np.testing.assert_allclose(
        found.inertia(), VOLUME / 5.0 * np.diag([b + c, a + c, a + b]), atol=1e-12 * VOLUME
    )
    assert found.error < 1e-9


def test_the_area_of_a_sphere_is_exact(ellipsoid_side: Callable[..., Any]) -> None:
    found = measure_surface(close_surface(ellipsoid_side([0.03, 0.03, 0.03])))

    assert found.area == pytest.approx(4 * np.pi * 0.03**2, rel=1e-12)


def test_far_from_the_origin_nothing_is_lost(ellipsoid_side: Callable[..., Any]) -> None:
    shift = np.array([100.0, -200.0, 300.0])
    here = measure_surface(close_surface(ellipsoid_side(SIZE)))
    there = measure_surface(close_surface(Moved(ellipsoid_side(SIZE), shift)))

    assert there.moments.volume == pytest.approx(here.moments.volume, rel=1e-9)
    np.testing.assert_allclose(there.moments.centroid, shift, rtol=1e-12)
    expected = here.moments.second + VOLUME * np.outer(shift, shift)
    np.testing.assert_allclose(there.moments.second, expected, rtol=1e-9)


def test_ends_count_and_the_pieces_between_edges_are_exact(
    ellipsoid_side: Callable[..., Any],
) -> None:
    low, high = -1.0, 0.5
    heights = 0.03 * np.sin([low, high])
    none = np.zeros(2)
    surface = close_surface(
        ellipsoid_side([0.03, 0.03, 0.03], low, high),
        End("fan", heights[0], heights[0], 0.0, Flat(0.0), none, True),
        End("flat", heights[1], heights[1] + 0.02, 0.0, Flat(-0.5), none, True),
    )

    found = measure_surface(surface)

    def ball(z: float) -> float:
        return float(np.pi * (0.03**2 * z - z**3 / 3.0))

    rim = 0.03 * np.cos(high)
    frustum = np.pi * 0.02 / 3.0 * rim**2 * (1.0 + 0.5 + 0.25)
    volume = ball(heights[1]) - ball(heights[0]) + frustum
    slant = np.hypot(0.02, 0.5 * rim)
    sphere = 2 * np.pi * 0.03 * (heights[1] - heights[0])
    discs = np.pi * ((0.03 * np.cos(low)) ** 2 + (0.5 * rim) ** 2)
    assert found.moments.volume == pytest.approx(volume, rel=1e-10)
    assert found.area == pytest.approx(sphere + np.pi * 1.5 * rim * slant + discs, rel=1e-10)
