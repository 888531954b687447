from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.measure.distance import Prepared, compare, prepare
from palpate.core.measure.solidity import solidity
from palpate.core.rebuild.contour_solid import close_contours
from palpate.core.rebuild.surface.rings import close_rings
from palpate.core.rebuild.surface.surface_measures import measure_surface
from palpate.core.rebuild.surface.surface_mesh import mesh_surface

K = 60
EXPONENTS = {"ball": 2.0, "rounded": 10.0, "cylinder": np.inf}
"""r = 30 (1 - |z / 50|^p)^(1/p), and the plain cylinder."""


def radius(name: str, heights: Floats) -> Floats:
    power = EXPONENTS[name]
    if np.isinf(power):
        return np.full_like(heights, 30.0)
    share = np.minimum(np.abs(heights) / 50.0, 1.0)
    return np.asarray(30.0 * (1.0 - share**power) ** (1.0 / power))


def rings(heights: Floats, radii: Floats, count: int = K) -> Floats:
    angle = 2 * np.pi * np.arange(count) / count
    across = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flat = radii[:, None, None] * across
    return np.concatenate(
        [flat, np.broadcast_to(heights[:, None, None], (*flat.shape[:2], 1))], axis=2
    )


def truth(name: str) -> Prepared:
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 300)[1:-1]
    heights = 50.0 * np.sign(latitude) * (1.0 - (1.0 - np.abs(np.sin(latitude))) ** 1.5)
    poles = np.array([[0.0, 0.0, -50.0], [0.0, 0.0, 50.0]])
    solid = close_rings(poles[0], rings(heights, radius(name, heights), 200), poles[1])
    return prepare(*solid)


@pytest.mark.parametrize("name", EXPONENTS)
def test_with_touched_ends_the_solid_is_far_better_than_a_loft_of_its_contours(name: str) -> None:
    heights = np.linspace(-45.0, 45.0, 27)
    contours = rings(heights, radius(name, heights))
    loft = close_rings(np.array([0, 0, -45.0]), contours, np.array([0, 0, 45.0]))

    found = close_contours(heights, contours[:, :, :2], bottom=-50.0, top=50.0)

    mesh = mesh_surface(found.surface, 0.02)
    assert solidity(mesh.vertices, mesh.faces)[:3] == (True, 1, 0)
    whole = truth(name)
    near = compare(whole, prepare(mesh.vertices, mesh.faces)).chamfer
    assert near < 0.15 * compare(whole, prepare(*loft)).chamfer


def test_a_ball_is_whole_without_a_touch() -> None:
    heights = np.linspace(-45.0, 45.0, 9)
    contours = rings(heights, np.sqrt(2500.0 - heights**2))[:, :, :2]

    found = close_contours(heights, contours)

    assert (found.bottom.kind, found.top.kind) == ("pole", "pole")
    volume = measure_surface(found.surface).moments.volume
    assert volume == pytest.approx(4 / 3 * np.pi * 50.0**3, rel=1e-4)


def test_two_contours_are_enough() -> None:
    contours = rings(np.array([0.0, 10.0]), np.array([10.0, 10.0]))[:, :, :2]

    found = close_contours(np.array([0.0, 10.0]), contours, top=15.0)

    volume = measure_surface(found.surface).moments.volume
    assert volume == pytest.approx(np.pi * 100.0 * 15.0, rel=1e-3)


def test_one_contour_between_touched_ends_is_a_prism() -> None:
    contour = rings(np.zeros(1), np.full(1, 10.0))[:, :, :2]

    found = close_contours(np.zeros(1), contour, bottom=-5.0, top=15.0)

    volume = measure_surface(found.surface).moments.volume
    assert volume == pytest.approx(np.pi * 100.0 * 20.0, rel=1e-3)


@pytest.mark.parametrize("ends", [(0,), (-1,), (0, -1)])
def test_hard_case_49_a_contour_that_collapsed_to_a_point_closes_the_end(
    ends: tuple[int, ...],
) -> None:
    heights = np.linspace(-45.0, 45.0, 13)
    heights[list(ends)] = np.sign(heights[list(ends)]) * 50.0
    contours = rings(heights, np.sqrt(2500.0 - heights**2))[:, :, :2]

    found = close_contours(heights, contours)

    whole = measure_surface(found.surface)
    assert whole.moments.volume == pytest.approx(4 / 3 * np.pi * 50.0**3, rel=1e-3)
    mesh = mesh_surface(found.surface, 0.1)
    assert solidity(mesh.vertices, mesh.faces)[:3] == (True, 1, 0)
    assert np.isfinite(mesh.vertices).all()


@pytest.mark.parametrize(
    ("count", "radius", "told"), [(0, 1.0, {}), (1, 1.0, {"top": 1.0}), (3, 0.0, {})]
)
def test_too_few_contours_are_refused(count: int, radius: float, told: dict[str, float]) -> None:
    heights = np.arange(count, dtype=float)
    contours = rings(heights, np.full(count, radius))[:, :, :2]
    with pytest.raises(ValueError, match="heights must be at least 2 unless both ends were"):
        close_contours(heights, contours, **told)
