"""How many contours each planner needs: on exact contours, and in whole explorations.

What a planner claims is judged on the exact ones. The side is rebuilt in the same way for all of
them. The count of even slices is the fewest that do, known afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from itertools import product
from typing import NamedTuple

import numpy as np

from palpate.bench.explore.harness import (
    EXACT,
    Demand,
    Explored,
    explore_object,
    within_percent,
)
from palpate.bench.objects import EXPLORED_OBJECTS, ExploreObject
from palpate.bench.table import Row, at_least, at_most, best_seconds
from palpate.core import Floats, Ints, inverse_pose, split_pose, transform_points
from palpate.core.explore import planners as rules
from palpate.core.geometry import nearest_points, prepare_surface
from palpate.core.rebuild import reconstruct
from palpate.messages.types import Contour, Truth
from palpate.tools import single_threaded

DEMAND = 0.0025  # Root mean square error of the side, over the height
# None is below what the noise alone makes of the error.
PLAN_TOLERANCES, QUICK_PLAN_TOLERANCES = (0.0015, 0.002, 0.0025, 0.004), (0.0015, 0.0025)
PLAN_NOISE = 1e-4  # Of a pad's position, m
DRAWN, SEED = 60, 11  # Objects by chance
CANDIDATES = 95  # Heights among which one that sees the truth chooses
MOST_MILLISECONDS = 5.0
THESIS_SETS = [
    *(
        rules.Thesis(template=template, bend_rate=a, change_rate=2.0 * a, least=least, most=most)
        for template, a, (least, most) in product(
            rules.TEMPLATES, (0.05, 0.15, 0.4), ((0.02, 0.2), (0.08, 0.2), (0.06, 0.35))
        )
    ),
    *(
        rules.Thesis(template=template, form="joint", least=0.08, most=0.2)
        for template in rules.TEMPLATES
    ),
]
FUZZY_SCALES = (0.5, 0.7, 1.0, 1.4)
Trials = Mapping[str, rules.PlannerTrial]
Counts = Mapping[str, int]  # Contours that each object needs
PERCENT = 0.25  # Root mean square error of the side, % of the height
SCREENED = 3  # Sets of the thesis that are best on exact contours
MOST_EVEN = 14  # Even slices that are tried
QUICK = ("ellipsoid", "groove")
OVER_UNIFORM, OVER_THESIS, OVER_POSITIONS, MOST_MORE = 0.95, 0.85, 0.70, 1
# Name of the default planner where the solid is rebuilt from contours alone.
BY_CONTOURS = f"{__name__}:ByContours"
USABLE = ("closed", "occluded")
LEAST_POINTS = 8
WORST = 100.0  # Error where nothing can be rebuilt, %


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
    sets = [plan_counts(one, trials) for one in THESIS_SETS]
    sums = [sum(counts.values()) for counts in sets]
    fuzzy = min(sum(plan_counts(rules.Fuzzy(scale=s), trials).values()) for s in FUZZY_SCALES)
    seen = {name: greedy_count(trial) for name, trial in trials.items()}
    for name in trials:
        counts = f"{bare[name]} / {even[name]} / {predicted[name]} / {seen[name]}"
        yield Row(f"{name}: positions only / uniform / predicted / seeing", counts)
    best = THESIS_SETS[sums.index(min(sums))]
    rule = f"{best.template} {best.form} {best.bend_rate:g}, {best.least:g} to {best.most:g}"
    oracle = sum(min(counts[name] for counts in sets) for name in trials)
    for title, value in {
        "sum, thesis, the best set for each object": oracle,
        "sum, uniform with positions only": sum(bare.values()),
        "sum, uniform": sum(even.values()),
        f"sum, thesis, best of {len(sums)} sets": min(sums),
        "that set": rule,
        f"sum, best of {len(FUZZY_SCALES)} fuzzy": fuzzy,
        "sum, seeing the truth, one slice ahead": sum(seen.values()),
        "sum, predicted": sum(predicted.values()),
    }.items():
        yield Row(title, str(value))
    rivals = {"uniform": even, "the best thesis set": sets[sums.index(min(sums))]}
    yield from _rival_rows(predicted, {**rivals, "uniform with positions only": bare}, even)


def _rival_rows(predicted: Counts, rivals: Mapping[str, Counts], even: Counts) -> Iterator[Row]:
    """Sums over those of uniform, of the best thesis set and of positions only, in this order."""
    total = sum(predicted.values())
    most_over = (OVER_UNIFORM, OVER_THESIS, OVER_POSITIONS)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class ByContours(rules.Predicted):
    """The default planner, not counting on what pads touch beside the slices."""

    def next(self, observation: rules.Observation) -> rules.Choice:
        """As `Predicted.next`."""
        return rules.Predicted.next(self, replace(observation, all_taxels=False, deviation=None))


class ContourCounts(NamedTuple):
    """Contours that one object takes."""

    positions: int  # Even ones, rebuilt from positions alone
    uniform: int  # Even ones
    predicted: int  # Of the default planner
    thesis: tuple[int, ...]  # Of each set of the thesis
    uniform_taxels: int  # Even ones, rebuilt from all touched taxels
    predicted_taxels: int  # Of the default planner, so rebuilt


def whole_planner_rows(quick: bool) -> Iterable[Row]:
    """Counts of every object, and their sums; fewer objects, one set of the thesis if quick."""
    with single_threaded():
        sets = best_sets(1 if quick else SCREENED)
        found = {}
        for name in QUICK if quick else EXPLORED_OBJECTS:
            one = found[name] = counts_of(EXPLORED_OBJECTS[name], sets)
            thesis = ", ".join(map(str, one.thesis))
            shown = f"{one.positions} / {one.uniform} / {one.predicted} / {thesis}"
            yield Row(f"{name}: positions only / uniform / predicted / thesis", shown)
            shown = f"{one.uniform_taxels} / {one.predicted_taxels}"
            yield Row(f"{name}: uniform / predicted, all taxels", shown)
    yield from count_sums(found)


def count_sums(found: Mapping[str, ContourCounts]) -> Iterator[Row]:
    """Sums over the objects, and their ratios."""

    def column(field: str) -> Counts:
        return {name: getattr(one, field) for name, one in found.items()}

    thesis = zip(*(one.thesis for one in found.values()), strict=True)
    sets = [dict(zip(found, counts, strict=True)) for counts in thesis]
    even, predicted = column("uniform"), column("predicted")
    best = min(sets, key=lambda one: sum(one.values()))
    rivals = {"uniform": even, "best thesis set": best}
    rivals["uniform, positions only"] = column("positions")
    for name, counts in {"predicted": predicted, **rivals}.items():
        yield Row(f"sum, {name}", str(sum(counts.values())))
    yield from _rival_rows(predicted, rivals, even)
    taxels = (sum(column(f"{rule}_taxels").values()) for rule in ("uniform", "predicted"))
    yield Row("sum, uniform / predicted, all taxels", " / ".join(map(str, taxels)))


def best_sets(count: int) -> list[rules.Thesis]:
    """The sets of the thesis that need the fewest contours where these are exact."""
    trials = _trials(rules.TUNED)
    return sorted(THESIS_SETS, key=lambda one: sum(plan_counts(one, trials).values()))[:count]


def plan_counts(planner: rules.Planner, trials: Trials) -> Counts:
    """How many slices a plan has, if at its end the side is good enough."""
    counts = {}
    for name, trial in trials.items():
        slices, stop = rules.run_planner(planner, trial, DEMAND)
        done = stop is not None and trial.rms(slices) <= DEMAND
        counts[name] = len(slices) if done else rules.MOST_CONTOURS_PLANNED
    return counts


def counts_of(target: ExploreObject, sets: Sequence[rules.Thesis]) -> ContourCounts:
    """Contours that an object takes with each planner."""
    demand = within_percent(PERCENT)
    predicted = explore_object(target, EXACT, demand)
    sparse = explore_object(target, EXACT, demand._replace(planner=BY_CONTOURS))
    plans = [explore_object(target, EXACT, Demand("thesis", settings=asdict(one))) for one in sets]
    side = Side.of(predicted.truth)

    @cache
    def evenly(count: int) -> Explored:
        return explore_object(target, EXACT, Demand("uniform", settings={"count": count}))

    def fewest(error: SideError) -> int:
        """The fewest even slices that do."""
        even = ((count, evenly(count)) for count in range(2, MOST_EVEN + 1))
        good = (n for n, one in even if error(side, one, len(one.contours)) <= PERCENT)
        return next(good, rules.MOST_CONTOURS_PLANNED)

    return ContourCounts(
        positions=fewest(partial(contour_error, slopes=False)),
        uniform=fewest(contour_error),
        predicted=first_within_percent(side, sparse, contour_error),
        thesis=tuple(at_end(side, one) for one in plans),
        uniform_taxels=fewest(taxel_error),
        predicted_taxels=first_within_percent(side, predicted, taxel_error),
    )


def first_within_percent(side: Side, one: Explored, error: SideError) -> int:
    """Contours of a run until the side is first good enough, else `MOST_CONTOURS_PLANNED`."""
    counts = range(2, len(one.contours) + 1)
    good = (count for count in counts if error(side, one, count) <= PERCENT)
    return next(good, rules.MOST_CONTOURS_PLANNED)


def at_end(side: Side, one: Explored) -> int:
    """Contours of a run whose side is good enough at its end, else `MOST_CONTOURS_PLANNED`."""
    count = len(one.contours)
    return count if contour_error(side, one, count) <= PERCENT else rules.MOST_CONTOURS_PLANNED


class Side(NamedTuple):
    """Of a true surface that stands upright, between 3 and 97 % of its height."""

    points: Floats  # Spread evenly by area, (n, 3), m
    height: float  # Of the object, m

    @classmethod
    def of(cls, truth: Truth) -> Side:
        """The side of a true surface."""
        points = prepare_surface(truth.vertices, truth.faces).samples.points
        share = (points[:, 2] - float(truth.vertices[:, 2].min())) / truth.height
        return cls(
            points[(share >= rules.END_SHARE) & (share <= 1.0 - rules.END_SHARE)], truth.height
        )

    def percent(self, vertices: Floats, faces: Ints) -> float:
        """Root mean square distance of the side from a mesh, % of the height."""
        found = nearest_points(prepare_surface(vertices, faces).search, self.points).distances
        return float(100.0 * np.sqrt((found**2).mean()) / self.height)


def contour_error(side: Side, one: Explored, count: int, *, slopes: bool = True) -> float:
    """Error of the side that is rebuilt from the first contours of a run alone, %.

    Contours without use are left out. `slopes`: with their normals; else from positions alone.
    """
    usable: list[Contour] = [
        each
        for each in one.contours[:count]
        if each.status in USABLE and len(each.points) >= LEAST_POINTS
    ]
    if len(usable) < 2:
        return WORST
    into = inverse_pose(usable[0].frame)
    _, axes = split_pose(into)
    points = [transform_points(into, each.points) for each in usable]
    normals = [each.normals @ axes.T for each in usable] if slopes else None
    try:
        mesh = reconstruct(points, normals, method="skin").mesh()
    except ValueError:  # these contours make no solid
        return WORST
    there = side._replace(points=transform_points(into, side.points))
    return there.percent(mesh.vertices, mesh.faces)


def taxel_error(side: Side, one: Explored, count: int) -> float:
    """Of the side rebuilt from all touched taxels by the time of so many contours, %."""
    made = [model for model in one.models if len(model.contours) <= count]
    return (
        side.percent(made[-1].vertices, made[-1].faces) if made and len(made[-1].faces) else WORST
    )


# Of the side from the first so many contours of a run, %.
SideError = Callable[[Side, Explored, int], float]
