"""What is counted of many runs: targets reached, errors against costs, bounds that held.

Shares of targets against cost are Hansen et al., *COCO: performance assessment*, 2016; bands are
those of a bootstrap over objects, for it is objects that another set would differ in.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from palpate.bench.accuracy.runs import Run
from palpate.core.arrays import Floats

TARGETS = np.geomspace(1e-2, 1e-4, 15)  # Root mean square errors over the height
DRAWS, SEED, BAND = 1000, 0, (2.5, 97.5)  # Of the bootstrap, and its percentiles
SAME = 1.0 + 1e-6  # A tolerance is asked for as a share of the height, and kept in m

Entry = tuple[str, int]  # Object and seed
Table = Mapping[str, Mapping[Entry, Sequence[Run]]]  # Runs by method and entry


def table_of(runs: Iterable[Run]) -> Table:
    """Runs by method, and by the objects and seeds that all methods have."""
    found: dict[str, dict[Entry, list[Run]]] = defaultdict(lambda: defaultdict(list))
    for run in runs:
        found[run.method][run.object, run.seed].append(run)
    common = set.intersection(*(set(entries) for entries in found.values())) if found else set()
    return {
        method: {entry: entries[entry] for entry in sorted(common)}
        for method, entries in found.items()
    }


def run_for(runs: Sequence[Run], target: float) -> Run:
    """The run whose tolerance one asks for who wants this: no looser one, else the strictest."""
    known = sorted(runs, key=lambda one: one.tolerance_m or math.inf)
    fits = [one for one in known if (one.tolerance_m or 0.0) <= target * one.size_m * SAME]
    return fits[-1] if fits else known[0]


def cost_to_reach(runs: Sequence[Run], target: float, which: str) -> float:
    """Cost of the first model within a target, in the run for it; infinite if none is."""
    one = run_for(runs, target)
    good = (point for point in one.curve if point.rms_m <= target * one.size_m)
    return next((point.cost(which) for point in good), math.inf)


def target_costs(
    entries: Mapping[Entry, Sequence[Run]], which: str, targets: Floats = TARGETS
) -> dict[str, Floats]:
    """Costs (seeds, targets) to reach each target, by object."""
    found: dict[str, list[list[float]]] = defaultdict(list)
    for (name, _), runs in entries.items():
        found[name].append([cost_to_reach(runs, target, which) for target in targets.tolist()])
    return {name: np.array(costs) for name, costs in found.items()}


class ReachedShare(NamedTuple):
    """Share of (object, seed, target) that is reached, (n,) each."""

    costs: Floats  # At which it is told
    share: Floats
    low: Floats  # Of the band of 95 %
    high: Floats


def reached_share(costs: Mapping[str, Floats], grid: Floats) -> ReachedShare:
    """The share of targets reached at each cost of a grid, with its band over objects."""
    each = np.array([(one.ravel()[:, None] <= grid).mean(axis=0) for one in costs.values()])
    drawn = np.random.default_rng(SEED).integers(len(each), size=(DRAWS, len(each)))
    low, high = np.percentile(each[drawn].mean(axis=1), BAND, axis=0)
    return ReachedShare(grid, each.mean(axis=0), low, high)


class Spread(NamedTuple):
    """Median and quartiles of the final costs and errors of a setting."""

    cost: Floats  # (3,): lower quartile, median, upper quartile
    error: Floats  # Likewise, over the height


def work_precision(entries: Mapping[Entry, Sequence[Run]], which: str) -> list[Spread]:
    """One for each tolerance, the loosest first; without tolerances, one for each model made.

    A method that takes none is ended by its user: each model on its way is a setting.
    """
    runs = [run for some in entries.values() for run in some if run.curve]
    pairs: dict[float, list[tuple[float, float]]] = defaultdict(list)
    for run in runs:
        if run.tolerance_m is not None:
            asked = float(f"{run.tolerance_m / run.size_m:.3g}")
            pairs[-asked].append((run.curve[-1].cost(which), run.error))
        else:
            for i, point in enumerate(run.curve):
                pairs[i].append((point.cost(which), point.rms_m / run.size_m))
    most = max((len(some) for some in pairs.values()), default=0)
    found = []
    for _, some in sorted(pairs.items()):
        if 2 * len(some) > most:  # of models that only long runs made, nobody can compare
            cost, error = np.percentile(np.array(some), (25, 50, 75), axis=0).T
            found.append(Spread(cost, error))
    return found


def stated_and_true(entries: Mapping[Entry, Sequence[Run]]) -> Floats:
    """Bounds and errors of the last models that have a bound, over the height, (n, 2)."""
    lasts = [(run.curve[-1], run.size_m) for some in entries.values() for run in some if run.curve]
    pairs = [(p.bound_m / size, p.rms_m / size) for p, size in lasts if p.bound_m is not None]
    return np.array(pairs).reshape(-1, 2)


def held_share(pairs: Floats) -> float:
    """Share of the errors that are below what is stated."""
    return float(np.mean(pairs[:, 1] <= pairs[:, 0]))


def dominated_at(ours: Mapping[str, Floats], other: Mapping[str, Floats]) -> bool:
    """Whether at no cost more of the other's entries reach a target than of ours.

    Costs (seeds, 1) by object, of the same objects.
    """
    mine, theirs = (np.sort(np.concatenate([*one.values()]).ravel()) for one in (ours, other))
    return bool((mine <= theirs).all())
