"""Planners on exact contours: how many they need, and whether their word can be trusted."""

from __future__ import annotations

import timeit
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from palpate.core.explore.planners.choice import END_SHARE, Planner
from palpate.core.explore.planners.cover import unfelt_runs
from palpate.core.explore.planners.foretold import foretell
from palpate.core.explore.planners.fuzzy import Fuzzy
from palpate.core.explore.planners.intervals import profile_of
from palpate.core.explore.planners.known import Slice
from palpate.core.explore.planners.predicted import Predicted
from palpate.core.explore.planners.templates import TEMPLATES
from palpate.core.explore.planners.thesis import Thesis
from palpate.launch.bench_row import Row
from palpate.launch.planner_objects import HELD_OUT, TUNED, Radius, drawn_objects
from palpate.launch.planner_trial import EXTENT, MOST, Trial, known_of, run

DEMAND = 0.0025
"""Root mean square error of the side, over the height."""
TOLERANCES, QUICK_TOLERANCES = (0.0015, 0.002, 0.0025, 0.004), (0.0015, 0.0025)
"""None is below what the noise alone makes of the error."""
NOISE = 1e-4
"""Of a pad's position, m."""
DRAWN, SEED = 60, 11
"""Objects by chance."""
CANDIDATES = 95
"""Heights among which one that sees the truth chooses."""
MOST_MILLISECONDS = 5.0

THESIS_SETS = [
    *(
        Thesis(template=template, bend_rate=a, change_rate=2.0 * a, least=least, most=most)
        for template, a, (least, most) in product(
            TEMPLATES, (0.05, 0.15, 0.4), ((0.02, 0.2), (0.08, 0.2), (0.06, 0.35))
        )
    ),
    *(Thesis(template=template, form="joint", least=0.08, most=0.2) for template in TEMPLATES),
]
FUZZY_SCALES = (0.5, 0.7, 1.0, 1.4)

Counts = Mapping[str, int]
"""Contours that each object needs."""


class Told(NamedTuple):
    """One run to its end: what was claimed, and what was true; over the height."""

    true: float
    """Root mean square error."""
    bound: float
    """That the run has claimed."""
    slices: int
    """Slices."""
    first_true: int | None
    """Slices at which the error was first within tolerance."""
    first_bound: int | None
    """At which the bound was."""


def planner_rows(quick: bool) -> Iterable[Row]:
    """Figures of planners.

    Parameters
    ----------
    quick : bool
        Fewer runs of the calibration.
    """
    yield from count_rows()
    yield from _other_objects("held-out objects", HELD_OUT)
    yield from _other_objects("drawn objects", drawn_objects(DRAWN, SEED))
    yield from calibration_rows(QUICK_TOLERANCES if quick else TOLERANCES)
    milliseconds = 1e3 * _decision()
    fast = milliseconds <= MOST_MILLISECONDS
    target = f"<= {MOST_MILLISECONDS:g}"
    yield Row("a decision with 12 slices, ms", f"{milliseconds:.1f}", target, fast)


def count_rows() -> Iterable[Row]:
    """Contours that the planners need for the demand, summed over the objects."""
    trials = {name: Trial(radius) for name, radius in TUNED.items()}
    even = even_counts(trials)
    bare = even_counts(trials, slopes=False)
    foretold = first_counts(Predicted(), trials)
    sets = [plan_counts(one, trials) for one in THESIS_SETS]
    sums = [sum(counts.values()) for counts in sets]
    thesis = min(sums)
    fuzzy = min(sum(plan_counts(Fuzzy(scale=s), trials).values()) for s in FUZZY_SCALES)
    seen = {name: greedy_count(trial) for name, trial in trials.items()}
    for name in trials:
        said = f"{bare[name]} / {even[name]} / {foretold[name]} / {seen[name]}"
        yield Row(f"{name}: positions only / uniform / predicted / seeing", said, "", True)
    best = THESIS_SETS[sums.index(thesis)]
    oracle = sum(min(counts[name] for counts in sets) for name in trials)
    yield Row("sum, thesis, the best set for each object", str(oracle), "", True)
    yield Row("sum, uniform with positions only", str(sum(bare.values())), "", True)
    yield Row("sum, uniform", str(sum(even.values())), "", True)
    rule = f"{best.template} {best.form} {best.bend_rate:g}, {best.least:g} to {best.most:g}"
    yield Row(f"sum, thesis, best of {len(sums)} sets", str(thesis), "", True)
    yield Row("that set", rule, "", True)
    yield Row(f"sum, best of {len(FUZZY_SCALES)} fuzzy", str(fuzzy), "", True)
    yield Row("sum, seeing the truth, one slice ahead", str(sum(seen.values())), "", True)
    total = sum(foretold.values())
    yield Row("sum, predicted", str(total), "", True)
    yield _ratio("predicted over uniform", total, sum(even.values()), 0.95)
    yield _ratio("predicted over the best thesis set", total, thesis, 0.85)
    yield _ratio("predicted over uniform with positions only", total, sum(bare.values()), 0.70)
    worst = max(foretold[name] - even[name] for name in trials)
    yield Row("predicted less uniform, on the worst object", str(worst), "<= 1", worst <= 1)


def _other_objects(title: str, objects: Mapping[str, Radius]) -> Iterable[Row]:
    trials = {name: Trial(radius) for name, radius in objects.items()}
    even, bare = even_counts(trials), even_counts(trials, slopes=False)
    foretold = first_counts(Predicted(), trials)
    total = sum(foretold.values())
    for name, whole in (("uniform", even), ("uniform, positions only", bare)):
        ratio = f"{total / sum(whole.values()):.2f}"
        yield Row(f"{len(trials)} {title}: predicted over {name}", ratio, "", True)
    worst = max(foretold[name] - even[name] for name in trials)
    yield Row(f"{title}: predicted less uniform, worst", str(worst), "", True)


def calibration_rows(tolerances: Sequence[float]) -> Iterable[Row]:
    """Whether the bound holds as often as it says, on objects not used for tuning."""
    objects = {**HELD_OUT, **drawn_objects(DRAWN // 3, SEED)}
    runs = [
        told(Trial(radius, noise, seed), tolerance)
        for radius in objects.values()
        for noise, seed in ((0.0, 0), (NOISE, 1), (NOISE, 2))
        for tolerance in tolerances
    ]
    held = float(np.mean([one.true <= one.bound for one in runs]))
    name = f"{len(runs)} runs on other objects: bound of 95 % holds"
    yield Row(name, f"{held:.1%}", "90 to 98 %", 0.90 <= held <= 0.98)
    reached = [one for one in runs if one.first_true is not None]
    near = float(np.mean([_near(one.first_bound, one) for one in reached]))
    name = "other objects: bound within tolerance at most 1 contour late"
    yield Row(name, f"{near:.1%}", ">= 80 %", near >= 0.80)
    ended = float(np.mean([_near(one.slices, one) for one in reached]))
    yield Row("other objects: ends so, with everything felt", f"{ended:.1%}", "", True)
    late = np.median([one.slices - (one.first_true or 0) for one in reached])
    yield Row(
        "other objects: contours more for feeling everything, median", f"{late:.0f}", "", True
    )


def even_counts(trials: Mapping[str, Trial], *, slopes: bool = True) -> Counts:
    """Of even slices, the fewest that do."""

    def enough(trial: Trial, count: int) -> bool:
        heights = EXTENT * np.linspace(END_SHARE, 1.0 - END_SHARE, count)
        slices = [trial.slice_at(height) for height in heights.tolist()]
        return trial.rms(slices, slopes=slopes) <= DEMAND

    return {
        name: next((count for count in range(2, MOST) if enough(trial, count)), MOST)
        for name, trial in trials.items()
    }


def first_counts(planner: Planner, trials: Mapping[str, Trial]) -> Counts:
    """After how many slices of a plan the side is first good enough."""
    return {
        name: _first(errors_of(trial, run(planner, trial, DEMAND)[0]), DEMAND) or MOST
        for name, trial in trials.items()
    }


def plan_counts(planner: Planner, trials: Mapping[str, Trial]) -> Counts:
    """How many slices a plan has, if at its end the side is good enough."""
    counts = {}
    for name, trial in trials.items():
        slices, stop = run(planner, trial, DEMAND)
        done = stop is not None and trial.rms(slices) <= DEMAND
        counts[name] = len(slices) if done else MOST
    return counts


def greedy_count(trial: Trial) -> int:
    """Slices for one who sees the truth, and always takes the height that helps most."""
    heights = (EXTENT * np.linspace(END_SHARE, 1.0 - END_SHARE, CANDIDATES)).tolist()
    slices = [trial.slice_at(heights[0]), trial.slice_at(heights[-1])]
    while trial.rms(slices) > DEMAND and len(slices) < MOST:
        taken = {one.height for one in slices}
        offers = [trial.slice_at(height) for height in heights if height not in taken]
        slices.append(min(offers, key=lambda one: trial.rms([*slices, one])))
    return len(slices)


def told(trial: Trial, tolerance: float) -> Told:
    """Let the default planner work until it stops, and compare its word with the truth."""
    slices, _ = run(Predicted(), trial, tolerance, most=40)
    bounds = [
        foretell(one, profile_of(one), unfelt_runs(one)).bound if len(one.slices) > 2 else 1.0
        for one in (known_of(slices[: i + 1], tolerance) for i in range(len(slices)))
    ]
    errors = errors_of(trial, slices)
    first_true, first_bound = _first(errors, tolerance), _first(bounds, tolerance)
    return Told(errors[-1], bounds[-1], len(slices), first_true, first_bound)


def errors_of(trial: Trial, slices: Sequence[Slice]) -> list[float]:
    """True error after each slice, over the height."""
    return [trial.rms(slices[: i + 1]) for i in range(len(slices))]


def _first(values: Sequence[float], most: float) -> int | None:
    return next((i + 1 for i, value in enumerate(values) if value <= most), None)


def _near(count: int | None, one: Told) -> bool:
    return count is not None and one.first_true is not None and abs(count - one.first_true) <= 1


def _decision() -> float:
    trial = Trial(TUNED["bottle"])
    slices = tuple(
        trial.slice_at(height) for height in (EXTENT * np.linspace(0.03, 0.97, 12)).tolist()
    )
    known, planner = known_of(slices, 0.0002), Predicted()
    return _least(lambda: planner.next(known))


def _least(call: Callable[[], object]) -> float:
    """The best of some calls, s: what a busy computer adds is not the method's."""
    return min(timeit.repeat(call, number=1, repeat=9))


def _ratio(name: str, part: int, whole: int, most: float) -> Row:
    return Row(name, f"{part / whole:.2f}", f"<= {most:.2f}", part <= most * whole)
