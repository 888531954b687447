from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.felt_beyond import felt_beyond
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_skin import FeltSkin, fit_skin
from palpate.core.rebuild.felt.spine import fit_spine

Make = Callable[..., Any]
NO_LEAN = np.zeros(2)
RIM, END = 0.072, 0.08
"""Of a box: its edge is rounded over some 8 mm."""


def skin_of(felt: FeltPoints) -> FeltSkin:
    spine = fit_spine(np.array([0.0, END]), np.zeros((2, 2)))
    return fit_skin(felt, spine, 0.0, END)


def felt_at(true: Any, heights: Floats) -> FeltPoints:
    sections = [true.section(height / 0.04 - 1.0) for height in heights]
    found = true.felt(np.concatenate(sections))
    assert isinstance(found, FeltPoints)
    return found


def test_an_edge_is_told_as_mean_radii(oracle: Make) -> None:
    true = oracle([0.03, 0.02, 0.04], [0.4, 0.4])
    felt = felt_at(true, np.linspace(0.002, 0.079, 60))
    skin = skin_of(felt)
    found = felt_beyond(felt, skin, RIM, END, 0.02, NO_LEAN)
    assert found is not None
    assert (np.diff(found.depths) > 0.0).all() and (np.diff(found.radii) < 0.0).all()
    assert found.depths[0] > RIM and found.depths[-1] < END
    # A section of a superquadric has the same shape at every height.
    mean = true.section(RIM / 0.04 - 1.0)[0, 0]
    there = [true.section(height / 0.04 - 1.0)[0, 0] / mean for height in found.depths]
    assert np.abs(found.radii / 0.02 - there).max() < 0.03


def test_what_was_felt_next_to_the_last_row_alone_tells_nothing(oracle: Make) -> None:
    true = oracle([0.03, 0.02, 0.04], [0.4, 0.4])
    felt = felt_at(true, np.append(np.linspace(0.002, 0.072, 40), np.nextafter(RIM, 1.0)))
    assert felt_beyond(felt, skin_of(felt), RIM, END, 0.02, NO_LEAN) is None


def test_what_was_felt_on_one_side_alone_tells_nothing(oracle: Make) -> None:
    true = oracle([0.03, 0.02, 0.04], [0.4, 0.4])
    felt = felt_at(true, np.linspace(0.002, 0.079, 60))
    assert felt.normals is not None
    aside = (felt.points[:, 0] > 0.0) & (np.abs(felt.points[:, 1]) < 0.4 * felt.points[:, 0])
    kept = (felt.points[:, 2] < RIM) | aside
    less = FeltPoints(felt.points[kept], felt.normals[kept], felt.touch[kept])
    assert felt_beyond(less, skin_of(felt), RIM, END, 0.02, NO_LEAN) is None


def test_a_surface_that_leans_over_the_end_has_no_edge_to_tell_of(oracle: Make) -> None:
    true = oracle([0.03, 0.03, 0.04], [1.0, 1.0])
    heights = np.append(np.linspace(0.002, 0.077, 60), np.linspace(0.0772, 0.0798, 14))
    felt = felt_at(true, heights)
    skin = skin_of(felt)
    assert felt_beyond(felt, skin, 0.077, END, 0.01, NO_LEAN) is None
    assert felt_beyond(felt, skin, 0.06, END, 0.02, NO_LEAN) is not None
