"""What is known may be odd: ends that move, fingers in the way, slices that make no sense."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from palpate.core.explore.planners.coverage import error_indicators, hermite, profile_of
from palpate.core.explore.planners.predicted import Predicted
from palpate.core.explore.planners.protocol import (
    PLANNER_NAMES,
    SAME,
    Choice,
    Height,
    ObservedSlice,
    SliceOutcome,
    Stop,
    Wait,
    make_planner,
)
from palpate.core.explore.planners.uniform import Uniform

MOST = 300  # Decisions after which a plan counts as endless


def answer(rng, height, trouble, make):
    """A slice, or none, that has nothing to do with any object."""
    fields = {"height": height}
    if rng.random() < trouble:
        fields["outcome"] = rng.choice([SliceOutcome.FAILED, SliceOutcome.LOST])
        names = ("radii", "slopes", "curvatures", "contact_low", "contact_high")
        return make(lambda z: 0.3, 0.5, **fields, **{name: np.zeros(0) for name in names})
    return make(
        lambda z: 0.3,
        height / 0.09,
        **fields,
        radii=0.02 * np.exp(rng.normal(size=16)),
        slopes=rng.standard_cauchy(size=16),
        curvatures=1e3 * rng.standard_cauchy(size=16),
    )


def moved_ends(rng):
    """Ends of an object as better touches may show them."""
    low, high = np.sort(rng.uniform(-0.02, 0.11, 2))
    low_deviation, high_deviation = rng.choice([0.0, 1e-3, 0.02, 1.0], 2)
    return {
        "low": low,
        "high": max(high, low + 5e-3),
        "low_deviation": low_deviation,
        "high_deviation": high_deviation,
    }


@pytest.mark.parametrize("name", PLANNER_NAMES)
@settings(
    derandomize=True,
    deadline=None,
    max_examples=20,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    seed=st.integers(0, 10**6),
    trouble=st.sampled_from([0.0, 0.3, 0.8, 1.0]),
    fingers=st.integers(1, 3),
    all_taxels=st.booleans(),
)
def test_a_plan_ends_though_its_ends_move_and_fingers_are_in_its_way(
    name, seed, trouble, fingers, all_taxels, slice_of, observation
):
    rng, planner = np.random.default_rng(seed), make_planner(name, {})
    finger_spacing = float(rng.choice([0.0, 0.01, 0.03, 0.2])) if fingers > 1 else 0.0
    slices, busy, ends = list[ObservedSlice](), list[float](), moved_ends(rng)
    for _ in range(MOST):
        choice: Choice | None = None
        while len(busy) < fingers:
            now = observation(
                slices,
                busy_heights=tuple(busy),
                finger_spacing=finger_spacing,
                all_taxels=all_taxels,
                **ends,
            )
            choice = planner.next(now)
            if not isinstance(choice, Height):
                break
            check(choice.height, now)
            busy.append(choice.height)
        if not busy:
            break
        height = busy.pop(int(rng.integers(len(busy))))
        slices.append(answer(rng, height, trouble, slice_of))
        if rng.random() < 0.2:
            ends = moved_ends(rng)
    assert isinstance(choice, Stop)


def check(height, now):
    """A height is inside, has not been asked for, and is away from other fingers."""
    assert now.low < height < now.high
    others = [*(one.height for one in now.slices), *now.busy_heights]
    assert all(abs(height - other) > SAME * now.extent for other in others)
    assert all(
        abs(height - other) >= now.finger_spacing * (1.0 - SAME) for other in now.busy_heights
    )


@pytest.mark.parametrize("name", ["thesis", "fuzzy"])
@pytest.mark.parametrize(("share", "end"), [(1.5, 1.0), (-0.5, 0.0)])
def test_a_walk_that_began_beyond_an_end_goes_on_from_that_end(
    name, share, end, sides, slice_of, observation
):
    choice = make_planner(name, {}).next(observation([slice_of(sides["cylinder"], share)]))
    assert isinstance(choice, Height)
    assert 0.0 < choice.height < 0.09
    assert abs(choice.height / 0.09 - end) < 0.3


def test_of_two_slices_at_one_height_the_later_counts(sides, slice_of, observation):
    cover = [slice_of(sides["vase"], share) for share in (0.03, 0.5, 0.97)]
    again = slice_of(sides["vase"], 0.5 + 1e-12, radii=np.full(16, 0.02))
    profile = profile_of(observation([*cover, again]))
    np.testing.assert_allclose(profile.heights, [0.03, 0.5, 0.97])
    np.testing.assert_allclose(profile.radii[1], 0.02 / 0.09)
    assert not isinstance(Predicted().next(observation([*cover, again, *cover])), Wait)


@pytest.mark.parametrize(
    "changes",
    [
        {"slopes": np.full(16, 1e150)},
        {"curvatures": np.full(16, -1e300)},
        {"radii": np.full(16, 1e-300)},
        {"radii": np.full(16, 1e200)},
        {"slopes": np.linspace(-1e150, 1e150, 16), "curvatures": np.full(16, 1e150)},
    ],
)
def test_figures_beyond_all_measure_leave_no_infinity(changes, sides, slice_of, observation):
    odd = observation([slice_of(sides["vase"], share, **changes) for share in (0.03, 0.5, 0.97)])
    profile = profile_of(odd)
    assert all(np.isfinite(signs).all() for signs in error_indicators(profile))
    assert np.isfinite(hermite(profile, np.linspace(0.03, 0.97, 7))).all()
    for name in PLANNER_NAMES:
        choice = make_planner(name, {}).next(odd)
        assert not isinstance(choice, Height) or 0.0 < choice.height < 0.09


@pytest.mark.parametrize("planner", [Uniform(), Uniform(order="nested")])
def test_ends_so_uncertain_that_all_heights_are_one_ask_for_it_once(planner, failed, observation):
    ends = {"low_deviation": 1.0, "high_deviation": 1.0}
    first = planner.next(observation(**ends))
    assert isinstance(first, Height)
    assert isinstance(planner.next(observation([failed(first.height)], **ends)), Stop)


@pytest.mark.parametrize("name", PLANNER_NAMES)
def test_a_thousand_slices_end_every_plan(name, sides, slice_of, observation):
    many = observation(
        [slice_of(sides["cylinder"], share) for share in np.linspace(0.03, 0.97, 1000)]
    )
    assert isinstance(make_planner(name, {}).next(many), Stop)


def test_a_feature_too_small_to_be_counted_is_refused(observation):
    with pytest.raises(ValueError, match=r"at least 0.0001 of the height 0.09 m, got 1e-07 m"):
        observation(feature=1e-7)


def test_a_height_of_another_finger_that_is_no_number_is_refused(observation):
    with pytest.raises(ValueError, match="busy_heights must be finite"):
        observation(busy_heights=(0.02, np.nan))


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("uniform", {"count": 2.5}, r"count is 2.5; expected a whole number, 1 to 1000"),
        ("uniform", {"count": "5"}, "count is '5'; expected a whole number"),
        ("predicted", {"cover": "many"}, "cover is 'many'; expected a whole number"),
        ("thesis", {"most": [0.1]}, r"most is \[0.1\]; expected a number"),
        ("thesis", {"template": ["exponential"]}, "the planner 'thesis' cannot be made: unhash"),
        ("fuzzy", {"scale": None}, "scale is None; expected a number, 0.1 to 2"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_refused(name, given, words):
    with pytest.raises(ValueError, match=words):
        make_planner(name, given)


@pytest.mark.parametrize("name", PLANNER_NAMES)
@settings(
    derandomize=True,
    deadline=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(seed=st.integers(0, 10**6), trouble=st.sampled_from([0.0, 0.2, 0.6, 1.0]))
def test_plan_ends_and_asks_for_no_height_twice(name, seed, trouble, slice_of, observation):
    rng = np.random.default_rng(seed)
    planner, slices = make_planner(name, {}), list[ObservedSlice]()
    while isinstance(choice := planner.next(observation(slices)), Height):
        assert 0.0 < choice.height < 0.09
        assert choice.height not in [one.height for one in slices]
        slices.append(nonsense(rng, choice.height, trouble, slice_of))
        assert len(slices) <= 120
    assert isinstance(choice, Stop)


def nonsense(rng, height, trouble, slice_of):
    """Nonsense: radii, slopes and curvatures that have nothing to do with each other."""
    if rng.random() < trouble:
        none = np.zeros(0)
        fields = {"outcome": rng.choice([SliceOutcome.FAILED, SliceOutcome.LOST])}
        for field in ("radii", "slopes", "curvatures", "contact_low", "contact_high"):
            fields[field] = none
        return slice_of(lambda z: 0.3, height / 0.09, **fields | {"height": height})
    return slice_of(
        lambda z: 0.3,
        height / 0.09,
        height=height,
        radii=0.02 * np.exp(rng.normal(size=16)),
        slopes=rng.standard_cauchy(size=16),
        curvatures=1e3 * rng.standard_cauchy(size=16),
        deviation=float(rng.choice([0.0, 1e-4])),
    )
