"""What a planner observes and answers, how it is made, and how a solid is judged."""

import math
from typing import Any

import numpy as np
import pytest

from palpate.core.explore import planners
from palpate.core.explore.planners import Budget, Height, Stop, Wait, make_planner
from tests.core.explore.planners.sides import CONTOUR, CYLINDER, Says, failed, known, slice_of

SHORT = slice_of(CYLINDER, 0.5, **dict.fromkeys(CONTOUR, np.full(8, 0.02)))


def slice_with(**changes: Any) -> planners.ObservedSlice:
    return slice_of(CYLINDER, 0.5, **changes)


@pytest.mark.parametrize(
    ("make", "changes", "words"),
    [
        (known, {"high": -1.0}, "high must lie above low 0.0 m, got -1.0 m"),
        (known, {"tolerance": 0.0}, "tolerance must be positive"),
        (known, {"tolerance": 5e-6}, "at least the sensor's resolution 1e-05 m, got 5e-06 m"),
        (known, {"resolution": -1.0}, "resolution must be positive"),
        (known, {"feature": 0.0}, "feature must be positive"),
        (known, {"feature": 1e-7}, r"at least 0.0001 of the height 0.09 m, got 1e-07 m"),
        (known, {"low_deviation": -1e-3}, "low_deviation must be 0 or more"),
        (known, {"high_deviation": math.nan}, "high_deviation must be 0 or more"),
        (known, {"deviation": -1.0}, "deviation must be 0 or more"),
        (known, {"ends_deviation": -1.0}, "ends_deviation must be 0 or more"),
        (known, {"pose_deviation": -1.0}, "pose_deviation must be 0 or more"),
        (known, {"finger_spacing": -1.0}, "finger_spacing must be 0 or more"),
        (known, {"busy_heights": (0.02, math.nan)}, "busy_heights must be finite"),
        (known, {"slices": (slice_with(), SHORT)}, r"azimuths, got \[8, 16\]"),
        (slice_with, {"height": math.nan}, "height must be finite"),
        (slice_with, {"deviation": -1.0}, "deviation must be 0 or more"),
        (slice_with, {"touches": -1}, "touches must be 0 or more and finite, got -1 touches"),
        (slice_with, {"seconds": math.nan}, "seconds must be 0 or more"),
        (slice_with, {"radii": np.full(16, -0.01)}, "radii must be at least 4 positive lengths"),
        (slice_with, {"radii": np.full(16, math.nan)}, "radii must be finite"),
        (slice_with, {name: np.full(3, 0.02) for name in CONTOUR}, "4 positive .* got 3"),
        (slice_with, {"slopes": np.zeros(3)}, r"slopes must have shape \(16\)"),
        (Budget, {"most_touches": 0}, "most_touches must be positive, got 0 touches"),
        (Budget, {"most_seconds": 0.0}, "most_seconds must be positive, got 0.0 s"),
        (Budget, {"touches": -1}, "touches must be 0 or more"),
        (Budget, {"seconds": math.inf}, "seconds must be 0 or more and finite"),
    ],
)
def test_invalid_observation_is_refused(make, changes, words):
    with pytest.raises(ValueError, match=words):
        make(**changes)


def test_spent_budget_ends_every_plan_with_its_figures():
    for budget, words in (
        (Budget(), None),
        (Budget(most_touches=40, touches=39, most_seconds=40.0, seconds=38.0), None),
        (Budget(most_touches=50, touches=50, most_seconds=60.0), "50 of 50 touches and 0 of 60 s"),
        (Budget(most_seconds=40.0, seconds=40.0), "40 of 40 s"),
        (Budget(most_seconds=100.0, seconds=90.0, cut=True), "90 of 100 s"),
    ):
        observation = known([slice_of(CYLINDER, 0.5)], budget=budget)
        reason = words and f"the budget is spent: {words} of robot time"
        assert planners.exhausted_budget(observation) == reason
        choices = [make_planner(name, {}).next(observation) for name in planners.PLANNER_NAMES]
        assert all((one == Stop(str(reason))) == (words is not None) for one in choices)


@pytest.mark.parametrize(("tolerance", "inside"), [(1e-2, 0.03), (1.25e-3, 0.025), (2e-4, 0.02)])
def test_first_and_last_slice_lie_nearer_ends_for_less_error(tolerance, inside):
    low, high = planners.first_and_last(known(tolerance=tolerance * 0.09))
    assert (low, high) == pytest.approx((inside * 0.09, (1.0 - inside) * 0.09))
    loose = known(tolerance=tolerance * 0.09, low_deviation=4e-3, high_deviation=5e-3)
    assert planners.first_and_last(loose) == pytest.approx((8e-3, 0.08))
    assert planners.first_and_last(known(low_deviation=1.0, high_deviation=1.0)) == (0.045, 0.045)


BUSY = {"busy_heights": (0.03,), "finger_spacing": 0.02}


@pytest.mark.parametrize(
    ("choice", "more", "words"),
    [
        (None, {}, "must answer with a Height, a Touch, a Wait or a Stop, got None"),
        (0.045, {}, "must answer with a Height, a Touch, a Wait or a Stop, got 0.045"),
        (Height(math.nan, ""), {}, "must lie between 0 and 0.09 m, got nan m"),
        (Height(0.09, ""), {}, "must lie between 0 and 0.09 m, got 0.09 m"),
        (Height(-1.0, ""), {}, "must lie between 0 and 0.09 m, got -1 m"),
        (Height(0.02, ""), {"busy_heights": (0.02,)}, "a slice at 0.02 m was requested before"),
        (Height(0.045, ""), {"slices": (failed(0.045),)}, "before; it must go elsewhere, or stop"),
        (Height(0.02, ""), BUSY, "0.02 m is nearer than 0.02 m to a finger at 0.03 m"),
        (Wait(""), {}, "it waits, but no finger is at work"),
    ],
)
def test_invalid_answer_is_refused(choice, more, words):
    with pytest.raises(planners.WrongChoiceError) as caught:
        planners.check_choice(Says(choice), known(**more))
    assert str(caught.value).startswith("the planner Says gave an invalid answer: ")
    assert words in str(caught.value)


def test_settled_height_is_valid_slice_or_none(monkeypatch):
    spent = {"budget": Budget(most_touches=9, touches=9)}
    good, busy = Height(0.01, ""), {"busy_heights": (0.01,)}
    assert planners.settled_height(Says(good), known()) is None  # it has no such method
    monkeypatch.setattr(Says, "settled", Says.next, raising=False)
    assert planners.settled_height(Says(good), known()) is good
    cases = (None, {}), (Stop("end"), {}), (Height(0.2, ""), {}), (good, busy), (good, spent)
    assert all(planners.settled_height(Says(one), known(**more)) is None for one, more in cases)


@pytest.mark.usefixtures("own")
def test_planners_are_made_and_valid_answers_returned():
    assert planners.planner_type(planners.PLANNER_NAMES[0]) is planners.Predicted
    for name in planners.PLANNER_NAMES:
        planner = make_planner(name, {})
        assert planner == planners.planner_type(name)()
        assert planners.check_choice(planner, known()) == planner.next(known())
    for planner in (planners.Predicted(), planners.Uniform(count=4)):
        assert planners.settled_height(planner, known()) == planner.next(known())
    assert make_planner("uniform", {"count": 5}) == planners.Uniform(count=5)
    busy = known(busy_heights=(0.01,), finger_spacing=0.02)
    for choice in (Height(np.float64(0.03), "up"), Wait("busy"), Stop("end")):
        assert planners.check_choice(Says(choice), busy) is choice
    own = make_planner("own_planner:Middle", {"share": 0.3})
    assert planners.check_choice(own, known()).height == pytest.approx(0.027)


OWN = """
from dataclasses import dataclass
from palpate.planning import Height, Stop

@dataclass(frozen=True, kw_only=True)
class Middle:
    share: float = 0.5
    def next(self, known):
        return Stop("enough") if known.slices else Height(known.low + self.share * known.extent, "")

@dataclass
class Loose:
    def next(self, known): ...

@dataclass(frozen=True)
class Breaks:
    def __post_init__(self):
        raise KeyError("own mistake")
    def next(self, known): ...
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "own_planner.py").write_text(OWN)
    (tmp_path / "broken_planner.py").write_text("1 / 0")
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.usefixtures("own")
@pytest.mark.parametrize(
    ("name", "settings", "words"),
    [
        ("own_planner:Loose", {}, "must be a frozen dataclass with next"),
        ("own_planner:Breaks", {}, "cannot be made: .*own mistake"),
        ("no_such_planner:Any", {}, "cannot be imported: ModuleNotFoundError"),
        ("broken_planner:Any", {}, "cannot be imported: ZeroDivisionError"),
        (".own_planner:Middle", {}, "must name its module in full"),
        ("best", {}, "no planner 'best'; there are predicted, touches, uniform"),
        ("uniform", {"speed": 1}, "'uniform' has no speed; it has count, order"),
        ("uniform", {"count": 0}, "count is 0; expected 1 to 1000"),
        ("uniform", {"order": "random"}, "order must be sweep or nested, got 'random'"),
        ("predicted", {"cover": 4}, "cover must be odd, so that the middle is in it, got 4"),
        ("predicted", {"hidden_error": 2.0}, "hidden_error is 2"),
        ("touches", {"least_gain": -1.0}, "least_gain is -1"),
        ("touches", {"settings": {}}, "'touches' has no settings; it has least_gain"),
        ("thesis", {"most": [0.1]}, r"most is \[0.1\]; expected a number"),
        ("thesis", {"template": ["exponential"]}, "the planner 'thesis' cannot be made: unhash"),
        ("thesis", {"template": "parabola"}, "template must be one of .*'parabola'"),
        ("thesis", {"form": "sum"}, "form must be product or joint, got 'sum'"),
        ("thesis", {"least": 0.3, "most": 0.2}, "most must be at least least, 0.3, got 0.2"),
        ("fuzzy", {"scale": 0.0}, r"scale is 0; expected 0\.1 to 2"),
    ],
)
def test_invalid_planner_is_refused(name, settings, words):
    with pytest.raises((ValueError, LookupError), match=words):
        make_planner(name, settings)


ASKED = planners.Limits(tolerance=1e-4, feature=2e-3, underside_share=0.01)
GOOD = dict(error_bound=1e-4, underside_share=0.005, crease_error=1e-3)
GOOD |= dict(crease_share=0.005, unknown_share=0.01, untouched_gap=2e-3, unentered_hole=0.0)
GOOD |= dict(untraced_height=0.0, closed=True, self_crossings=0, genus=1, true_genus=1)
GOOD |= dict(true_error=1e-4)
WORSE = {"error_bound": (1.1e-4, None), "underside_share": (0.0101,), "crease_error": (1.5e-3,)}
WORSE |= {"unknown_share": (0.011,), "untouched_gap": (2.1e-3,), "unentered_hole": (1e-3,)}
WORSE |= {"untraced_height": (1e-3,), "closed": (False,), "self_crossings": (1,), "genus": (0, 2)}
WORSE |= {"true_error": (2e-4,)}
NAMES = {"underside_share": "underside", "closed": "open surface", "true_error": "rms error"}
ALWAYS = {"untraced_height", "closed", "self_crossings", "genus"}  # whatever is asked


@pytest.mark.parametrize("name", WORSE)
def test_verdict_names_limit_that_is_not_kept(name):
    assert planners.judge(planners.Findings(**GOOD), ASKED).reached is True
    for value in WORSE[name]:
        findings = planners.Findings(**(GOOD | {name: value}))
        [failed] = planners.judge(findings, ASKED).failed
        assert failed.name.replace("-", " ") == NAMES.get(name, name.replace("_", " "))
        assert planners.judge(findings, planners.Limits()).reached == (name not in ALWAYS)
        stated = {k: v for k, v in (GOOD | {name: value}).items() if v is not None}
        assert findings.stated() == stated
    assert planners.judge(planners.Findings(), planners.Limits()).reached is None
    asked = {"tolerance": 1e-4, "feature": 2e-3, "unknown_share": 0.01, "underside_share": 0.01}
    assert ASKED.stated() == asked
    flat = planners.Limits(tolerance=1e-4)  # what stands on the platform is taken for flat
    assert planners.judge(planners.Findings(error_bound=1e-4, underside_share=0.5), flat).reached
