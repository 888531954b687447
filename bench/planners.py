"""How many contours each planner needs on exact ones, and which step template suits which object.

The side is rebuilt in the same way for all planners; the count of even slices is the fewest that
do, known afterwards. The analysis of templates is what the thesis wished for (6.1): every one, of
curvature and its change each (separable, (3.28)) and of their sum (which is not but for the
exponential, whose product it is), with constants from one grid. They are chosen on some objects of
a kind, by the fewest contours with which the side is good enough at the plan's end, and judged on
others. What kind an object is, its curvature along the height tells: times the height, at its
largest in the middle four fifths, averaged around.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, product
from typing import Literal, NamedTuple

import numpy as np

from palpate.bench.radii import HELD_OUT, drawn_objects
from palpate.bench.table import Row, at_least, at_most, best_seconds, figure
from palpate.core.explore import planners as rules

DEMAND = 0.0025  # Root mean square error of the side, over the height
# None is below what the noise alone makes of the error.
PLAN_TOLERANCES, QUICK_PLAN_TOLERANCES = (0.0015, 0.002, 0.0025, 0.004), (0.0015, 0.0025)
PLAN_NOISE = 1e-4  # Of a pad's position, m
DRAWN, SEED = 60, 11  # Objects by chance
CANDIDATES = 95  # Heights among which one that sees the truth chooses
MOST_MILLISECONDS = 5.0
TEMPLATE_DRAWN = 80  # Objects by chance; every other one chooses
KINDS = {"plain": 4.0, "featured": 9.0, "sharp": np.inf}  # Curvatures below which an object is one
MIDDLE = np.linspace(0.1, 0.9, 401)  # Heights at which its kind is looked for
BEND_RATES = (0.02, 0.05, 0.15, 0.4, 1.0)
Form = Literal["product", "joint"]
# How both are joined, and the rate of the change over that of the curvature; 0: it has no say.
FORMS: tuple[tuple[Form, float], ...] = (
    *(("product", change) for change in (0.0, 0.5, 2.0)),
    *(("joint", change) for change in (0.5, 2.0)),
)
STEPS = ((0.02, 0.1), (0.02, 0.2), (0.05, 0.15), (0.08, 0.2), (0.06, 0.35), (0.12, 0.35))
POWERS = (0.5, 1.0, 3.0)  # Of the two templates that have one
QUICK = 7  # Every so manieth set alone
OVER_THESIS = 0.85
SEGMENTS = (2, 4, 16)  # Of the piecewise linear forms
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
    yield from _other_objects("held-out objects", HELD_OUT)
    yield from _other_objects("drawn objects", drawn_objects(DRAWN, SEED))
    yield from step_rule_rows({**HELD_OUT, **drawn_objects(DRAWN, SEED)})
    yield from plan_calibration_rows(QUICK_PLAN_TOLERANCES if quick else PLAN_TOLERANCES)
    trial, heights = (
        rules.PlannerTrial(rules.TUNED["bottle"]),
        rules.TRIAL.extent * np.linspace(0.03, 0.97, 12),
    )
    slices = tuple(trial.slice_at(height) for height in heights.tolist())
    decide = partial(rules.Predicted().next, rules.observation_of(slices, 0.0002))
    milliseconds = 1e3 * best_seconds(decide, 9)
    yield at_most("a decision with 12 slices", milliseconds, MOST_MILLISECONDS, ".1f", " ms")


def count_rows() -> Iterable[Row]:
    """Contours that the planners need for the demand, summed over the objects."""
    trials = _trials(rules.TUNED)
    even, bare, predicted = _counts(trials)
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
    rivals = ("uniform", even, OVER_UNIFORM), ("uniform with positions only", bare, OVER_POSITIONS)
    for name, rival, most in rivals:
        ratio = sum(predicted.values()) / sum(rival.values())
        yield Row(f"predicted over {name}", f"{ratio:.2f}", f"<= {most:.2f}", ratio <= most)
    more = max(predicted[name] - even[name] for name in even)
    title = "predicted less uniform, on the worst object"
    yield Row(title, str(more), f"<= {MOST_MORE}", more <= MOST_MORE)


def _trials(objects: Mapping[str, rules.Radius]) -> Trials:
    return {name: rules.PlannerTrial(radius) for name, radius in objects.items()}


def _counts(trials: Trials) -> tuple[Counts, Counts, Counts]:
    """Of even slices, of even ones rebuilt from positions alone, and of the default planner."""
    bare = even_counts(trials, slopes=False)
    return even_counts(trials), bare, first_counts(rules.Predicted(), trials)


def greedy_count(trial: rules.PlannerTrial) -> int:
    """Slices for one who sees the truth, and always takes the height that helps most."""
    heights = (
        rules.TRIAL.extent
        * np.linspace(
            rules.SliceSettings().end_fraction, 1.0 - rules.SliceSettings().end_fraction, CANDIDATES
        )
    ).tolist()
    slices = [trial.slice_at(heights[0]), trial.slice_at(heights[-1])]
    while trial.rms(slices) > DEMAND and len(slices) < rules.TRIAL.max_slices:
        taken = {one.height for one in slices}
        offers = [trial.slice_at(height) for height in heights if height not in taken]
        slices.append(min(offers, key=lambda one: trial.rms([*slices, one])))
    return len(slices)


def _other_objects(title: str, objects: Mapping[str, rules.Radius]) -> Iterable[Row]:
    trials = _trials(objects)
    even, bare, predicted = _counts(trials)
    total = sum(predicted.values())
    for name, whole in (("uniform", even), ("uniform, positions only", bare)):
        ratio = f"{total / sum(whole.values()):.2f}"
        yield Row(f"{len(trials)} {title}: predicted over {name}", ratio)
    worst = max(predicted[name] - even[name] for name in trials)
    yield Row(f"{title}: predicted less uniform, worst", str(worst))


def step_rule_rows(objects: Mapping[str, rules.Radius]) -> Iterable[Row]:
    """Rules that step from slice to slice, on objects that none of them has seen."""
    trials = _trials(objects)
    found: dict[str, rules.Planner] = {
        "thesis": rules.Thesis(),
        "fuzzy": rules.Fuzzy(),
        "learned": rules.Learned(),
    }
    for name, rule in found.items():
        counts = np.array([plan_count(rule, one) for one in trials.values()])
        good = counts[counts < rules.TRIAL.max_slices]
        shown = f"{good.mean():.1f}, {len(counts) - len(good)} of {len(counts)} failed"
        yield Row(f"steps by {name}: contours where they suffice", shown)
    mean = float(np.mean(list(first_counts(rules.Predicted(), trials).values())))
    yield figure("predicted, until the error is small enough", mean, ".1f")
    mean = float(np.mean(list(even_counts(trials).values())))
    yield figure("even, known afterwards", mean, ".1f")


def even_counts(trials: Trials, *, slopes: bool = True) -> Counts:
    """Of even slices, the fewest that do."""

    def fewest(trial: rules.PlannerTrial) -> int:
        for count in range(2, rules.TRIAL.max_slices):
            heights = rules.TRIAL.extent * np.linspace(
                rules.SliceSettings().end_fraction, 1.0 - rules.SliceSettings().end_fraction, count
            )
            slices = [trial.slice_at(height) for height in heights.tolist()]
            if trial.rms(slices, slopes=slopes) <= DEMAND:
                return count
        return rules.TRIAL.max_slices

    return {name: fewest(trial) for name, trial in trials.items()}


def first_counts(planner: rules.Planner, trials: Trials) -> Counts:
    """After how many slices of a plan the side is first good enough."""
    return {
        name: _first(errors_of(trial, rules.run_planner(planner, trial, DEMAND)[0]), DEMAND)
        or rules.TRIAL.max_slices
        for name, trial in trials.items()
    }


def plan_calibration_rows(tolerances: Sequence[float]) -> Iterable[Row]:
    """Whether the bound holds as often as it claims, on objects not used for tuning."""
    objects = {**HELD_OUT, **drawn_objects(DRAWN // 3, SEED)}
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
        1.0 if one.rms_bound_95 is None else one.rms_bound_95 / rules.TRIAL.extent
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


class Chosen(NamedTuple):
    """A rule and the mean contours that it takes."""

    rule: rules.Thesis
    chosen: float  # On the objects that chose it
    judged: float  # On the others
    failed: int  # Of the others: those that it does not rebuild well enough


def template_rows(quick: bool) -> Iterator[Row]:
    """Contours by kind of object, and a finding for each kind; fewer constants if quick."""
    drawn, sets = drawn_objects(TEMPLATE_DRAWN, SEED), rule_sets()[:: QUICK if quick else 1]
    halves = [dict(islice(drawn.items(), first, None, 2)) for first in (0, 1)]
    seen = by_kind({**rules.TUNED, **halves[0]})
    others = by_kind({**HELD_OUT, **halves[1]})
    for kind in KINDS:
        found = best_by_form(sets, seen[kind], others[kind])
        yield Row(
            f"{kind}: objects that choose, and others", f"{len(seen[kind])}, {len(others[kind])}"
        )
        for name, one in found.items():
            shown = f"{one.chosen:.1f}, {one.judged:.1f}, {one.failed}"
            yield Row(f"{kind}: {name}: contours, of others, failed", shown)
        best = min(found.values(), key=lambda one: one.judged)
        for count in SEGMENTS:
            mean, failed = judge_rule(replace(best.rule, segments=count), others[kind])
            yield Row(f"{kind}: the best of others in {count} segments", f"{mean:.1f}, {failed}")
        for name, counts in (
            ("predicted", first_counts(rules.Predicted(), others[kind])),
            ("even, known afterwards", even_counts(others[kind])),
        ):
            mean = float(np.mean(list(counts.values())))
            yield figure(f"{kind}: {name}, of others", mean, ".1f")
            if name == "predicted":
                yield at_most(f"{kind}: predicted over the best", mean / best.judged, OVER_THESIS)
        yield finding(kind, found)
    for count in (0, *SEGMENTS):
        step = partial(rules.Thesis(segments=count).later, 2.0, 1.0, 3)
        name = f"{count} segments" if count else "closed form"
        yield figure(f"one step, {name}", 1e6 * best_seconds(step, 200), ".1f", " us")


def rule_sets() -> list[rules.Thesis]:
    """Every template, form and set of constants."""
    places = product(rules.TEMPLATES, FORMS, BEND_RATES, STEPS, POWERS)
    return [
        rules.Thesis(
            template=template,
            form=form,
            bend_rate=rate,
            change_rate=change * rate,
            least=least,
            most=most,
            power=power,
        )
        for template, (form, change), rate, (least, most), power in places
        if template != "exponential" or power == 1.0
    ]


def by_kind(objects: Mapping[str, rules.Radius]) -> dict[str, dict[str, rules.PlannerTrial]]:
    """Trials of objects, by their kind."""
    found: dict[str, dict[str, rules.PlannerTrial]] = {kind: {} for kind in KINDS}
    for name, radius in objects.items():
        found[kind_of(radius)][name] = rules.PlannerTrial(radius)
    return found


def kind_of(radius: rules.Radius) -> str:
    """Plain, featured or sharp."""
    curvatures = rules.measure_side(radius, MIDDLE, rules.TRIAL.azimuths).curvatures
    largest = float(np.abs(curvatures).mean(axis=1).max())
    return next(kind for kind, most in KINDS.items() if largest < most)


def best_by_form(sets: Sequence[rules.Thesis], seen: Trials, others: Trials) -> dict[str, Chosen]:
    """The best set of each template and form, by name."""
    best: dict[str, tuple[float, rules.Thesis]] = {}
    for rule in sets:
        name = f"{rule.template}, {rule.form if rule.change_rate else 'curvature alone'}"
        mean, _ = judge_rule(rule, seen)
        if name not in best or mean < best[name][0]:
            best[name] = mean, rule
    return {
        name: Chosen(rule, mean, *judge_rule(rule, others)) for name, (mean, rule) in best.items()
    }


def judge_rule(rule: rules.Thesis, trials: Trials) -> tuple[float, int]:
    """Mean contours of a rule, and how many objects it does not rebuild well enough."""
    counts = [plan_count(rule, one) for one in trials.values()]
    return float(np.mean(counts)), counts.count(rules.TRIAL.max_slices)


def plan_count(rule: rules.Planner, trial: rules.PlannerTrial) -> int:
    """Contours of a plan, if at its end the side is good enough; else the most."""
    slices, stop = rules.run_planner(rule, trial, DEMAND)
    done = stop is not None and trial.rms(slices) <= DEMAND
    return len(slices) if done else rules.TRIAL.max_slices


def finding(kind: str, found: Mapping[str, Chosen]) -> Row:
    """Which template is best on objects that did not choose it, with its constants, and the worst.

    Constants are the rates of curvature and change, smallest and largest step, and the power.
    """
    ranked = sorted(found.items(), key=lambda item: item[1].judged)
    (first, best), (last, worst), rule = ranked[0], ranked[-1], ranked[0][1].rule
    constants = f"{rule.bend_rate:g}, {rule.change_rate:g}, {rule.least:g} to {rule.most:g}"
    told = f"{first} ({constants}, {rule.power:g}) {best.judged:.1f}"
    return Row(f"{kind}: finding", f"{told}; worst: {last} {worst.judged:.1f}")
