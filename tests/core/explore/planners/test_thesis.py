import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import least_squares

from palpate.core.explore.planners.protocol import Budget, Height, Stop, Wait
from palpate.core.explore.planners.thesis import (
    TEMPLATES,
    Thesis,
    equal_curvature_knots,
    fit_decreasing,
    hat_basis,
    mean_normal_rise,
    mean_profile_curvature,
    polyline_of,
)

FORMS = ("product", "joint")
RULES = [
    Thesis(template=template, form=form, power=2.0)
    for template, form in itertools.product(TEMPLATES, FORMS)
]
rules = st.sampled_from(RULES)
curves = st.floats(0.0, 20.0)
more = st.floats(0.05, 5.0)
LAW = settings(derandomize=True, deadline=None, max_examples=50)


@LAW
@given(rule=rules, bend=curves, change=curves, beyond=more)
def test_heuristic_1_the_step_falls_with_curvature_and_with_its_change(rule, bend, change, beyond):
    step = rule.later(bend, change, 1)
    assert rule.later(bend + beyond, change + beyond, 1) < step


@LAW
@given(rule=rules, bend=curves, change=curves, beyond=more)
def test_heuristic_2_at_one_curvature_the_step_falls_with_its_change(rule, bend, change, beyond):
    assert rule.later(bend, change + beyond, 1) < rule.later(bend, change, 1)


@LAW
@given(rule=rules, bend=curves, change=curves, beyond=more)
def test_heuristic_3_at_one_change_step_falls_with_curvature(rule, bend, change, beyond):
    assert rule.later(bend + beyond, change, 1) < rule.later(bend, change, 1)


@LAW
@given(rule=rules, both=curves, beyond=more)
def test_heuristic_4_the_change_counts_for_more_than_the_curvature(rule, both, beyond):
    assert rule.later(both, both + beyond, 1) < rule.later(both + beyond, both, 1)


@LAW
@given(rule=rules, bend=curves, change=curves, count=st.integers(1, 20))
def test_heuristic_5_the_more_slices_shorter_step_if_it_fades(rule, bend, change, count):
    fading = Thesis(template=rule.template, form=rule.form, power=2.0, fading=0.9)
    assert fading.later(bend, change, count + 1) < fading.later(bend, change, count)
    assert rule.later(bend, change, count + 1) == rule.later(bend, change, count)


@LAW
@given(rule=rules, bend=st.floats(0.0, 1e12), change=st.floats(0.0, 1e12))
def test_every_step_is_more_than_nothing_and_at_most_the_largest(rule, bend, change):
    assert rule.least <= rule.later(bend, change, 1) <= rule.most
    assert 0.0 <= rule.first(bend) <= 0.5


def test_the_steps_are_those_of_the_formulas():
    rule = Thesis(bend_rate=0.2, change_rate=0.4, least=0.03, most=0.23, caution=1.0)
    assert rule.first(3.0) == pytest.approx(math.exp(-0.6) / 4.0)  # (3.1)
    shape = math.exp(-0.6) * math.exp(-0.8)
    assert rule.later(3.0, 2.0, 1) == pytest.approx(0.2 * shape + 0.03)  # (3.2), (3.28), (3.34)
    assert rule.later(0.0, 0.0, 1) == pytest.approx(rule.most)  # (3.34)
    assert rule.later(1e6, 1e6, 1) == pytest.approx(rule.least)  # (3.35)


@pytest.mark.parametrize("template", TEMPLATES)
def test_case_65_a_hollow_is_stepped_over_like_a_bulge(template, slice_of):
    def steps(sign):
        one = slice_of(lambda z: 0.3, 0.5, curvatures=np.full(16, sign * 55.0))
        bend = mean_profile_curvature(one, 0.09)
        return Thesis(template=template, power=0.1).later(bend, 0.0, 1)

    assert steps(-1.0) == steps(1.0)
    assert 0.0 < steps(-1.0) <= 0.2


@pytest.mark.parametrize("name", ["vase", "bottle", "ball", "cylinder"])
def test_case_64_the_plan_in_millimetres_is_the_plan_in_metres(name, sides, explored):
    metres, _ = explored(Thesis(), sides[name])
    millimetres, _ = explored(Thesis(), sides[name], 1000.0)
    np.testing.assert_allclose(millimetres, metres, rtol=1e-9)


@pytest.mark.parametrize("rule", RULES)
def test_case_67_the_search_ends_at_flat_tops_and_at_poles(rule, sides, explored):
    for name in ("cylinder", "ball"):
        heights, stop = explored(rule, sides[name])
        assert stop is not None
        assert min(heights) == pytest.approx(0.03)
        assert max(heights) == pytest.approx(0.97)


def test_case_67_losing_contact_ends_the_search_in_that_direction(sides, explored):
    heights, stop = explored(Thesis(), sides["cylinder"], top=0.8)
    assert stop is not None
    assert sum(height > 0.8 for height in heights) == 1
    assert min(heights) == pytest.approx(0.03)


def test_case_67_a_short_contour_ends_the_search_near_a_pole(sides, explored):
    heights, stop = explored(Thesis(perimeter=0.99, least=0.05), sides["ball"])
    assert stop is not None
    assert max(heights) < 0.98
    assert all(2.0 * math.pi * sides["ball"](z) > 0.99 for z in sorted(heights)[1:-1])


def test_a_step_upwards_below_the_threshold_ends_the_search_there(sides, explored):
    heights, stop = explored(Thesis(threshold=0.1), sides["bottle"])
    assert stop is not None
    assert max(heights) < 0.9
    assert min(heights) == pytest.approx(0.03)


@pytest.mark.parametrize("segments", [5, 12])
def test_the_piecewise_linear_form_plans_nearly_alike(segments, sides, explored):
    exact, linear = Thesis(), Thesis(segments=segments)
    steps = [
        (exact.later(bend, change, 1), linear.later(bend, change, 1))
        for bend, change in itertools.product((0.0, 1.0, 4.0, 20.0), repeat=2)
    ]
    assert max(abs(one - other) for one, other in steps) < 0.2 * 1.5 / segments**2
    _, stop = explored(linear, sides["vase"])
    assert stop is not None


def test_the_search_goes_first_where_the_mean_normal_points(slice_of, observation):
    cone = [slice_of(lambda z: 0.4 - 0.2 * z, 0.5)]
    funnel = [slice_of(lambda z: 0.2 + 0.2 * z, 0.5)]
    assert mean_normal_rise(cone[0]) == pytest.approx(0.2 / math.hypot(1.0, 0.2))
    up, down = (Thesis().next(observation(slices)) for slices in (cone, funnel))
    assert isinstance(up, Height)
    assert isinstance(down, Height)
    assert up.height > 0.045 > down.height


def test_a_slice_that_fails_is_tried_again_nearer_and_three_times_at_most(
    slice_of, failed, observation
):
    slices, steps = [slice_of(lambda z: 0.3, 0.5)], []
    for _ in range(4):
        choice = Thesis().next(observation(slices))
        assert isinstance(choice, Height)
        steps.append(choice.height - 0.045)
        slices.append(failed(choice.height))
    assert steps[1] == pytest.approx(steps[0] / 2)
    assert steps[2] == pytest.approx(steps[0] / 4)
    assert steps[3] < 0.0 < steps[2]


def test_the_other_direction_is_searched_while_one_is_under_way(slice_of, observation):
    start = [slice_of(lambda z: 0.3, 0.5)]
    below = Thesis().next(observation(start, busy_heights=(0.06,)))
    assert isinstance(below, Height)
    assert below.height < 0.045
    assert isinstance(Thesis().next(observation(start, busy_heights=(0.06, 0.03))), Wait)
    assert isinstance(
        Thesis().next(observation(start, busy_heights=(0.06,), finger_spacing=0.05)), Wait
    )
    assert isinstance(Thesis().next(observation(busy_heights=(0.045,))), Wait)


def test_without_a_first_slice_or_budget_there_is_no_search(slice_of, failed, observation):
    stop = Thesis().next(observation([failed(0.045)]))
    assert isinstance(stop, Stop)
    assert "half height" in stop.reason
    budget = Budget(most_touches=40, touches=40)
    stop = Thesis().next(observation([slice_of(lambda z: 0.3, 0.5, touches=40)], budget=budget))
    assert isinstance(stop, Stop)
    assert "40 of 40 touches" in stop.reason


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"template": "parabola"}, "template must be one of .*'parabola'"),
        ({"form": "sum"}, "form must be product or joint, got 'sum'"),
        ({"least": 0.3, "most": 0.2}, "most must be at least least, 0.3, got 0.2"),
        ({"most": 0.6}, "most is 0.6; expected 0.001 to 0.5"),
        ({"power": math.nan}, "power is nan"),
    ],
)
def test_rules_that_cannot_be_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        Thesis(**settings)


def test_the_first_step_is_no_smaller_than_the_others_may_be():
    assert Thesis().first(1e9) == Thesis().least  # (3.1) alone would stay where it is


PLACES = np.linspace(0.0, 10.0, 200)


def worst(values, knots):
    line = fit_decreasing(PLACES, values, knots)
    return float(np.abs(np.interp(PLACES, line.knots, line.values) - values).max())


def test_case_68_knots_that_coincide_leave_the_fit_well_conditioned():
    even = np.linspace(0.0, 10.0, 6)
    near = even.copy()
    near[2] = near[1] + 1e-6
    assert np.linalg.cond(np.abs(PLACES[:, None] - near)) > 1e6  # the basis of (3.29)
    for knots in (even, near):
        assert np.linalg.cond(hat_basis(PLACES, knots)) < 3.0


def test_hats_span_what_the_thesis_writes_with_absolute_values():
    knots = np.array([0.0, 1.0, 2.5, 7.0, 10.0])
    theirs = np.abs(PLACES[:, None] - knots) @ np.array([0.3, -1.0, 0.2, 0.7, 0.1])
    at_knots = np.abs(knots[:, None] - knots) @ np.array([0.3, -1.0, 0.2, 0.7, 0.1])
    np.testing.assert_allclose(hat_basis(PLACES, knots) @ at_knots, theirs, atol=1e-13)


@pytest.mark.parametrize("template", TEMPLATES)
def test_knots_of_even_curve_beat_even_knots(template):
    values = TEMPLATES[template](PLACES, 2.0)
    even = worst(values, np.linspace(0.0, 10.0, 6))
    assert worst(values, equal_curvature_knots(PLACES, values, 5)) < 0.4 * even


@pytest.mark.parametrize("template", TEMPLATES)
def test_knots_of_even_curve_are_hardly_worse_than_the_best(template):
    values = TEMPLATES[template](PLACES, 2.0)
    even = np.log(np.diff(equal_curvature_knots(PLACES, values, 5)))

    def residuals(logits):
        gaps = np.exp(logits - logits.max())
        ends = np.concatenate([[0.0], np.cumsum(gaps / gaps.sum())])
        line = fit_decreasing(PLACES, values, 10.0 * ends / ends[-1])
        return np.interp(PLACES, line.knots, line.values) - values

    best = np.linalg.norm(least_squares(residuals, even, max_nfev=60).fun)
    assert best <= np.linalg.norm(residuals(even)) <= 2.0 * best


@settings(derandomize=True, deadline=None, max_examples=20)
@given(
    power=st.floats(0.2, 5.0),
    segments=st.integers(1, 12),
    template=st.sampled_from(sorted(TEMPLATES)),
)
def test_a_polyline_of_template_falls_and_stays_between_0_and_1(power, segments, template):
    line = polyline_of(lambda x: TEMPLATES[template](x, power), 40.0, segments)
    assert (np.diff(line.values) <= 1e-12).all()
    assert 0.0 <= line.at(1e9) <= line.at(0.0) <= 1.02
