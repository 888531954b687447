"""Plans: the same in any unit, they end, and each planner goes where its rule says."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.explore import planners
from palpate.core.explore.planners import Fuzzy, Height, Predicted, Stop, Thesis, Uniform, Wait
from tests.core.explore.planners import sides
from tests.core.explore.planners.sides import CYLINDER, HEIGHT, SIDES, explore, known, slice_of

COVER = (0.5, 0.97, 0.03)


def share_of(planner: planners.Planner, observation: planners.Observation) -> float:
    choice = planner.next(observation)
    assert isinstance(choice, Height), choice
    return choice.height / HEIGHT


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("planner", [Predicted(), Thesis(), Fuzzy(), Uniform()])
def test_plan_is_same_in_any_unit_and_place_and_covers_side(planner, side):
    shares, stop, estimate = explore(planner, SIDES[side])
    other, reason, scaled = explore(planner, SIDES[side], unit=1000.0, base=400.0)
    assert other == pytest.approx(shares, abs=1e-8)  # of numerical slopes
    assert reason.reason == stop.reason
    assert scaled.rms_bound_95 == pytest.approx(1000.0 * estimate.rms_bound_95)
    assert scaled.largest_untouched == pytest.approx(1000.0 * estimate.largest_untouched, abs=1e-9)
    assert (min(shares), max(shares)) == pytest.approx((0.03, 0.97))


def nonsense(rng: np.random.Generator, height: float, trouble: float) -> planners.ObservedSlice:
    """A slice, or none, whose figures have nothing to do with any object or each other."""
    if rng.random() < trouble:
        return sides.failed(height, planners.SliceOutcome(rng.choice(["failed", "lost"])))
    radii, spread = 0.02 * np.exp(rng.normal(size=16)), rng.standard_cauchy(size=(2, 16))
    wild = {"radii": radii, "slopes": spread[0], "curvatures": 1e3 * spread[1]}
    deviation = float(rng.choice([0.0, 1e-4]))
    return slice_of(CYLINDER, height / HEIGHT, height=height, deviation=deviation, **wild)


@pytest.mark.parametrize("name", planners.PLANNER_NAMES)
@settings(derandomize=True, deadline=None, max_examples=7)
@given(
    seed=st.integers(0, 10**6),
    trouble=st.sampled_from([0.0, 0.3, 0.8, 1.0]),
    fingers=st.integers(1, 3),
    all_taxels=st.booleans(),
)
def test_plan_ends_whatever_it_is_told(name, seed, trouble, fingers, all_taxels):
    rng, planner = np.random.default_rng(seed), planners.make_planner(name, {})
    spacing = float(rng.choice([0.0, 0.01, 0.03, 0.2])) if fingers > 1 else 0.0
    slices, busy, ends = list[planners.ObservedSlice](), list[float](), {}
    for _ in range(200):
        while len(busy) < fingers:
            more = {"busy_heights": tuple(busy), "finger_spacing": spacing, **ends}
            now = known(slices, all_taxels=all_taxels, **more)
            choice = planner.next(now)
            if not isinstance(choice, Height):
                break
            # A height is inside, was not asked for before, and is away from other fingers.
            asked = np.array([*(one.height for one in slices), *busy])
            assert now.low < choice.height < now.high
            assert (np.abs(asked - choice.height) > 1e-9 * now.extent).all()
            assert all(abs(choice.height - one) >= spacing * (1.0 - 1e-9) for one in busy)
            busy.append(choice.height)
        if not busy:
            break
        slices.append(nonsense(rng, busy.pop(int(rng.integers(len(busy)))), trouble))
        if rng.random() < 0.2:
            low, high = np.sort(rng.uniform(-0.02, 0.11, 2))
            deviations = rng.choice([0.0, 1e-3, 0.02, 1.0], 2)
            names = "low", "high", "low_deviation", "high_deviation"
            ends = dict(zip(names, (low, max(high, low + 5e-3), *deviations), strict=True))
    assert isinstance(choice, Stop)


@pytest.mark.parametrize("field", ["slopes", "curvatures", "radii"])
def test_enormous_figures_leave_finite_bound_and_plan(field):
    for values in (np.full(16, 1e150), np.full(16, 1e-300), np.linspace(-1e150, 1e150, 16)):
        size = np.abs(values) if field == "radii" else values
        odd = known(sides.slices_of(SIDES["vase"], COVER, **{field: size}))
        assert np.isfinite(planners.estimate_error(odd).rms_bound_95)
        for choice in (
            planners.make_planner(name, {}).next(odd) for name in planners.PLANNER_NAMES
        ):
            assert not isinstance(choice, Height) or 0.0 < choice.height < HEIGHT
    many = known(sides.slices_of(CYLINDER, np.linspace(0.03, 0.97, 300)))
    assert all(
        isinstance(planners.make_planner(name, {}).next(many), Stop)
        for name in planners.PLANNER_NAMES
    )


@pytest.mark.parametrize("count", [1, 2, 3, 9, 10, 41])
@pytest.mark.parametrize("order", ["sweep", "nested"])
def test_uniform_heights_are_even_in_any_order(count, order):
    shares, stop, _ = explore(Uniform(count=count, order=order), SIDES["vase"])
    assert sorted(shares) == pytest.approx([0.5] if count == 1 else np.linspace(0.03, 0.97, count))
    assert stop.reason == f"all {count} heights have been visited"
    middle = count // 2
    if order == "sweep":  # up from the middle, and then down from below it
        assert (np.diff(shares[: count - middle]) > 0.0).all()
        assert (np.diff(shares[count - middle :]) < 0.0).all()
    for begun in (3, 5, 9) if (order, count) == ("nested", 9) else ():
        assert np.ptp(np.diff(np.sort(shares[:begun]))) < 1e-9  # every beginning is even


def test_uniform_retries_failed_height_once_and_keeps_away_from_fingers():
    shares, slices = [], []
    while isinstance(choice := Uniform(count=3).next(known(slices)), Height):
        shares.append(choice.height / HEIGHT)
        slices.append(sides.failed(choice.height))
    assert shares == pytest.approx([0.5, 0.3825, 0.97, 0.8525, 0.03, 0.1475])
    busy = {"busy_heights": (0.045,)}
    assert share_of(Uniform(count=3), known(**busy, finger_spacing=0.02)) == pytest.approx(0.97)
    assert isinstance(Uniform(count=3).next(known(**busy, finger_spacing=0.05)), Wait)
    ends = {"low_deviation": 1.0, "high_deviation": 1.0}  # all heights are one
    for planner in (Uniform(), Uniform(order="nested")):
        assert share_of(planner, known(**ends)) == 0.5
        assert isinstance(planner.next(known([sides.failed(0.045)], **ends)), Stop)


RULES = [
    Thesis(template=t, form=f, power=2.0) for t in planners.TEMPLATES for f in ("product", "joint")
]
curves, more = st.floats(0.0, 20.0), st.floats(0.05, 5.0)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(rule=st.sampled_from(RULES), bend=curves, change=curves, beyond=more)
def test_five_heuristics_of_step(rule, bend, change, beyond):
    step = rule.later(bend, change, 1)
    assert rule.later(bend + beyond, change + beyond, 1) < step
    assert rule.later(bend, change + beyond, 1) < step
    assert rule.later(bend + beyond, change, 1) < step
    # The change counts for more than the curvature.
    assert rule.later(bend, bend + beyond, 1) < rule.later(bend + beyond, bend, 1)
    fading = Thesis(template=rule.template, form=rule.form, power=2.0, fading=0.9)
    assert fading.later(bend, change, 2) < fading.later(bend, change, 1)
    assert rule.later(bend, change, 2) == step
    for far in (1.0, 1e11):
        assert rule.least <= rule.later(bend * far, change * far, 1) <= rule.most
        assert rule.least <= rule.first(bend * far) <= 0.5


@settings(derandomize=True, deadline=None, max_examples=40)
@given(bend=curves, change=curves, beyond=more, tolerance=st.floats(3e-4, 5e-3))
def test_learned_steps_are_longer_where_flatter_and_where_less_is_asked(
    bend, change, beyond, tolerance
):
    def step(bend, tolerance):
        return planners.LearnedSteps(tolerance, 1.0).later(bend, change, 1)

    assert step(bend + beyond, tolerance) < step(bend, tolerance) < step(bend, 2.0 * tolerance)
    assert step(1e9 * beyond, tolerance) >= planners.TRAINED.min_step
    assert step(0.0, tolerance) <= planners.TRAINED.max_step
    half, whole = (planners.LearnedSteps(tolerance, scale).first(bend) for scale in (0.5, 1.0))
    assert half == 0.5 * whole


def test_thesis_steps_are_those_of_formulas():
    rule = Thesis(bend_rate=0.2, change_rate=0.4, least=0.03, most=0.23, caution=1.0)
    assert rule.first(3.0) == pytest.approx(math.exp(-0.6) / 4.0)  # (3.1)
    shape = math.exp(-0.6) * math.exp(-0.8)
    assert rule.later(3.0, 2.0, 1) == pytest.approx(0.2 * shape + 0.03)  # (3.2), (3.28), (3.34)
    joint = Thesis(bend_rate=0.2, change_rate=0.4, form="joint", template="inverse_power")
    assert joint.later(3.0, 2.0, 1) == pytest.approx(0.02 + 0.18 / 2.4)
    logarithmic = Thesis(bend_rate=1.0, change_rate=1.0, form="joint", template="logarithmic")
    assert logarithmic.later(3.0, 3.0, 1) == pytest.approx(0.02 + 0.18 / 3.0)  # ln 2 / ln 8
    assert rule.later(0.0, 0.0, 1) == pytest.approx(rule.most)  # (3.34)
    assert rule.later(1e6, 1e6, 1) == pytest.approx(rule.least)  # (3.35)
    assert Thesis().first(1e9) == Thesis().least  # (3.1) alone would stay where it is


@pytest.mark.parametrize("rule", [*RULES[::3], Fuzzy(), Thesis(segments=5)])
def test_step_search_steps_by_curvature_and_its_change(rule):
    bends = [6.0, 2.0]
    slices = [slice_of(CYLINDER, 0.5, curvatures=np.full(16, bends[0] / HEIGHT))]
    first = share_of(rule, known(slices))
    assert first == pytest.approx(0.5 + rule.first(6.0))
    hollow = [slice_of(CYLINDER, 0.5, curvatures=np.full(16, -bends[0] / HEIGHT))]
    assert share_of(rule, known(hollow)) == first  # a hollow is stepped over like a bulge
    slices.append(slice_of(CYLINDER, first, curvatures=np.full(16, bends[1] / HEIGHT)))
    assert share_of(rule, known(slices)) == pytest.approx(first + rule.later(2.0, 4.0, 1))


def test_search_ends_at_lost_contact_short_contour_threshold_and_failure():
    shares, *_ = explore(Thesis(), CYLINDER, top=0.8)
    assert sum(share > 0.8 for share in shares) == 1 and min(shares) == pytest.approx(0.03)
    shares, *_ = explore(Thesis(perimeter=0.99, least=0.05), SIDES["ball"])
    assert max(shares) < 0.98
    assert all(2.0 * math.pi * SIDES["ball"](z) > 0.99 for z in sorted(shares)[1:-1])
    shares, *_ = explore(Thesis(threshold=0.1), SIDES["bottle"])
    assert max(shares) < 0.9 and min(shares) == pytest.approx(0.03)
    stop = Thesis().next(known([sides.failed(0.045)]))
    assert stop == Stop("the slice at half height, 0.045 m, could not be traced")


def test_search_turns_with_mean_normal_failures_and_fingers():
    for slope in (-0.2, 0.2):  # it goes first where the mean normal points
        cone = slice_of(lambda z: 0.3 + slope * (z - 0.5), 0.5)  # noqa: B023
        assert (share_of(Thesis(), known([cone])) > 0.5) == (slope < 0.0)
    start, steps = [slice_of(CYLINDER, 0.5)], []
    for busy, spacing in (((0.06, 0.03), 0.0), ((0.06,), 0.05)):
        waiting = known(start, busy_heights=busy, finger_spacing=spacing)
        assert isinstance(Thesis().next(waiting), Wait)
    assert share_of(Thesis(), known(start, busy_heights=(0.06,))) < 0.5
    assert isinstance(Thesis().next(known(busy_heights=(0.045,))), Wait)
    for _ in range(4):  # a failed step is halved, three times at most
        steps.append(share_of(Thesis(), known(start)) - 0.5)
        start.append(sides.failed(HEIGHT * (0.5 + steps[-1])))
    assert steps[1:3] == pytest.approx([steps[0] / 2, steps[0] / 4]) and steps[3] < 0.0
    for share, end in ((1.5, 1.0), (-0.5, 0.0)):  # a start beyond an end goes on from that end
        assert abs(share_of(Thesis(), known([slice_of(CYLINDER, share)])) - end) < 0.3


@pytest.mark.parametrize("template", planners.TEMPLATES)
def test_polyline_of_template_falls_and_converges(template):
    places = np.linspace(0.0, 10.0, 400)
    values = planners.TEMPLATES[template](places, 2.0)
    worst = []
    for segments in (5, 10, 20):
        line = planners.polyline_of(lambda x: planners.TEMPLATES[template](x, 2.0), 10.0, segments)
        assert len(line.knots) == segments + 1 and (np.diff(line.values) <= 1e-12).all()
        assert 0.0 <= line.at(1e9) <= line.at(0.0) <= 1.02
        worst.append(np.abs([line.at(place) for place in places] - values).max())
    assert worst[2] < 0.4 * worst[1] < 0.16 * worst[0]  # by the square of their number
    even = np.interp(places, places[::80], values[::80])  # even knots on the curve itself
    assert worst[0] < 0.5 * np.abs(even - values).max()


def test_nine_fuzzy_rules_and_what_lies_between():
    steps = [[Fuzzy().later(bend, change, 1) for change in (0.5, 2, 6)] for bend in (1, 4, 10)]
    assert np.array(steps) == pytest.approx(
        np.array([[0.25, 0.16, 0.10], [0.16, 0.10, 0.05], [0.10, 0.10, 0.05]])
    )
    assert Fuzzy().later(0.0, 0.0, 1) == pytest.approx(0.25)
    assert Fuzzy().later(2.5, 0.5, 1) == pytest.approx(0.5 * (0.25 + 0.16))
    assert Fuzzy(scale=0.5).later(3.0, 1.0, 1) == pytest.approx(0.5 * Fuzzy().later(3.0, 1.0, 1))
    grid = [[Fuzzy().later(b, c, 1) for c in np.linspace(0, 8, 30)] for b in np.linspace(0, 12, 30)]
    assert np.diff(grid, axis=1).max() < 0.02 and np.ptp(grid) == pytest.approx(0.2)


def test_cover_comes_first_from_middle_and_returns_to_failed_part_last():
    assert explore(Predicted(), SIDES["bottle"])[0][:3] == pytest.approx(COVER)
    five = explore(Predicted(cover=5), SIDES["bottle"])[0][:5]
    assert five == pytest.approx([0.5, 0.735, 0.265, 0.97, 0.03])
    slices = [slice_of(CYLINDER, 0.5), sides.failed(0.97 * HEIGHT)]
    assert share_of(Predicted(), known(slices)) == pytest.approx(0.03)
    assert share_of(Predicted(), known([*slices, slice_of(CYLINDER, 0.03)])) > 0.7


@pytest.mark.parametrize(("name", "most"), [("ball", 11), ("cylinder", 11), ("bottle", 20)])
def test_flat_tops_poles_and_necks_end_plan_with_all_reached(name, most):
    shares, stop, estimate = explore(Predicted(), SIDES[name])
    assert (estimate.reached, stop.reason) == (True, planners.ALL_REACHED)
    assert len(shares) <= most
    assert name != "bottle" or sum(0.62 < share < 0.82 for share in shares) >= 3
    assert 1e-5 <= estimate.rms_bound_95 <= 0.0025 * HEIGHT
    assert estimate.largest_untouched <= 2.5e-3
    beyond = [share for share in explore(Predicted(), CYLINDER, top=0.93)[0] if share > 0.93]
    assert len(set(beyond)) == len(beyond) <= 3


GROOVED = {"grooved": lambda z, t: 0.3 - 0.03 * np.exp(-(((z - 0.26) / 0.035) ** 2)) + 0.0 * t}


@pytest.mark.parametrize(("name", "side"), [*planners.TUNED.items(), *GROOVED.items()])
def test_bound_holds_on_every_reference_object(name, side):
    trial = planners.PlannerTrial(side)
    if name == "grooved":  # between two pads, where nothing predicts it
        cover = [trial.slice_at(share * HEIGHT) for share in COVER]
        assert planners.estimate_error(known(cover)).rms_bound_95 < 0.0025 * HEIGHT
        assert trial.rms(cover) > 0.003
    slices, stop = planners.run_planner(Predicted(), trial, 0.0025, most=12)
    assert stop is None or (stop.reason == planners.ALL_REACHED and trial.rms(slices) < 0.0025)
    bound = planners.estimate_error(known(slices)).rms_bound_95
    assert trial.rms(slices) * HEIGHT < 1.5 * bound  # it is one of 95 %


def test_noise_and_tolerance_out_of_reach_end_plan_with_their_reasons():
    slices: list[planners.ObservedSlice] = []
    while isinstance(choice := Predicted().next(known(slices)), Height):
        slices.append(slice_of(SIDES["vase"], choice.height / HEIGHT, deviation=1e-3))
    assert choice.reason.startswith("the noise of the slices is beyond the tolerance")
    assert not planners.estimate_error(known(slices)).reached and len(slices) <= 11
    zigzag = lambda z: 0.3 + 0.02 * math.asin(math.sin(60.0 * z))  # noqa: E731
    shares, stop, _ = explore(Predicted(), zigzag, tolerance=1e-5)
    assert stop.reason.startswith("the slices lie as close as they may")
    assert min(np.diff(sorted(shares))) >= 2.5e-3 / HEIGHT * (1.0 - 1e-6)


def test_unreachable_span_is_left_and_stated():
    slices: list[planners.ObservedSlice] = []
    while isinstance(choice := Predicted().next(known(slices)), Height):
        hidden = 0.6 < choice.height / HEIGHT < 0.9
        one = slice_of(CYLINDER, choice.height / HEIGHT)
        slices.append(sides.failed(choice.height) if hidden else one)
        assert len(slices) < 60
    assert choice.reason == "what is left untouched cannot be reached"
    assert planners.estimate_error(known(slices)).largest_untouched > 2.5e-3
    whole = sides.slices_of(CYLINDER, np.linspace(0.03, 0.97, 8))
    assert isinstance(Predicted().next(known(whole)), Stop)
    low = np.where(np.arange(16) < 6, 1.0, whole[4].contact_low)  # occluded on these azimuths
    whole[4] = replace(whole[4], outcome=planners.SliceOutcome.OCCLUDED, contact_low=low)
    choice = Predicted().next(known(whole))
    assert choice.reason == "nothing has touched what lies there"
    assert abs(choice.height - whole[4].height) < 0.1 * HEIGHT


def test_fingers_get_heights_of_their_own_and_wait_when_there_is_none():
    busy: list[float] = []
    while isinstance(
        choice := Predicted().next(known(busy_heights=tuple(busy), finger_spacing=0.02)), Height
    ):
        busy.append(choice.height)
    assert np.array(busy) / HEIGHT == pytest.approx(COVER)
    assert isinstance(choice, Wait)
    cover = sides.slices_of(SIDES["bottle"], COVER)
    first = Predicted().next(known(cover)).height
    other = Predicted().next(known(cover, busy_heights=(first,), finger_spacing=0.02)).height
    assert abs(other - first) >= 0.02
    even = known(sides.slices_of(CYLINDER, COVER), busy_heights=(0.02,), finger_spacing=0.02)
    choice = Predicted().next(replace(even, all_taxels=True))
    assert choice.reason == "nothing has touched what lies there" and choice.height >= 0.04
    both = known(cover, busy_heights=(first, other), finger_spacing=0.04)
    assert isinstance(Predicted().next(both), Wait)


def test_nearer_of_equal_heights_and_later_of_equal_slices_count():
    wavy = lambda z: 0.3 + 0.05 * math.cos(4.0 * math.pi * (z - 0.5))  # noqa: E731
    for last in (0.97, 0.03):
        order = known(sides.slices_of(wavy, (1.0 - last, 0.5, last)))
        assert (share_of(Predicted(), order) > 0.5) == (last > 0.5)
    middle = known([slice_of(CYLINDER, 0.5)], high_deviation=5e-3)  # the end may lie lower
    assert Predicted().next(middle).height == pytest.approx(0.09 - 0.01)
    low, here, high = sides.slices_of(SIDES["vase"], (0.03, 0.5, 0.97))
    again = slice_of(SIDES["vase"], 0.5 + 1e-12, radii=np.full(16, 0.02))
    sets = [low, here, high, again], [low, again, high], [low, here, high]
    bounds = [planners.estimate_error(known(one)).rms_bound_95 for one in sets]
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-6) != pytest.approx(bounds[2], rel=1e-2)
