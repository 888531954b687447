"""Planners at work on whole explorations: how many contours each needs for one error of the side.

The side is rebuilt in the same way for all of them, from contours and slopes; then from everything
that was felt. The count of even slices is the fewest that do, known afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import NamedTuple

from palpate.core.explore.planners.choice import Choice
from palpate.core.explore.planners.known import Known
from palpate.core.explore.planners.predicted import Predicted
from palpate.core.explore.planners.thesis import Thesis
from palpate.launch.bench_explore_scene import EXACT, Demand
from palpate.launch.bench_explore_side import Side, of_contours, of_model, side_of
from palpate.launch.bench_explore_trial import Explored, explore_object
from palpate.launch.bench_planners import THESIS_SETS, plan_counts
from palpate.launch.bench_row import Row
from palpate.launch.explore_objects import HEIGHT, OBJECTS, ExploreObject
from palpate.launch.one_thread import one_thread
from palpate.launch.planner_objects import TUNED
from palpate.launch.planner_trial import MOST, Trial

PERCENT = 0.25
"""Root mean square error of the side, % of the height."""
SCREENED = 3
"""Sets of the thesis that are best on exact contours."""
MOST_EVEN = 14
"""Even slices that are tried."""
QUICK = ("ellipsoid", "groove")
OVER_UNIFORM, OVER_THESIS, OVER_POSITIONS, MOST_MORE = 0.95, 0.85, 0.70, 1

BY_CONTOURS = f"{__name__}:ByContours"
"""Name of the default planner where the solid is rebuilt from contours alone."""

Error = Callable[[Side, Explored, int], float]
"""Of the side from the first so many contours of a run, %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ByContours(Predicted):
    """The default planner, not counting on what pads feel beside the slices."""

    def next(self, known: Known) -> Choice:
        """As `Predicted.next`."""
        return Predicted.next(self, replace(known, taxels=False, deviation=None))


class Counts(NamedTuple):
    """Contours that one object takes."""

    positions: int
    """Even ones, rebuilt from positions alone."""
    uniform: int
    """Even ones."""
    predicted: int
    """Of the default planner."""
    thesis: tuple[int, ...]
    """Of each set of the thesis."""
    uniform_felt: int
    """Even ones, rebuilt from everything that was felt."""
    predicted_felt: int
    """Of the default planner, so rebuilt."""


def planner_rows(quick: bool) -> Iterable[Row]:
    """Counts of every object, and their sums.

    Parameters
    ----------
    quick : bool
        Fewer objects, one set of the thesis.
    """
    with one_thread():
        sets = best_sets(1 if quick else SCREENED)
        found = {}
        for name in QUICK if quick else OBJECTS:
            one = found[name] = counts_of(OBJECTS[name], sets)
            thesis = ", ".join(map(str, one.thesis))
            shown = f"{one.positions} / {one.uniform} / {one.predicted} / {thesis}"
            yield Row(f"{name}: positions only / uniform / predicted / thesis", shown, "", True)
            shown = f"{one.uniform_felt} / {one.predicted_felt}"
            yield Row(f"{name}: uniform / predicted, everything felt", shown, "", True)
    yield from sums(found)


def best_sets(count: int) -> list[Thesis]:
    """The sets of the thesis that need the fewest contours where these are exact."""
    trials = {name: Trial(radius) for name, radius in TUNED.items()}
    return sorted(THESIS_SETS, key=lambda one: sum(plan_counts(one, trials).values()))[:count]


def counts_of(target: ExploreObject, sets: Sequence[Thesis]) -> Counts:
    """Contours that an object takes with each planner."""
    foretold = explore_object(target, EXACT, Demand(tolerance=0.01 * PERCENT * HEIGHT))
    sparse = explore_object(target, EXACT, Demand(BY_CONTOURS, tolerance=0.01 * PERCENT * HEIGHT))
    side = side_of(foretold.truth)
    even = Even(target)
    plans = [explore_object(target, EXACT, Demand("thesis", settings=asdict(one))) for one in sets]
    return Counts(
        positions=even.fewest(side, partial(from_contours, slopes=False)),
        uniform=even.fewest(side, from_contours),
        predicted=first(side, sparse, from_contours),
        thesis=tuple(at_end(side, one) for one in plans),
        uniform_felt=even.fewest(side, from_all),
        predicted_felt=first(side, foretold, from_all),
    )


class Even:
    """Explorations of one object with ever more even slices, each made once."""

    def __init__(self, target: ExploreObject):
        self._target = target
        self._runs: dict[int, Explored] = {}

    def fewest(self, side: Side, error: Error) -> int:
        """The fewest even slices that do; `MOST` if none of those tried."""
        for count in range(2, MOST_EVEN + 1):
            one = self._run(count)
            if error(side, one, len(one.contours)) <= PERCENT:
                return count
        return MOST

    def _run(self, count: int) -> Explored:
        if count not in self._runs:
            demand = Demand("uniform", settings={"count": count})
            self._runs[count] = explore_object(self._target, EXACT, demand)
        return self._runs[count]


def from_contours(side: Side, one: Explored, count: int, *, slopes: bool = True) -> float:
    """From the first contours of a run alone."""
    return of_contours(side, one.contours[:count], slopes=slopes)


def from_all(side: Side, one: Explored, count: int) -> float:
    """From everything that was felt by the time of so many contours."""
    made = [model for model in one.models if len(model.contours) <= count]
    return of_model(side, made[-1]) if made else 100.0


def first(side: Side, one: Explored, error: Error) -> int:
    """After how many contours of a run the side is first good enough; `MOST` if never."""
    counts = range(2, len(one.contours) + 1)
    return next((count for count in counts if error(side, one, count) <= PERCENT), MOST)


def at_end(side: Side, one: Explored) -> int:
    """How many contours a run has, if the side is good enough at its end; else `MOST`."""
    count = len(one.contours)
    return count if from_contours(side, one, count) <= PERCENT else MOST


def sums(found: Mapping[str, Counts]) -> Iterator[Row]:
    """Sums over the objects, and their ratios."""
    predicted = sum(one.predicted for one in found.values())
    thesis = min(map(sum, zip(*(one.thesis for one in found.values()), strict=True)))
    rivals = {
        "uniform": (sum(one.uniform for one in found.values()), OVER_UNIFORM),
        "best thesis set": (thesis, OVER_THESIS),
        "uniform, positions only": (sum(one.positions for one in found.values()), OVER_POSITIONS),
    }
    yield Row("sum, predicted", str(predicted), "", True)
    for name, (total, most) in rivals.items():
        yield Row(f"sum, {name}", str(total), "", True)
        holds = predicted <= most * total
        yield Row(f"predicted over {name}", f"{predicted / total:.2f}", f"<= {most:.2f}", holds)
    worst = max(one.predicted - one.uniform for one in found.values())
    title = "predicted less uniform, on the worst object"
    yield Row(title, str(worst), f"<= {MOST_MORE}", worst <= MOST_MORE)
    felt = [(one.uniform_felt, one.predicted_felt) for one in found.values()]
    shown = " / ".join(str(sum(column)) for column in zip(*felt, strict=True))
    yield Row("sum, uniform / predicted, everything felt", shown, "", True)
