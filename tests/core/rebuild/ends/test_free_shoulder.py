from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.free_shoulder import free_shoulder

HALF, GAP = 50.0, 0.5


def contours(count: int) -> Floats:
    """Heights, the last one half a millimetre before the end."""
    return np.linspace(-HALF + GAP, HALF - GAP, count)


def rounded(depths: Floats, power: float = 10.0) -> Floats:
    """A box whose edges are rounded off."""
    return 30.0 * (1.0 - np.abs(depths / HALF) ** power) ** (1.0 / power)


@pytest.mark.parametrize("count", [20, 24, 27, 40])
def test_a_rounded_edge_tells_where_the_box_ends(count: int) -> None:
    depths = contours(count)

    found = free_shoulder(depths, rounded(depths), 0.0)

    assert found == pytest.approx(GAP, abs=0.4 * GAP)


def test_noise_lets_it_be_told_as_well_as_it_can() -> None:
    depths = contours(27)
    rng = np.random.default_rng(4)
    noisy = rounded(depths) + 0.02 * rng.normal(size=(30, 27))

    found = [free_shoulder(depths, radii, 0.02) for radii in noisy]

    told = np.array([GAP if one is None else abs(one - GAP) for one in found])
    assert np.sqrt(np.mean(told**2)) < 0.6 * GAP


def test_nothing_is_told_by_a_wall_a_cone_a_zigzag_or_few_contours() -> None:
    depths = contours(27)
    wall, cone = np.full(27, 30.0), 30.0 - 0.2 * depths
    zigzag = (20.0 + 8.0 * np.sin(depths)) * np.sqrt(1.0 - (depths / 51.0) ** 2)

    assert free_shoulder(depths, wall, 0.0) is None
    assert free_shoulder(depths, cone, 0.0) is None
    assert free_shoulder(depths, zigzag, 0.0) is None
    assert free_shoulder(depths[-11:], rounded(depths[-11:]), 0.0) is None


def test_it_does_not_depend_on_the_unit() -> None:
    depths = contours(27)

    near, far = (free_shoulder(s * depths, s * rounded(depths), 0.0) for s in (1.0, 1e-3))

    assert near is not None and far == pytest.approx(1e-3 * near, rel=1e-9)
