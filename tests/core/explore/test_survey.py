from __future__ import annotations

import numpy as np
import pytest

from palpate.core.explore.survey import Survey


def _survey(standing: bool = False) -> Survey:
    return Survey(
        low=0.0,
        high=0.09,
        low_deviation=1e-3,
        high_deviation=1e-3,
        radius=0.03,
        pad_width=0.016,
        resolution=1e-5,
        standing=standing,
        reached=(0.01, 0.08),
    )


def test_what_was_felt_beyond_an_end_moves_it() -> None:
    survey = _survey().reaching(-0.002, 0.085).reaching(0.05, 0.093)
    assert (survey.low, survey.high) == (-0.002, 0.093)
    assert survey.reached == (-0.002, 0.093)


def test_an_object_that_stands_ends_where_it_stands() -> None:
    assert _survey(standing=True).reaching(-1e-4, 0.05).low == 0.0


@pytest.mark.parametrize(("tip", "high"), [(0.085, 0.085), (0.07, 0.08)])
def test_a_touched_end_lies_where_it_was_touched_or_beyond(tip: float, high: float) -> None:
    survey = _survey().ended(np.array([0.0, 0.0, tip]), upper=True)
    assert (survey.high, survey.high_deviation) == (high, 0.0)
    assert (survey.low, survey.low_deviation) == (0.0, 1e-3)


def test_each_end_has_one_tip_the_last_one() -> None:
    survey = _survey()
    for height in (0.085, 0.088, 0.002):
        survey = survey.ended(np.array([0.01, 0.0, height]), upper=height > 0.04)
    assert sorted(float(tip[2]) for tip in survey.tips) == [0.002, 0.088]
    assert (survey.low, survey.low_deviation) == (0.002, 0.0)
