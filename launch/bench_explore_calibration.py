"""Whether a run's word can be trusted: objects that had no say in any number of palpate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from palpate.core.explore.planners.predicted import COVERING, FEELING
from palpate.launch.bench_explore_scene import NOISES, Demand
from palpate.launch.bench_explore_trial import Explored, explore_object, first_within
from palpate.launch.bench_row import Row
from palpate.launch.explore_objects import HEIGHT
from palpate.launch.explore_objects_drawn import held_out
from palpate.launch.one_thread import one_thread

RUNS, QUICK_RUNS, AT_ONCE = 200, 8, 20
"""Runs, and after how many of them the figures so far are told."""
FIRST_SEED = 5000
TOLERANCES = (0.15, 0.20, 0.25, 0.40)
"""Asked for in turn, % of the height: none is below what the noise alone makes of the error."""
LEAST_HELD, MOST_HELD, LEAST_NEAR = 0.90, 0.98, 0.80


class Told(NamedTuple):
    """One run: what it claimed, and what was true."""

    held: bool
    """Whether its error is below the bound that it states."""
    late: int | None
    """Contours after the first model truly within tolerance; None if none was."""
    late_felt: int | None
    """Contours after the first model that was, and that left nothing larger than a feature unfelt:
    both are asked for."""


def calibration_rows(quick: bool) -> Iterable[Row]:
    """How often the stated bound holds, and when runs end.

    Parameters
    ----------
    quick : bool
        Fewer runs.
    """
    told: list[Told] = []
    with one_thread():
        for number in range(QUICK_RUNS if quick else RUNS):
            told.append(run(number))
            if len(told) % AT_ONCE == 0 and len(told) < RUNS:
                held = sum(one.held for one in told)
                yield Row(f"runs so far: bound holds in {held}", f"of {len(told)}", "", True)
    yield from figures(told)


def run(number: int) -> Told:
    """One object by chance: every other one with noise, the tolerances in turn."""
    noise = tuple(NOISES.values())[number % len(NOISES)]
    percent = TOLERANCES[number // len(NOISES) % len(TOLERANCES)]
    demand = Demand(tolerance=0.01 * percent * HEIGHT)
    seed = FIRST_SEED + number
    return told_of(explore_object(held_out(seed), noise, demand, seed=seed), percent)


def told_of(one: Explored, percent: float) -> Told:
    """What a run claimed and what was true, with the tolerance in % of the height."""
    first = first_within(one.scores, percent)
    if first is None:
        return Told(one.held is True, None, None)
    felt = [i + 1 for i, reason in enumerate(one.reasons) if reason in (COVERING, FEELING)]
    count = one.score.contours
    return Told(one.held is True, count - first, count - min(max([first, *felt]), count))


def figures(told: Sequence[Told]) -> Iterator[Row]:
    """Shares of the runs."""
    held = sum(one.held for one in told) / len(told)
    good = LEAST_HELD <= held <= MOST_HELD
    yield Row(f"{len(told)} runs: bound of 95 % holds", f"{held:.1%}", "90 to 98 %", good)
    reached = [one for one in told if one.late is not None]
    yield Row("of them within tolerance at some time", f"{len(reached)}", "", True)
    if reached:
        yield from _lateness("within tolerance", [one.late or 0 for one in reached])
        yield from _lateness("and nothing unfelt", [one.late_felt or 0 for one in reached])


def _lateness(what: str, late: Sequence[int]) -> Iterator[Row]:
    """When runs ended, against the first count that would have done."""
    near = sum(abs(one) <= 1 for one in late) / len(late)
    title = f"ended within 1 contour of the first count {what}"
    yield Row(title, f"{near:.1%}", f">= {LEAST_NEAR:.0%}", near >= LEAST_NEAR)
    yield Row(
        f"contours after the first {what}, median", f"{sorted(late)[len(late) // 2]}", "", True
    )
