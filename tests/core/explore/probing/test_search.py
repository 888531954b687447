from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.explore.probing.known import EndKnown, Probed, Wall
from palpate.core.explore.probing.search import along_axis, highest_known, search_places


def test_places_of_a_search_are_a_pad_apart_and_few() -> None:
    places = np.stack(search_places(0.1, 0.015))
    assert len(places) == 1 + 6 + 12 + 18
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(len(places))
    assert apart.min() == pytest.approx(0.015, rel=0.06)
    assert len(search_places(0.01, 0.015)) == 1


def test_a_search_begins_above_all_that_may_be(known: EndKnown, ring: Callable[..., Wall]) -> None:
    assert highest_known(known) == pytest.approx(0.0415)
    wall = ring(0.02, 0.04, above=4e-3)
    assert highest_known(replace(known, wall=wall)) == pytest.approx(0.044)


def test_once_it_is_found_the_guess_no_longer_counts(known: EndKnown) -> None:
    probing = along_axis(known, np.zeros(2))
    made = Probed(probing, "hit", np.array([0.0, 0.0, 0.035]), np.array([0.0, 0.0, 1.0]))
    assert highest_known(replace(known, probes=(made,))) == pytest.approx(0.035)


def test_a_search_goes_down_to_half_the_height(known: EndKnown) -> None:
    probing = along_axis(known, np.array([0.01, 0.0]))
    assert probing.pose[2] - probing.reach == pytest.approx(0.0)
