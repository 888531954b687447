import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.explore.planners.fuzzy import BEND, CHANGE, RULES, STEP, WORDS, Fuzzy, truths

values = st.floats(0.0, 50.0)
LAW = settings(derandomize=True, deadline=None, max_examples=50)


def test_there_is_one_rule_for_each_pair_of_words():
    assert set(RULES) == {(bend, change) for bend in WORDS for change in WORDS}
    assert set(RULES.values()) == set(STEP)


@pytest.mark.parametrize("rule", RULES)
def test_where_both_words_are_wholly_true_the_step_is_that_of_the_rule(rule):
    bend, change = BEND[WORDS.index(rule[0])], CHANGE[WORDS.index(rule[1])]
    assert Fuzzy().later(bend, change, 1) == pytest.approx(STEP[RULES[rule]])


@LAW
@given(bend=values, change=values, beyond=values)
def test_the_step_never_grows_with_change_and_stays_among_those_named(bend, change, beyond):
    step = Fuzzy().later(bend, change, 1)
    assert Fuzzy().later(bend, change + beyond, 1) <= step * (1.0 + 1e-9) + 0.02
    assert min(STEP.values()) <= round(step, 12) <= max(STEP.values())


@LAW
@given(value=values)
def test_the_words_share_the_truth_of_a_value(value):
    assert sum(truths(value, BEND).values()) == pytest.approx(1.0)
    assert min(truths(value, BEND).values()) >= 0.0


@pytest.mark.parametrize("name", ["vase", "bottle", "ball", "cylinder"])
def test_the_plan_in_millimetres_is_the_plan_in_metres_and_ends(name, sides, explored):
    metres, stop = explored(Fuzzy(), sides[name])
    millimetres, _ = explored(Fuzzy(), sides[name], 1000.0)
    assert stop is not None
    assert max(metres) == pytest.approx(0.97)
    np.testing.assert_allclose(millimetres, metres, rtol=1e-9)


def test_a_scale_out_of_range_is_refused():
    with pytest.raises(ValueError, match=r"scale is 0; expected 0\.1 to 2"):
        Fuzzy(scale=0.0)
