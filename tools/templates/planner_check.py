"""Tests of the planner Template. Run them with ``python -m pytest`` in this folder.

`PlannerTrial` computes slices of an object from a formula; no touch is simulated. `TUNED` has
sixteen objects.
"""

from __future__ import annotations

from dataclasses import replace

from palpate.planning import (
    TUNED,
    Budget,
    Height,
    Observation,
    ObservedSlice,
    PlannerTrial,
    Stop,
    Wait,
    estimate_error,
    lost_slice,
    observation_of,
    run_planner,
)
from palpate.tools.templates.planner import Template

TOLERANCE = 0.0025  # demanded rms error, over the object's height


def test_everything_a_pad_can_touch_is_touched() -> None:
    """On all objects the plan ends, and no untouched span is larger than a feature."""
    for name, radius in TUNED.items():
        slices, stop = run_planner(Template(), PlannerTrial(radius), TOLERANCE)
        assert stop is not None, f"{name}: no end after {len(slices)} slices"
        observation = observation_of(slices, TOLERANCE)
        assert estimate_error(observation).largest_untouched <= observation.feature, name


def test_the_side_is_within_tolerance_where_palpate_says_so() -> None:
    """`PlannerTrial` has the truth, and rebuilds the side from positions and slopes."""
    for name, radius in TUNED.items():
        trial = PlannerTrial(radius)
        slices, _ = run_planner(Template(), trial, TOLERANCE)
        met = estimate_error(observation_of(slices, TOLERANCE)).reached
        assert not met or trial.rms(slices) < TOLERANCE, name


def test_heights_are_distinct_and_between_the_ends() -> None:
    """The heights of the ends are excluded."""
    for radius in TUNED.values():
        slices, _ = run_planner(Template(), PlannerTrial(radius), TOLERANCE)
        observation = observation_of(slices, TOLERANCE)
        heights = [traced.height for traced in slices]
        assert len(set(heights)) == len(heights)
        assert observation.low < min(heights) <= max(heights) < observation.high


def test_the_plan_in_millimetres_is_the_plan_in_metres() -> None:
    """Fails for a planner that compares a length with a number of its own."""
    slices, _ = run_planner(Template(), PlannerTrial(TUNED["vase"]), TOLERANCE)
    for count in range(len(slices) + 1):
        observation = observation_of(slices[:count], TOLERANCE)
        metres, millimetres = (
            Template().next(observation),
            Template().next(times(observation, 1000.0)),
        )
        assert metres.reason == millimetres.reason
        if isinstance(metres, Height):
            assert isinstance(millimetres, Height)
            assert abs(millimetres.height / 1000.0 - metres.height) < 1e-9 * observation.extent


def test_a_plan_ends_where_nothing_can_be_traced() -> None:
    """All slices fail; the planner has to stop."""
    slices = tuple[ObservedSlice, ...]()
    while isinstance(choice := Template().next(observation_of(slices, TOLERANCE)), Height):
        slices = (*slices, lost_slice(choice.height))
        assert len(slices) < 100
    assert isinstance(choice, Stop)


def test_the_budget_is_kept() -> None:
    """The planner stops when the budget is spent."""
    observation = replace(
        observation_of((), TOLERANCE), budget=Budget(most_touches=100, touches=100)
    )
    assert isinstance(Template().next(observation), Stop)


def test_slices_keep_away_from_other_fingers() -> None:
    """Without room beside another finger the planner waits."""
    observation = observation_of((), TOLERANCE)
    first = Template().next(observation)
    assert isinstance(first, Height)
    busy, spacing = (first.height,), 0.1 * observation.extent
    second = Template().next(replace(observation, busy_heights=busy, finger_spacing=spacing))
    assert isinstance(second, Height)
    assert abs(second.height - first.height) >= spacing
    alone = Template().next(
        replace(observation, busy_heights=busy, finger_spacing=observation.extent)
    )
    assert isinstance(alone, Wait)


def times(observation: Observation, unit: float) -> Observation:
    """An observation in a unit of length that is 1 / `unit` of the old one."""

    def scaled(traced: ObservedSlice) -> ObservedSlice:
        return replace(
            traced,
            height=traced.height * unit,
            radii=traced.radii * unit,
            curvatures=traced.curvatures / unit,
            contact_low=traced.contact_low * unit,
            contact_high=traced.contact_high * unit,
            deviation=traced.deviation * unit,
        )

    names = ("low", "high", "tolerance", "resolution", "feature")
    lengths = {name: getattr(observation, name) * unit for name in names}
    return replace(observation, **lengths, slices=tuple(map(scaled, observation.slices)))
