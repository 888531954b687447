"""Statistics of many runs: targets reached, errors against costs, bounds that hold.

Shares of targets against cost are those of Hansen et al., *COCO: performance assessment*, 2016;
bands are those of a bootstrap over objects, because another benchmark would have other objects.
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
ROUNDING = 1.0 + 1e-6  # Factor of a tolerance, which is stored in m and compared over the height

Entry = tuple[str, int]  # Object and seed
Table = Mapping[str, Mapping[Entry, Sequence[Run]]]  # Runs by method and entry


def table_of(runs: Iterable[Run]) -> Table:
    """Runs by method, and by those objects and seeds that all methods explored."""
    table: dict[str, dict[Entry, list[Run]]] = defaultdict(lambda: defaultdict(list))
    for run in runs:
        table[run.method][run.object, run.seed].append(run)
    common = set.intersection(*(set(entries) for entries in table.values())) if table else set()
    return {
        method: {entry: entries[entry] for entry in sorted(common)}
        for method, entries in table.items()
    }


def run_for(runs: Sequence[Run], target: float) -> Run:
    """The run with the loosest tolerance within a target, else that with the strictest."""
    known = sorted(runs, key=lambda run: run.tolerance_m or math.inf)
    strict = [run for run in known if (run.tolerance_m or 0.0) <= target * run.size_m * ROUNDING]
    return strict[-1] if strict else known[0]


def cost_to_reach(runs: Sequence[Run], target: float, which: str) -> float:
    """Cost of the first model within a target, in the run of `run_for`; infinite without one."""
    run = run_for(runs, target)
    good = (point for point in run.curve if point.rms_m <= target * run.size_m)
    return next((point.cost(which) for point in good), math.inf)


def target_costs(
    entries: Mapping[Entry, Sequence[Run]], which: str, targets: Floats = TARGETS
) -> dict[str, Floats]:
    """Costs (seeds, targets) to reach each target, by object."""
    costs: dict[str, list[list[float]]] = defaultdict(list)
    for (name, _), runs in entries.items():
        costs[name].append([cost_to_reach(runs, target, which) for target in targets.tolist()])
    return {name: np.array(rows) for name, rows in costs.items()}


class ReachedShare(NamedTuple):
    """Share of (object, seed, target) that is reached, (n,) each."""

    costs: Floats
    share: Floats  # At each cost
    low: Floats  # Of the band of 95 %
    high: Floats


def reached_share(
    costs: Mapping[str, Floats], grid: Floats, n_draws: int = 1000, seed: int = 0
) -> ReachedShare:
    """The share of targets reached at each cost of a grid, with its band over objects.

    `n_draws` and `seed`: of the bootstrap.
    """
    shares = np.array([(c.ravel()[:, None] <= grid).mean(axis=0) for c in costs.values()])
    drawn = np.random.default_rng(seed).integers(len(shares), size=(n_draws, len(shares)))
    low, high = np.percentile(shares[drawn].mean(axis=1), (2.5, 97.5), axis=0)
    return ReachedShare(grid, shares.mean(axis=0), low, high)


class Spread(NamedTuple):
    """Median and quartiles of the final costs and errors of a setting."""

    cost: Floats  # (3,): lower quartile, median, upper quartile
    error: Floats  # Likewise, over the height


def work_precision(entries: Mapping[Entry, Sequence[Run]], which: str) -> list[Spread]:
    """Spreads for each tolerance, the loosest first; without tolerances, for each model.

    A method without tolerance is ended by its user: each of its models is a setting.
    """
    runs = [run for some in entries.values() for run in some if run.curve]
    pairs: dict[float, list[tuple[float, float]]] = defaultdict(list)
    for run in runs:
        if run.tolerance_m is not None:
            share = float(f"{run.tolerance_m / run.size_m:.3g}")
            pairs[-share].append((run.curve[-1].cost(which), run.error))
        else:
            for i, point in enumerate(run.curve):
                pairs[i].append((point.cost(which), point.rms_m / run.size_m))
    largest = max((len(group) for group in pairs.values()), default=0)
    spreads = []
    for _, group in sorted(pairs.items()):
        if 2 * len(group) > largest:  # models of the longest runs alone are not comparable
            cost, error = np.percentile(np.array(group), (25, 50, 75), axis=0).T
            spreads.append(Spread(cost, error))
    return spreads


def stated_and_true(entries: Mapping[Entry, Sequence[Run]]) -> Floats:
    """Bounds and errors of the last models that have a bound, over the height, (n, 2)."""
    lasts = [(run.curve[-1], run.size_m) for some in entries.values() for run in some if run.curve]
    pairs = [(p.bound_m / size, p.rms_m / size) for p, size in lasts if p.bound_m is not None]
    return np.array(pairs).reshape(-1, 2)


def held_share(pairs: Floats) -> float:
    """Share of the errors that are at most the stated bound."""
    return float(np.mean(pairs[:, 1] <= pairs[:, 0]))


def dominated_at(ours: Mapping[str, Floats], other: Mapping[str, Floats]) -> bool:
    """Whether, at each cost, at least as many of our entries reach a target as of the other's.

    Arguments: costs (seeds, 1) by object, of the same objects.
    """
    mine, theirs = (np.sort(np.concatenate([*costs.values()]).ravel()) for costs in (ours, other))
    return bool((mine <= theirs).all())
