from __future__ import annotations

import numpy as np
import pytest

from palpate.core.explore.approach import APPROACH, approach, search_places


def test_the_object_is_looked_for_at_the_origin_first_and_then_around_it() -> None:
    places = search_places(0.05, 0.012)
    distances = [float(np.linalg.norm(place)) for place in places]
    assert distances[0] == 0.0
    assert np.allclose(distances, sorted(distances), rtol=0, atol=1e-15)
    assert len(places) == 1 + 6 * (1 + 2 + 3 + 4)
    assert distances[-1] <= 0.05
    # Neighbours are no farther apart than a pad is wide.
    apart = np.linalg.norm(np.subtract.outer(places, places).diagonal(axis1=1, axis2=3), axis=-1)
    np.fill_diagonal(apart, np.inf)
    assert apart.min(axis=1).max() <= 0.013


def test_a_slice_is_approached_from_outside_all_contours_about_the_nearest() -> None:
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    low, high = 0.02 * rim, 0.03 * rim + [0.01, 0.0, 0.0]
    middle, distance = approach(0.08, [0.02, 0.07], [low, high])
    assert middle == pytest.approx([0.01, 0.0], abs=1e-12)
    assert distance == pytest.approx(0.03 + APPROACH)


def test_a_slice_on_the_way_to_a_tip_aside_is_expected_on_that_way() -> None:
    turn = 2 * np.pi * np.arange(60) / 60
    rim = 0.02 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    aside, over = np.array([0.05, 0.0, 0.1]), np.array([0.01, 0.0, 0.1])
    middle, distance = approach(0.09, [0.05], [rim], [aside])
    assert middle == pytest.approx([0.04, 0.0], abs=1e-12)
    assert distance == pytest.approx(0.06 + APPROACH)
    for height, tip in ((0.09, over), (0.02, aside), (0.05, aside)):
        assert approach(height, [0.05], [rim], [tip])[0] == pytest.approx([0.0, 0.0], abs=1e-12)
