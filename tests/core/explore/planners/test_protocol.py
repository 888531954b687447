import doctest
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from palpate.core.explore.planners.predicted import Predicted
from palpate.core.explore.planners.protocol import (
    PLANNER_NAMES,
    Budget,
    Choice,
    Height,
    Stop,
    Wait,
    check_choice,
    first_and_last,
    make_planner,
    planner_type,
    settled_height,
)
from palpate.core.explore.planners.uniform import Uniform


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"high": -1.0}, "high must lie above low 0.0 m, got -1.0 m"),
        ({"high": math.inf}, "high must lie above low"),
        ({"tolerance": 0.0}, "tolerance must be positive"),
        ({"tolerance": math.nan}, "tolerance must be positive"),
        ({"tolerance": 5e-6}, "at least the sensor's resolution 1e-05 m, got 5e-06 m"),
        ({"resolution": -1.0}, "resolution must be positive"),
        ({"feature": 0.0}, "feature must be positive"),
        ({"low_deviation": -1e-3}, "low_deviation must be 0 or more"),
        ({"high_deviation": math.nan}, "high_deviation must be 0 or more"),
        ({"finger_spacing": -1.0}, "finger_spacing must be 0 or more"),
        ({"pose_deviation": -1.0}, "pose_deviation must be 0 or more"),
    ],
)
def test_what_no_planner_can_work_with_is_refused(observation, changes, words):
    with pytest.raises(ValueError, match=words):
        observation(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"most_touches": 0}, "most_touches must be positive, got 0 touches"),
        ({"most_seconds": 0.0}, "most_seconds must be positive, got 0.0 s"),
        ({"most_seconds": math.nan}, "most_seconds must be positive"),
        ({"touches": -1}, "touches must be 0 or more"),
        ({"seconds": math.inf}, "seconds must be 0 or more and finite"),
    ],
)
def test_a_budget_of_nothing_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        Budget(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"height": math.nan}, "height must be finite"),
        ({"deviation": -1.0}, "deviation must be 0 or more"),
        ({"touches": -1}, "touches must be 0 or more and finite, got -1 touches"),
        ({"seconds": math.nan}, "seconds must be 0 or more"),
        ({"radii": np.full(16, -0.01)}, "radii must be at least 4 positive lengths"),
        ({"radii": np.full(16, math.nan)}, "radii must be finite"),
        ({"slopes": np.zeros(3)}, r"slopes must have shape \(16\)"),
    ],
)
def test_a_slice_that_cannot_be_is_refused(slice_of, changes, words):
    with pytest.raises(ValueError, match=words):
        slice_of(lambda z: 0.3, 0.5, **changes)


def test_slices_of_other_azimuths_are_refused(slice_of, observation):
    few = {
        name: np.full(8, 0.02)
        for name in ("radii", "slopes", "curvatures", "contact_low", "contact_high")
    }
    both = [slice_of(lambda z: 0.3, 0.5), slice_of(lambda z: 0.3, 0.6, **few)]
    with pytest.raises(ValueError, match=r"as many azimuths, got \[8, 16\]"):
        observation(both)


@dataclass(frozen=True)
class Says:
    """A planner that always says the same."""

    choice: Any

    def next(self, observation):
        return cast("Choice", self.choice)


@pytest.mark.parametrize("name", PLANNER_NAMES)
def test_what_palpates_own_planners_answer_is_handed_on(name, observation):
    planner = make_planner(name, {})
    assert check_choice(planner, observation()) == planner.next(observation())


@pytest.mark.parametrize(
    ("choice", "more"),
    [
        (Height(0.01, "up"), {}),
        (Height(np.float64(0.03), "up"), {"busy_heights": (0.01,), "finger_spacing": 0.02}),
        (Wait("busy"), {"busy_heights": (0.01,)}),
        (Stop("end"), {}),
    ],
)
def test_an_answer_that_can_be_acted_on_is_handed_on(choice, more, observation):
    assert check_choice(Says(choice), observation(**more)) is choice


@pytest.mark.parametrize(
    ("choice", "more", "words"),
    [
        (None, {}, "must answer with a Height, a Touch, a Wait or a Stop, got None"),
        (0.045, {}, "must answer with a Height, a Touch, a Wait or a Stop, got 0.045"),
        (Height(math.nan, ""), {}, "must lie between 0 and 0.09 m, got nan m"),
        (Height(0.09, ""), {}, "must lie between 0 and 0.09 m, got 0.09 m"),
        (Height(-1.0, ""), {}, "must lie between 0 and 0.09 m, got -1 m"),
        (Height(0.02, ""), {"busy_heights": (0.02,)}, "was asked for at 0.02 m before"),
        (
            Height(0.02, ""),
            {"busy_heights": (0.03,), "finger_spacing": 0.02},
            "0.02 m is nearer than 0.02 m to a finger at 0.03 m",
        ),
        (Wait(""), {}, "it waits, but no finger is at work"),
    ],
)
def test_an_answer_that_nobody_could_act_on_is_refused(choice, more, words, observation):
    with pytest.raises(ValueError) as caught:
        check_choice(Says(choice), observation(**more))
    assert str(caught.value).startswith("the planner Says gave no answer to act on: ")
    assert words in str(caught.value)


def test_a_planner_that_asks_for_a_failed_height_again_does_not_go_on_for_ever(observation, failed):
    with pytest.raises(ValueError, match=r"at 0.045 m before; it must go elsewhere, or stop"):
        check_choice(Says(Height(0.045, "")), observation([failed(0.045)]))


@dataclass(frozen=True)
class Settled(Says):
    """A planner that has a slice in which no model has a say."""

    def settled(self, observation):
        return self.choice


@pytest.mark.parametrize(
    ("planner", "more", "height"),
    [
        (Says(Height(0.01, "")), {}, None),
        (Settled(Height(0.01, "")), {}, 0.01),
        (Settled(None), {}, None),
        (Settled(Stop("end")), {}, None),
        (Settled(Height(0.2, "")), {}, None),
        (Settled(Height(0.01, "")), {"busy_heights": (0.01,)}, None),
        (Settled(Height(0.01, "")), {"budget": Budget(most_touches=9, touches=9)}, None),
    ],
)
def test_a_slice_in_which_no_model_has_a_say_is_one_that_can_be_acted_on(
    planner, more, height, observation
):
    found = settled_height(planner, observation(**more))
    assert (None if found is None else found.height) == height


@pytest.mark.parametrize("planner", [Predicted(), Uniform(count=4)])
def test_what_a_planner_says_to_be_settled_is_what_it_says_next(planner, observation):
    known = observation()
    settled = settled_height(planner, known)
    assert settled is not None
    assert settled == planner.next(known)


OWN = """
from dataclasses import dataclass
from palpate.core.explore.planners.protocol import Height, Stop

@dataclass(frozen=True, kw_only=True)
class Middle:
    share: float = 0.5

    def next(self, known):
        if known.slices:
            return Stop("one is enough")
        return Height(known.low + self.share * known.extent, "the middle")

@dataclass
class Loose:
    def next(self, known): ...

WORD = 1
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "own_planner.py").write_text(OWN)
    (tmp_path / "broken_planner.py").write_text("1 / 0")
    monkeypatch.syspath_prepend(str(tmp_path))


def test_every_name_has_its_planner_and_the_default_comes_first():
    assert planner_type(PLANNER_NAMES[0]) is Predicted
    for name in PLANNER_NAMES:
        assert make_planner(name, {}) == planner_type(name)()


def test_settings_reach_the_planner():
    assert make_planner("uniform", {"count": 5}) == Uniform(count=5)


@pytest.mark.usefixtures("own")
def test_a_users_own_planner_is_found_by_module_and_class():
    assert getattr(make_planner("own_planner:Middle", {"share": 0.3}), "share") == 0.3  # noqa: B009


@pytest.mark.usefixtures("own")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("own_planner:Loose", "must be a frozen dataclass with next"),
        ("own_planner:WORD", "must be a frozen dataclass"),
        ("own_planner:Absent", "must be a frozen dataclass"),
        ("no_such_planner:Any", "cannot be imported: ModuleNotFoundError"),
        ("broken_planner:Any", "cannot be imported: ZeroDivisionError"),
        (".own_planner:Middle", "must name its module in full"),
    ],
)
def test_what_is_no_planner_is_refused(name, words):
    with pytest.raises(ValueError, match=words):
        planner_type(name)


def test_an_unknown_name_is_refused_with_those_there_are():
    with pytest.raises(
        LookupError, match="no planner 'best'; there are predicted, touches, uniform"
    ):
        planner_type("best")


def test_an_unknown_setting_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match="'uniform' has no speed; it has count, order"):
        make_planner("uniform", {"speed": 1})


PAGE = Path(__file__).parents[4] / "docs" / "planning.md"


def test_the_examples_of_the_page_are_right():
    outcome = doctest.testfile(str(PAGE), module_relative=False)
    assert outcome.failed == 0
    assert outcome.attempted >= 10


@pytest.mark.parametrize(("tolerance", "inside"), [(1e-2, 0.03), (1.25e-3, 0.025), (2e-4, 0.02)])
def test_the_first_and_the_last_slice_are_nearer_to_the_ends_where_less_error_is_asked_for(
    observation, tolerance, inside
):
    asked = observation(tolerance=tolerance * 0.09)
    assert first_and_last(asked) == pytest.approx((inside * 0.09, (1.0 - inside) * 0.09))
