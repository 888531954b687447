"""How many contours each planner needs: on exact contours, and in whole explorations.

What a planner claims is judged on the exact ones. The side is rebuilt in the same way for all of
them. The count of even slices is the fewest that do, known afterwards. The thesis's rules are
judged in `templates`, by kind of object.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.bench.table import Row, at_least, at_most, best_seconds
from palpate.core.explore import planners as rules

DEMAND = 0.0025  # Root mean square error of the side, over the height
# None is below what the noise alone makes of the error.
PLAN_TOLERANCES, QUICK_PLAN_TOLERANCES = (0.0015, 0.002, 0.0025, 0.004), (0.0015, 0.0025)
PLAN_NOISE = 1e-4  # Of a pad's position, m
DRAWN, SEED = 60, 11  # Objects by chance
CANDIDATES = 95  # Heights among which one that sees the truth chooses
MOST_MILLISECONDS = 5.0
Trials = Mapping[str, rules.PlannerTrial]
Counts = Mapping[str, int]  # Contours that each object needs
OVER_UNIFORM, OVER_POSITIONS, MOST_MORE = 0.95, 0.70, 1


class PlanClaim(NamedTuple):
    """One run to its end: what was claimed, and what was true; errors over the height."""

    true: float  # Root mean square error
    bound: float  # That the run has claimed
    slices: int
    first_true: int | None  # Slices at which the error was first within tolerance
    first_bound: int | None  # At which the bound was


def planner_rows(quick: bool) -> Iterable[Row]:
    """Figures of planners; fewer runs of the calibration if quick."""
    yield from count_rows()
    yield from _other_objects("held-out objects", rules.HELD_OUT)
    yield from _other_objects("drawn objects", rules.drawn_objects(DRAWN, SEED))
    yield from plan_calibration_rows(QUICK_PLAN_TOLERANCES if quick else PLAN_TOLERANCES)
    trial, heights = (
        rules.PlannerTrial(rules.TUNED["bottle"]),
        rules.EXTENT * np.linspace(0.03, 0.97, 12),
    )
    slices = tuple(trial.slice_at(height) for height in heights.tolist())
    decide = partial(rules.Predicted().next, rules.observation_of(slices, 0.0002))
    milliseconds = 1e3 * best_seconds(decide, 9)
    yield at_most("a decision with 12 slices", milliseconds, MOST_MILLISECONDS, ".1f", " ms")


def count_rows() -> Iterable[Row]:
    """Contours that the planners need for the demand, summed over the objects."""
    trials = _trials(rules.TUNED)
    even, bare = even_counts(trials), even_counts(trials, slopes=False)
    predicted = first_counts(rules.Predicted(), trials)
    seen = {name: greedy_count(trial) for name, trial in trials.items()}
    for name in trials:
        counts = f"{bare[name]} / {even[name]} / {predicted[name]} / {seen[name]}"
        yield Row(f"{name}: positions only / uniform / predicted / seeing", counts)
    for title, value in {
        "sum, uniform with positions only": sum(bare.values()),
        "sum, uniform": sum(even.values()),
        "sum, seeing the truth, one slice ahead": sum(seen.values()),
        "sum, predicted": sum(predicted.values()),
    }.items():
        yield Row(title, str(value))
    rivals = {"uniform": even, "uniform with positions only": bare}
    yield from _rival_rows(predicted, rivals, even)


def _rival_rows(predicted: Counts, rivals: Mapping[str, Counts], even: Counts) -> Iterator[Row]:
    """Sums over those of uniform and of positions only, in this order."""
    total = sum(predicted.values())
    most_over = (OVER_UNIFORM, OVER_POSITIONS)
    for (name, counts), most in zip(rivals.items(), most_over, strict=True):
        other = sum(counts.values())
        value, holds = f"{total / other:.2f}", total <= most * other
        yield Row(f"predicted over {name}", value, f"<= {most:.2f}", holds)
    more = max(predicted[name] - even[name] for name in even)
    title = "predicted less uniform, on the worst object"
    yield Row(title, str(more), f"<= {MOST_MORE}", more <= MOST_MORE)


def _trials(objects: Mapping[str, rules.Radius]) -> Trials:
    return {name: rules.PlannerTrial(radius) for name, radius in objects.items()}


def greedy_count(trial: rules.PlannerTrial) -> int:
    """Slices for one who sees the truth, and always takes the height that helps most."""
    heights = (
        rules.EXTENT * np.linspace(rules.END_SHARE, 1.0 - rules.END_SHARE, CANDIDATES)
    ).tolist()
    slices = [trial.slice_at(heights[0]), trial.slice_at(heights[-1])]
    while trial.rms(slices) > DEMAND and len(slices) < rules.MOST_CONTOURS_PLANNED:
        taken = {one.height for one in slices}
        offers = [trial.slice_at(height) for height in heights if height not in taken]
        slices.append(min(offers, key=lambda one: trial.rms([*slices, one])))
    return len(slices)


def _other_objects(title: str, objects: Mapping[str, rules.Radius]) -> Iterable[Row]:
    trials = _trials(objects)
    even, bare = even_counts(trials), even_counts(trials, slopes=False)
    predicted = first_counts(rules.Predicted(), trials)
    total = sum(predicted.values())
    for name, whole in (("uniform", even), ("uniform, positions only", bare)):
        ratio = f"{total / sum(whole.values()):.2f}"
        yield Row(f"{len(trials)} {title}: predicted over {name}", ratio)
    worst = max(predicted[name] - even[name] for name in trials)
    yield Row(f"{title}: predicted less uniform, worst", str(worst))


def even_counts(trials: Trials, *, slopes: bool = True) -> Counts:
    """Of even slices, the fewest that do."""

    def fewest(trial: rules.PlannerTrial) -> int:
        for count in range(2, rules.MOST_CONTOURS_PLANNED):
            heights = rules.EXTENT * np.linspace(rules.END_SHARE, 1.0 - rules.END_SHARE, count)
            slices = [trial.slice_at(height) for height in heights.tolist()]
            if trial.rms(slices, slopes=slopes) <= DEMAND:
                return count
        return rules.MOST_CONTOURS_PLANNED

    return {name: fewest(trial) for name, trial in trials.items()}


def first_counts(planner: rules.Planner, trials: Trials) -> Counts:
    """After how many slices of a plan the side is first good enough."""
    return {
        name: _first(errors_of(trial, rules.run_planner(planner, trial, DEMAND)[0]), DEMAND)
        or rules.MOST_CONTOURS_PLANNED
        for name, trial in trials.items()
    }


def plan_calibration_rows(tolerances: Sequence[float]) -> Iterable[Row]:
    """Whether the bound holds as often as it claims, on objects not used for tuning."""
    objects = {**rules.HELD_OUT, **rules.drawn_objects(DRAWN // 3, SEED)}
    runs = [
        plan_claim(rules.PlannerTrial(radius, noise, seed), tolerance)
        for radius in objects.values()
        for noise, seed in ((0.0, 0), (PLAN_NOISE, 1), (PLAN_NOISE, 2))
        for tolerance in tolerances
    ]
    held = float(np.mean([one.true <= one.bound for one in runs]))
    name = f"{len(runs)} runs on other objects: bound of 95 % holds"
    yield Row(name, f"{held:.1%}", "90 to 98 %", 0.90 <= held <= 0.98)
    reached = [(one, one.first_true) for one in runs if one.first_true is not None]
    near = [
        one.first_bound is not None and abs(one.first_bound - first) <= 1 for one, first in reached
    ]
    name = "other objects: bound within tolerance at most 1 contour late"
    yield at_least(name, float(np.mean(near)), 0.80, ".1%")
    late = [one.slices - first for one, first in reached]
    ended = float(np.mean([abs(more) <= 1 for more in late]))
    yield Row("other objects: ends so, with nothing untouched", f"{ended:.1%}")
    name = "other objects: contours more until nothing is untouched, median"
    yield Row(name, f"{np.median(late):.0f}")


def plan_claim(trial: rules.PlannerTrial, tolerance: float) -> PlanClaim:
    """Let the default planner work until it stops, and compare what it claims with the truth."""
    slices, _ = rules.run_planner(rules.Predicted(), trial, tolerance, most=40)
    bounds = [
        1.0 if one.rms_bound_95 is None else one.rms_bound_95 / rules.EXTENT
        for one in (
            rules.estimate_error(rules.observation_of(slices[: i + 1], tolerance))
            for i in range(len(slices))
        )
    ]
    errors = errors_of(trial, slices)
    first_true, first_bound = _first(errors, tolerance), _first(bounds, tolerance)
    return PlanClaim(errors[-1], bounds[-1], len(slices), first_true, first_bound)


def errors_of(trial: rules.PlannerTrial, slices: Sequence[rules.ObservedSlice]) -> list[float]:
    """True error after each slice, over the height."""
    return [trial.rms(slices[: i + 1]) for i in range(len(slices))]


def _first(values: Sequence[float], most: float) -> int | None:
    return next((i + 1 for i, value in enumerate(values) if value <= most), None)
