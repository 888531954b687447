"""What must hold of the planner Template. Run it with ``python -m pytest`` in this folder.

`Trial` answers for an object of a formula, at once: no touch is simulated. `TUNED` has sixteen.
"""

from __future__ import annotations

from dataclasses import replace

from palpate.core.explore.planners.choice import Height, Stop, Wait
from palpate.core.explore.planners.known import Budget, Known, Slice
from palpate.launch.planner_objects import TUNED
from palpate.launch.planner_trial import Trial, known_of, lost, run
from palpate.launch.templates.planner import Template

TOLERANCE = 0.0025
"""Root mean square error that is asked for, over the object's height."""


def test_everything_a_pad_can_feel_is_felt() -> None:
    """On each object the plan ends, and leaves nothing unfelt that is larger than a feature."""
    for name, radius in TUNED.items():
        slices, stop = run(Template(), Trial(radius), TOLERANCE)
        assert stop is not None, f"{name}: no end after {len(slices)} slices"
        assert stop.unfelt is not None
        assert stop.unfelt <= known_of(slices, TOLERANCE).feature, name


def test_the_side_is_within_tolerance_where_the_planner_says_so() -> None:
    """`Trial` knows the truth, and rebuilds the side from positions and slopes."""
    for name, radius in TUNED.items():
        trial = Trial(radius)
        slices, stop = run(Template(), trial, TOLERANCE)
        assert stop is not None
        assert not stop.within or trial.rms(slices) < TOLERANCE, name


def test_no_height_is_asked_for_twice_and_none_beyond_the_ends() -> None:
    """Nor is one of the ends themselves."""
    for radius in TUNED.values():
        slices, _ = run(Template(), Trial(radius), TOLERANCE)
        known = known_of(slices, TOLERANCE)
        heights = [one.height for one in slices]
        assert len(set(heights)) == len(heights)
        assert known.low < min(heights) <= max(heights) < known.high


def test_the_plan_in_millimetres_is_the_plan_in_metres() -> None:
    """A planner that compares a length with a number of its own fails here."""
    slices, _ = run(Template(), Trial(TUNED["vase"]), TOLERANCE)
    for count in range(len(slices) + 1):
        known = known_of(slices[:count], TOLERANCE)
        metres, millimetres = Template().next(known), Template().next(times(known, 1000.0))
        assert metres.reason == millimetres.reason
        if isinstance(metres, Height):
            assert isinstance(millimetres, Height)
            assert abs(millimetres.height / 1000.0 - metres.height) < 1e-9 * known.extent


def test_a_plan_ends_where_nothing_can_be_traced() -> None:
    """Every slice fails; the planner must not ask for ever."""
    slices = tuple[Slice, ...]()
    while isinstance(choice := Template().next(known_of(slices, TOLERANCE)), Height):
        slices = (*slices, lost(choice.height))
        assert len(slices) < 100
    assert isinstance(choice, Stop)


def test_the_budget_is_kept() -> None:
    """Nothing more is begun when it would be overrun."""
    known = replace(known_of((), TOLERANCE), budget=Budget(most_touches=100, touches=100))
    assert isinstance(Template().next(known), Stop)


def test_other_fingers_are_kept_away_from() -> None:
    """Fingers at work are waited for where there is no room beside them."""
    known = known_of((), TOLERANCE)
    first = Template().next(known)
    assert isinstance(first, Height)
    taken, apart = (first.height,), 0.1 * known.extent
    second = Template().next(replace(known, taken=taken, apart=apart))
    assert isinstance(second, Height)
    assert abs(second.height - first.height) >= apart
    alone = Template().next(replace(known, taken=taken, apart=known.extent))
    assert isinstance(alone, Wait)


def times(known: Known, unit: float) -> Known:
    """The same in another unit of length, of which the old one has so many."""

    def scaled(one: Slice) -> Slice:
        return replace(
            one,
            height=one.height * unit,
            radii=one.radii * unit,
            curvatures=one.curvatures / unit,
            felt_low=one.felt_low * unit,
            felt_high=one.felt_high * unit,
            deviation=one.deviation * unit,
        )

    names = ("low", "high", "tolerance", "resolution", "feature")
    lengths = {name: getattr(known, name) * unit for name in names}
    return replace(known, **lengths, slices=tuple(map(scaled, known.slices)))
