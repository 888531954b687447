"""The batched maps against those of one solid."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.recovery.straightening import Triple, straight_places, unbend, untaper
from palpate.core.shapes.global_deformations import Bend, Taper

POINTS = np.random.default_rng(0).uniform(-0.6, 0.6, (300, 3))


def triple(rows: int) -> Triple:
    x, y, z = (np.broadcast_to(POINTS[:, i], (rows, len(POINTS))) for i in range(3))
    return x, y, z


def test_unbending_is_that_of_the_bend_however_small() -> None:
    bends = np.array(
        [[0.0, 0.0], [1e-200, 0.0], [1e-16, 1e-16], [1e-9, -1e-9], [0.6, 0.5], [-1, 0]]
    )
    found = np.stack(straight_places(unbend(triple(len(bends)), bends)), axis=-1)
    for mine, (kx, ky) in zip(found, bends, strict=True):
        wanted = Bend(float(np.hypot(kx, ky)), float(np.arctan2(ky, kx))).inverse(POINTS)
        assert np.allclose(mine, wanted, rtol=0, atol=4e-15)


def test_places_at_the_centre_of_curvature_are_finite() -> None:
    centre = (np.array([[0.5]]), np.array([[0.0]]), np.array([[0.0]]))
    found = unbend(centre, np.array([[2.0, 0.0]]))
    assert all(np.isfinite(part).all() for part in straight_places(found))
    assert found.stretch.min() > 0


@pytest.mark.parametrize("taper", [[0.0, 0.0], [0.7, -0.5], [-0.95, 0.95]])
def test_untapering_is_that_of_the_taper_between_the_ends(taper: list[float]) -> None:
    size = np.array([[0.3, 0.2, 0.6]])
    found = np.stack(untaper(triple(1), size, np.array([taper])).place, axis=-1)[0]
    wanted = Taper(taper[0], taper[1], 0.6).inverse(POINTS) / size
    assert np.allclose(found, wanted, rtol=1e-14)


def test_beyond_the_ends_no_taper_within_bounds_collapses() -> None:
    far = (np.ones((2, 1)), np.ones((2, 1)), np.array([[-50.0], [50.0]]))
    widths = untaper(far, np.ones((2, 3)), np.array([[0.95, -0.95], [0.95, -0.95]])).width
    assert min(width.min() for width in widths) > 0
