"""How many exact contours each planner needs, and which step template suits which object.

The side is rebuilt in the same way for all planners; the count of even slices is the smallest that
suffices, known only afterwards. The analysis of templates is the one that the thesis proposes
(6.1): each template as a product of one of curvature and one of its change (separable, (3.28)),
and as one of their sum (equal to the product only for the exponential), with constants from one
grid. Constants are chosen on some objects of a kind, by the fewest contours with which the side is
good enough at the plan's end, and judged on other objects. The kind of an object follows from its
curvature along the height, times the height: the largest of the middle 80 %, averaged around.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, product
from typing import Literal, NamedTuple

import numpy as np

from palpate.bench.radii import HELD_OUT, drawn_objects
from palpate.bench.table import Row, at_least, at_most, best_seconds, figure
from palpate.core.explore import planners as rules

KINDS = {"plain": 4.0, "featured": 9.0, "sharp": np.inf}  # Largest curvature, times the height
Form = Literal["product", "joint"]
Trials = Mapping[str, rules.PlannerTrial]
Counts = Mapping[str, int]  # Contours that each object needs


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSettings:
    """Objects, tolerances and demands of the comparison of planners."""

    max_error: float = 0.0025  # [fraction of the height] root mean square error of the side
    # [fraction of the height] demanded; none is below the error that noise alone causes.
    tolerances: tuple[float, ...] = (0.0015, 0.002, 0.0025, 0.004)
    noise: float = 1e-4  # [m] standard deviation of a pad's position
    n_drawn: int = 60  # random objects, of which a third calibrate the bound
    seed: int = 11  # of the random objects
    n_candidates: int = 95  # heights among which the planner that sees the truth chooses
    max_calibration_slices: int = 40  # of a run that tests the bound
    max_decision_time: float = 5.0  # [ms] of the default planner, for one slice
    max_over_uniform: float = 0.95  # contours of the default planner / of even slices
    max_over_positions: float = 0.70  # the same / of even slices without slopes
    max_extra_contours: int = 1  # of the default planner over even slices, on the worst object
    held_range: tuple[float, float] = (0.90, 0.98)  # fraction of the 95 % bounds that must hold
    min_punctual: float = 0.80  # of runs: bound and error reach tolerance at most 1 contour apart


@dataclass(frozen=True, slots=True, kw_only=True)
class TemplateSettings:
    """Objects and the grid of constants of the comparison of step templates."""

    n_drawn: int = 80  # random objects; every second one chooses the constants
    rates: tuple[float, ...] = (0.02, 0.05, 0.15, 0.4, 1.0)  # of curvature; larger: shorter steps
    # Rate of the change of curvature / rate of curvature; 0: the change has no influence.
    product_changes: tuple[float, ...] = (0.0, 0.5, 2.0)  # where two templates are multiplied
    joint_changes: tuple[float, ...] = (0.5, 2.0)  # the same, where one template has the sum
    # [fraction of the height] smallest and largest step
    steps: tuple[tuple[float, float], ...] = (
        *((0.02, 0.1), (0.02, 0.2), (0.05, 0.15), (0.08, 0.2), (0.06, 0.35), (0.12, 0.35)),
    )
    powers: tuple[float, ...] = (0.5, 1.0, 3.0)  # of the two templates that have one
    stride: int = 1  # only each `stride`-th set of constants is tried
    n_segments: tuple[int, ...] = (2, 4, 16)  # of the piecewise linear forms
    max_over_best: float = 0.85  # contours of the default planner / of the best template


DEFAULT_PLANNERS = PlannerSettings()
QUICK_PLANNERS = PlannerSettings(tolerances=(0.0015, 0.0025))
QUICK_TEMPLATES = TemplateSettings(stride=7)


class PlanClaim(NamedTuple):
    """Stated and true errors of a run; as fractions of the height."""

    true: float  # Root mean square error
    bound: float  # That the run states
    slices: int
    first_true: int | None  # Number of slices at which the error is first within tolerance
    first_bound: int | None  # Number of slices at which the bound is first within tolerance


def planner_rows(quick: bool) -> Iterable[Row]:
    """Figures of planners; fewer runs of the calibration if quick."""
    settings = QUICK_PLANNERS if quick else DEFAULT_PLANNERS
    drawn = drawn_objects(settings.n_drawn, settings.seed)
    yield from count_rows(settings)
    yield from _other_objects("held-out objects", HELD_OUT, settings)
    yield from _other_objects("drawn objects", drawn, settings)
    yield from step_rule_rows({**HELD_OUT, **drawn}, settings)
    yield from plan_calibration_rows(settings)
    trial = rules.PlannerTrial(rules.TUNED["bottle"])
    heights = trial.settings.extent * np.linspace(0.03, 0.97, 12)
    slices = tuple(trial.slice_at(height) for height in heights.tolist())
    decide = partial(rules.Predicted().next, rules.observation_of(slices, 0.0002))
    milliseconds, most = 1e3 * best_seconds(decide, 9), settings.max_decision_time
    yield at_most("a decision with 12 slices", milliseconds, most, ".1f", " ms")


def count_rows(settings: PlannerSettings = DEFAULT_PLANNERS) -> Iterable[Row]:
    """Contours that the planners need for the demand, summed over the objects."""
    trials = _trials(rules.TUNED)
    even, bare, predicted = _counts(trials, settings.max_error)
    greedy = {
        name: greedy_count(trial, settings.max_error, settings.n_candidates)
        for name, trial in trials.items()
    }
    for name in trials:
        counts = f"{bare[name]} / {even[name]} / {predicted[name]} / {greedy[name]}"
        yield Row(f"{name}: positions only / uniform / predicted / seeing", counts)
    for title, value in {
        "sum, uniform with positions only": sum(bare.values()),
        "sum, uniform": sum(even.values()),
        "sum, seeing the truth, one slice ahead": sum(greedy.values()),
        "sum, predicted": sum(predicted.values()),
    }.items():
        yield Row(title, str(value))
    for name, rival, most in (
        ("uniform", even, settings.max_over_uniform),
        ("uniform with positions only", bare, settings.max_over_positions),
    ):
        ratio = sum(predicted.values()) / sum(rival.values())
        yield Row(f"predicted over {name}", f"{ratio:.2f}", f"<= {most:.2f}", ratio <= most)
    more = max(predicted[name] - even[name] for name in even)
    title = "predicted less uniform, on the worst object"
    yield Row(
        title, str(more), f"<= {settings.max_extra_contours}", more <= settings.max_extra_contours
    )


def _trials(objects: Mapping[str, rules.Radius]) -> Trials:
    return {name: rules.PlannerTrial(radius) for name, radius in objects.items()}


def _counts(trials: Trials, max_error: float) -> tuple[Counts, Counts, Counts]:
    """Counts of even slices, of even slices without slopes, and of the default planner."""
    bare = even_counts(trials, max_error, slopes=False)
    return even_counts(trials, max_error), bare, first_counts(rules.Predicted(), trials, max_error)


def greedy_count(trial: rules.PlannerTrial, max_error: float, n_candidates: int) -> int:
    """Slices of a planner that sees the truth and always takes the height that helps most."""
    heights = _even_heights(n_candidates)
    slices = [trial.slice_at(heights[0]), trial.slice_at(heights[-1])]
    while trial.rms(slices) > max_error and len(slices) < trial.settings.max_slices:
        taken = {slice_.height for slice_ in slices}
        offers = [trial.slice_at(height) for height in heights if height not in taken]
        slices.append(min(offers, key=lambda offer: trial.rms([*slices, offer])))
    return len(slices)


def _even_heights(count: int) -> list[float]:
    """Even heights [m] between the ends that the planners leave out."""
    shares = np.linspace(
        rules.SliceSettings().end_fraction, 1.0 - rules.SliceSettings().end_fraction, count
    )
    heights: list[float] = (rules.DEFAULT_TRIAL.extent * shares).tolist()
    return heights


def _other_objects(
    title: str, objects: Mapping[str, rules.Radius], settings: PlannerSettings
) -> Iterable[Row]:
    trials = _trials(objects)
    even, bare, predicted = _counts(trials, settings.max_error)
    total = sum(predicted.values())
    for name, counts in (("uniform", even), ("uniform, positions only", bare)):
        ratio = f"{total / sum(counts.values()):.2f}"
        yield Row(f"{len(trials)} {title}: predicted over {name}", ratio)
    worst = max(predicted[name] - even[name] for name in trials)
    yield Row(f"{title}: predicted less uniform, worst", str(worst))


def step_rule_rows(
    objects: Mapping[str, rules.Radius], settings: PlannerSettings = DEFAULT_PLANNERS
) -> Iterable[Row]:
    """Planners that step from slice to slice, on objects on which none of them was tuned."""
    trials, max_error = _trials(objects), settings.max_error
    planners: dict[str, rules.Planner] = {
        "thesis": rules.Thesis(),
        "fuzzy": rules.Fuzzy(),
        "learned": rules.Learned(),
    }
    for name, planner in planners.items():
        counts = np.array([plan_count(planner, trial, max_error) for trial in trials.values()])
        good = counts[counts < rules.DEFAULT_TRIAL.max_slices]
        shown = f"{good.mean():.1f}, {len(counts) - len(good)} of {len(counts)} failed"
        yield Row(f"steps by {name}: contours where they suffice", shown)
    predicted = first_counts(rules.Predicted(), trials, max_error)
    mean = float(np.mean(list(predicted.values())))
    yield figure("predicted, until the error is small enough", mean, ".1f")
    mean = float(np.mean(list(even_counts(trials, max_error).values())))
    yield figure("even, known afterwards", mean, ".1f")


def even_counts(trials: Trials, max_error: float, *, slopes: bool = True) -> Counts:
    """The smallest number of even slices that suffices."""

    def smallest(trial: rules.PlannerTrial) -> int:
        for count in range(2, trial.settings.max_slices):
            slices = [trial.slice_at(height) for height in _even_heights(count)]
            if trial.rms(slices, slopes=slopes) <= max_error:
                return count
        return trial.settings.max_slices

    return {name: smallest(trial) for name, trial in trials.items()}


def first_counts(planner: rules.Planner, trials: Trials, max_error: float) -> Counts:
    """The number of slices of a plan after which the side is first good enough."""
    return {
        name: _first(errors_of(trial, rules.run_planner(planner, trial, max_error)[0]), max_error)
        or trial.settings.max_slices
        for name, trial in trials.items()
    }


def plan_calibration_rows(settings: PlannerSettings = DEFAULT_PLANNERS) -> Iterable[Row]:
    """Whether the bound holds as often as it states, on objects on which nothing was tuned."""
    objects = {**HELD_OUT, **drawn_objects(settings.n_drawn // 3, settings.seed)}
    runs = [
        plan_claim(
            rules.PlannerTrial(radius, noise, seed), tolerance, settings.max_calibration_slices
        )
        for radius in objects.values()
        for noise, seed in ((0.0, 0), (settings.noise, 1), (settings.noise, 2))
        for tolerance in settings.tolerances
    ]
    held = float(np.mean([run.true <= run.bound for run in runs]))
    (low, high), name = (
        settings.held_range,
        f"{len(runs)} runs on other objects: bound of 95 % holds",
    )
    yield Row(name, f"{held:.1%}", f"{100 * low:.0f} to {100 * high:.0f} %", low <= held <= high)
    reached = [(run, run.first_true) for run in runs if run.first_true is not None]
    punctual = [
        run.first_bound is not None and abs(run.first_bound - first) <= 1 for run, first in reached
    ]
    name = "other objects: bound within tolerance at most 1 contour late"
    yield at_least(name, float(np.mean(punctual)), settings.min_punctual, ".1%")
    late = [run.slices - first for run, first in reached]
    ended = float(np.mean([abs(more) <= 1 for more in late]))
    yield Row("other objects: ends so, with nothing untouched", f"{ended:.1%}")
    name = "other objects: contours more until nothing is untouched, median"
    yield Row(name, f"{np.median(late):.0f}")


def plan_claim(trial: rules.PlannerTrial, tolerance: float, max_slices: int = 40) -> PlanClaim:
    """Run the default planner until it stops, and compare its bound with the true error."""
    slices, _ = rules.run_planner(rules.Predicted(), trial, tolerance, most=max_slices)
    bounds = [
        1.0 if estimate.rms_bound_95 is None else estimate.rms_bound_95 / trial.settings.extent
        for estimate in (
            rules.estimate_error(rules.observation_of(slices[: i + 1], tolerance, trial.settings))
            for i in range(len(slices))
        )
    ]
    errors = errors_of(trial, slices)
    first_true, first_bound = _first(errors, tolerance), _first(bounds, tolerance)
    return PlanClaim(errors[-1], bounds[-1], len(slices), first_true, first_bound)


def errors_of(trial: rules.PlannerTrial, slices: Sequence[rules.ObservedSlice]) -> list[float]:
    """True error after each slice, as a fraction of the height."""
    return [trial.rms(slices[: i + 1]) for i in range(len(slices))]


def _first(values: Sequence[float], most: float) -> int | None:
    return next((i + 1 for i, value in enumerate(values) if value <= most), None)


class ChosenRule(NamedTuple):
    """The best rule of a template and form, and the mean number of contours that it takes."""

    rule: rules.Thesis
    chosen_mean: float  # On the objects that chose it
    judged_mean: float  # On the other objects
    n_failed: int  # Number of the other objects that it does not rebuild well enough


def template_rows(quick: bool) -> Iterator[Row]:
    """Contours by kind of object, and a finding for each kind; fewer constants if quick."""
    settings = QUICK_TEMPLATES if quick else TemplateSettings()
    drawn = drawn_objects(settings.n_drawn, DEFAULT_PLANNERS.seed)
    rule_list = rule_sets(settings)[:: settings.stride]
    halves = [dict(islice(drawn.items(), first, None, 2)) for first in (0, 1)]
    choosing = by_kind({**rules.TUNED, **halves[0]})
    judging = by_kind({**HELD_OUT, **halves[1]})
    for kind in KINDS:
        yield from _kind_rows(kind, rule_list, choosing[kind], judging[kind], settings)
    for count in (0, *settings.n_segments):
        step = partial(rules.Thesis(segments=count).later, 2.0, 1.0, 3)
        name = f"{count} segments" if count else "closed form"
        yield figure(f"one step, {name}", 1e6 * best_seconds(step, 200), ".1f", " us")


def _kind_rows(
    kind: str,
    rule_list: Sequence[rules.Thesis],
    choosing: Trials,
    judging: Trials,
    settings: TemplateSettings,
) -> Iterator[Row]:
    """Contours of the best rules on objects of a kind, and of the default planner."""
    chosen, max_error = best_by_form(rule_list, choosing, judging), DEFAULT_PLANNERS.max_error
    yield Row(f"{kind}: objects that choose, and others", f"{len(choosing)}, {len(judging)}")
    for name, entry in chosen.items():
        shown = f"{entry.chosen_mean:.1f}, {entry.judged_mean:.1f}, {entry.n_failed}"
        yield Row(f"{kind}: {name}: contours, of others, failed", shown)
    best = min(chosen.values(), key=lambda entry: entry.judged_mean)
    for count in settings.n_segments:
        mean, n_failed = judge_rule(replace(best.rule, segments=count), judging)
        yield Row(f"{kind}: the best of others in {count} segments", f"{mean:.1f}, {n_failed}")
    for name, counts in (
        ("predicted", first_counts(rules.Predicted(), judging, max_error)),
        ("even, known afterwards", even_counts(judging, max_error)),
    ):
        mean = float(np.mean(list(counts.values())))
        yield figure(f"{kind}: {name}, of others", mean, ".1f")
        if name == "predicted":
            ratio = mean / best.judged_mean
            yield at_most(f"{kind}: predicted over the best", ratio, settings.max_over_best)
    yield finding(kind, chosen)


def rule_sets(settings: TemplateSettings = TemplateSettings()) -> list[rules.Thesis]:
    """Every template, form and set of constants."""
    forms: list[tuple[Form, float]] = [("product", change) for change in settings.product_changes]
    forms += [("joint", change) for change in settings.joint_changes]
    grid = product(rules.TEMPLATES, forms, settings.rates, settings.steps, settings.powers)
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
        for template, (form, change), rate, (least, most), power in grid
        if template != "exponential" or power == 1.0
    ]


def by_kind(objects: Mapping[str, rules.Radius]) -> dict[str, dict[str, rules.PlannerTrial]]:
    """Trials of objects, by their kind."""
    trials: dict[str, dict[str, rules.PlannerTrial]] = {kind: {} for kind in KINDS}
    for name, radius in objects.items():
        trials[kind_of(radius)][name] = rules.PlannerTrial(radius)
    return trials


def kind_of(radius: rules.Radius) -> str:
    """Plain, featured or sharp."""
    middle = np.linspace(0.1, 0.9, 401)
    curvatures = rules.measure_side(radius, middle, rules.DEFAULT_TRIAL.azimuths).curvatures
    largest = float(np.abs(curvatures).mean(axis=1).max())
    return next(kind for kind, most in KINDS.items() if largest < most)


def best_by_form(
    rule_list: Sequence[rules.Thesis], choosing: Trials, judging: Trials
) -> dict[str, ChosenRule]:
    """The best set of constants of each template and form, by name."""
    best: dict[str, tuple[float, rules.Thesis]] = {}
    for rule in rule_list:
        name = f"{rule.template}, {rule.form if rule.change_rate else 'curvature alone'}"
        mean, _ = judge_rule(rule, choosing)
        if name not in best or mean < best[name][0]:
            best[name] = mean, rule
    return {
        name: ChosenRule(rule, mean, *judge_rule(rule, judging))
        for name, (mean, rule) in best.items()
    }


def judge_rule(
    rule: rules.Thesis, trials: Trials, max_error: float = DEFAULT_PLANNERS.max_error
) -> tuple[float, int]:
    """Mean contours of a rule, and how many objects it does not rebuild well enough."""
    counts = [plan_count(rule, trial, max_error) for trial in trials.values()]
    return float(np.mean(counts)), counts.count(rules.DEFAULT_TRIAL.max_slices)


def plan_count(planner: rules.Planner, trial: rules.PlannerTrial, max_error: float) -> int:
    """Contours of a plan if the side is good enough at its end, else the largest number."""
    slices, stop = rules.run_planner(planner, trial, max_error)
    is_done = stop is not None and trial.rms(slices) <= max_error
    return len(slices) if is_done else trial.settings.max_slices


def finding(kind: str, chosen: Mapping[str, ChosenRule]) -> Row:
    """The best and the worst template, on objects on which their constants were not chosen.

    Constants of the best: rates of curvature and change, smallest and largest step, power.
    """
    ranked = sorted(chosen.items(), key=lambda item: item[1].judged_mean)
    (first, best), (last, worst), rule = ranked[0], ranked[-1], ranked[0][1].rule
    constants = f"{rule.bend_rate:g}, {rule.change_rate:g}, {rule.least:g} to {rule.most:g}"
    shown = f"{first} ({constants}, {rule.power:g}) {best.judged_mean:.1f}"
    return Row(f"{kind}: finding", f"{shown}; worst: {last} {worst.judged_mean:.1f}")
