"""Which step template suits which kind of object: the analysis that the thesis wished for (6.1).

Every template, of curvature and its change each (separable, (3.28)) and of their sum (which is not
but for the exponential, whose product it is), with constants from one grid. They are chosen on some
objects of a kind, by the fewest contours with which the side is good enough at the plan's end, and
judged on others. What kind an object is, its curvature along the height tells: times the height, at
its largest in the middle four fifths, averaged around.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, product
from typing import Literal, NamedTuple

import numpy as np

from palpate.bench.explore.planners import DEMAND, Trials, even_counts, first_counts
from palpate.bench.table import Row, at_most, best_seconds, figure
from palpate.core.explore import planners as rules

DRAWN, SEED = 80, 11  # Objects by chance; every other one chooses
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


class Chosen(NamedTuple):
    """A rule and the mean contours that it takes."""

    rule: rules.Thesis
    chosen: float  # On the objects that chose it
    judged: float  # On the others
    failed: int  # Of the others: those that it does not rebuild well enough


def template_rows(quick: bool) -> Iterator[Row]:
    """Contours by kind of object, and a finding for each kind; fewer constants if quick."""
    drawn, sets = rules.drawn_objects(DRAWN, SEED), rule_sets()[:: QUICK if quick else 1]
    halves = [dict(islice(drawn.items(), first, None, 2)) for first in (0, 1)]
    seen = by_kind({**rules.TUNED, **halves[0]})
    others = by_kind({**rules.HELD_OUT, **halves[1]})
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
    curvatures = rules.measure_side(radius, MIDDLE, rules.AROUND).curvatures
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
    return float(np.mean(counts)), counts.count(rules.MOST_CONTOURS_PLANNED)


def plan_count(rule: rules.Thesis, trial: rules.PlannerTrial) -> int:
    """Contours of a plan, if at its end the side is good enough; else the most."""
    slices, stop = rules.run_planner(rule, trial, DEMAND)
    done = stop is not None and trial.rms(slices) <= DEMAND
    return len(slices) if done else rules.MOST_CONTOURS_PLANNED


def finding(kind: str, found: Mapping[str, Chosen]) -> Row:
    """Which template is best on objects that did not choose it, with its constants, and the worst.

    Constants are the rates of curvature and change, the smallest and the largest step, and the
    power.
    """
    ranked = sorted(found.items(), key=lambda item: item[1].judged)
    (first, best), (last, worst), rule = ranked[0], ranked[-1], ranked[0][1].rule
    constants = f"{rule.bend_rate:g}, {rule.change_rate:g}, {rule.least:g} to {rule.most:g}"
    told = f"{first} ({constants}, {rule.power:g}) {best.judged:.1f}"
    return Row(f"{kind}: finding", f"{told}; worst: {last} {worst.judged:.1f}")
