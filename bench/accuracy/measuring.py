"""Costs of accuracy: every method on every object, in two processes, and the sheet."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from palpate.bench.accuracy import methods, statistics
from palpate.bench.accuracy.runs import Final, Run, RunsFile, read_runs
from palpate.bench.accuracy.sheet import write_sheet
from palpate.bench.accuracy.statistics import TARGETS
from palpate.bench.explored import EXPLORED_OBJECTS
from palpate.bench.table import Row, at_least, at_most, figure
from palpate.launch.files.source_map import InputError

FOLDER, FILE = "bench-tolerance", "results.json"
SMOOTH = ("sphere", "ellipsoid", "egg", "bottle", "vase", "pear", "hourglass", "potato")


@dataclass(frozen=True, slots=True, kw_only=True)
class AccuracySettings:
    """What is explored."""

    objects: tuple[str, ...] = tuple(EXPLORED_OBJECTS)
    tolerances: tuple[float, ...] = (0.01, 0.005, 0.002, 0.001, 0.0005)  # [fraction of the height]
    n_seeds: int = 3
    max_touches: int = 200  # of a method that does not end by itself
    n_processes: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class AccuracyDemands:
    """What is demanded of palpate; targets are errors as fractions of the height."""

    dominated_below: float = 0.003  # target; below it palpate must dominate every method
    middle_target: float = 0.005  # target on smooth objects
    max_middle_touches: int = 90  # to reach that: median over seeds, of the worst object
    max_loose_ratio: float = 0.45  # touches at the loosest tolerance / at the strictest
    min_held: float = 0.90  # share of bounds of 95 % that hold


QUICK_ACCURACY = AccuracySettings(
    objects=("egg", "vase", "box", "bottle"),
    tolerances=(0.01, 0.002, 0.0005),
    n_seeds=1,
    max_touches=100,
)


def accuracy_rows(
    quick: bool,
    *,
    sheet: Path | None = None,
    cost: str = "touches",
    meshes: Path | None = None,
    add: Sequence[Path] = (),
    method: Sequence[str] = (),
) -> Iterator[Row | str]:
    """Make the runs that are missing, draw the sheet, and compare with what is demanded.

    `sheet`: folder of runs and sheet. `cost`: the axis of the sheet. `meshes`: folder of meshes to
    explore as well. `add`: files of runs of other methods. `method`: functions that are methods as
    well.
    """
    settings = QUICK_ACCURACY if quick else AccuracySettings()
    added = [read_runs(path) for path in add]
    installed = [
        name
        for name in methods.CONTENDERS
        if name != methods.POISSON or methods.poisson_installed()
    ]
    absent = [name for name in methods.CONTENDERS if name not in installed]
    if ":" in "".join(method) and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # for methods of the user
    names = (*installed, *method)
    units = units_of(settings, names, meshes)
    folder = _made_folder(sheet or Path(FOLDER))
    descriptions = {name: methods.contender_of(name).description for name in names}
    file = RunsFile(folder / FILE, descriptions, absent)
    for name in {name for other in added for name in other.methods} & {*file.content.methods}:
        raise InputError(f"--add: there is a method {name!r} already; call it something else")
    yield f"methods that are not installed: {', '.join(absent) or 'none'}"
    missing = [unit for unit in units if not _is_made(unit, file.content.runs)]
    yield from _make_runs(file, missing, settings.n_processes)
    runs = [*file.content.runs, *(run for other in added for run in other.runs)]
    write_sheet(folder, runs, methods.OURS, cost)
    yield f"{folder / FILE}, sheet.svg, sheet.png"
    yield from sheet_rows(runs)


def _made_folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--sheet: {folder} cannot be made: {error.strerror}") from None
    return folder


def units_of(
    settings: AccuracySettings, names: Sequence[str], meshes: Path | None
) -> list[methods.Unit]:
    """All units of work, object by object."""
    objects = [*settings.objects, *(methods.meshes_in(meshes) if meshes else [])]
    tolerances, most = settings.tolerances, settings.max_touches
    together = tuple(name for name in names if name in methods.TOGETHER)
    groups = [together, *((name,) for name in names if name not in methods.TOGETHER)]
    return [
        methods.Unit(group, name, seed, share, most, meshes)
        for name in objects
        for seed in range(settings.n_seeds)
        for group in groups
        for share in (
            tolerances if methods.contender_of(group[0]).has_tolerance else tolerances[-1:]
        )
    ]


def _is_made(unit: methods.Unit, runs: Sequence[Run]) -> bool:
    """Whether all runs of a unit exist."""
    made = {
        run.method
        for run in runs
        if (run.object, run.seed) == (unit.object, unit.seed)
        and (run.tolerance_m is None or np.isclose(run.tolerance_m, unit.share * run.size_m))
    }
    return made >= set(unit.methods)


def _make_runs(file: RunsFile, units: Sequence[methods.Unit], n_processes: int) -> Iterator[str]:
    """Make the runs of units, a line for each; finished runs are kept after Ctrl-C."""
    if not units:
        return
    with get_context("forkserver").Pool(min(n_processes, len(units)), _ignore_interrupts) as pool:
        for number, made in enumerate(pool.imap_unordered(methods.runs_of, units), 1):
            file.add(made)
            ends = ", ".join(_run_text(run) for run in made)
            first = made[0]
            yield f"{number} of {len(units)}: {first.object}, seed {first.seed}: {ends}"


def _ignore_interrupts() -> None:
    """Leave Ctrl-C to the first process, which ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run_text(run: Run) -> str:
    if not run.curve:
        return f"{run.method} FAILED: {run.failed}"
    return f"{run.method} {100 * run.error:.3f} % in {run.curve[-1].touches}"


def sheet_rows(runs: Sequence[Run]) -> Iterator[Row]:
    """Medians and shares of every method, and what is demanded of palpate."""
    table = statistics.table_of(runs)
    if not any(table.values()):
        raise InputError("no object and seed was explored by every method: nothing compares")
    for name, entries in table.items():
        yield from _method_rows(name, entries)
    for name, entries in table.items():
        failed = [run for some in entries.values() for run in some if not run.curve]
        if failed:
            yield Row(f"{name}: runs that failed", f"{len(failed)}: {failed[0].failed}")
    if methods.OURS in table:
        yield from _demand_rows(table)


def _method_rows(name: str, entries: Mapping[statistics.Entry, Sequence[Run]]) -> Iterator[Row]:
    runs = [run for some in entries.values() for run in some if run.curve]
    shares = sorted({f"{100 * (run.tolerance_m or 0) / run.size_m:.3g}" for run in runs}, key=float)
    for share in reversed(shares):
        same_share = [r for r in runs if f"{100 * (r.tolerance_m or 0) / r.size_m:.3g}" == share]
        lasts = [run.curve[-1] for run in same_share]
        touches, robot, compute = (
            float(np.median([last.cost(cost) for last in lasts]))
            for cost in ("touches", "robot", "compute")
        )
        error = 100.0 * float(np.median([run.error for run in same_share]))
        title = f"{name}, {'to its end' if share == '0' else f'asked for {share} %'}"
        shown = f"{error:.3f} %, {touches:.0f}, {robot:.0f} s, {compute:.0f} s"
        yield Row(f"{title}: rms, touches, robot, processor", shown)
        if finals := [run.final for run in same_share if run.final is not None]:
            yield Row(f"{title}: two-way sum, F at 1 and 5 mm", _finals_text(finals))
    stages: dict[str, list[float]] = {}
    for run in runs:
        for count, touched in (run.final.touched_5mm if run.final else {}).items():
            stages.setdefault(count, []).append(touched)
    texts = [f"{count}: {np.median(stages[count]):.0%}" for count in sorted(stages, key=int)]
    if texts:
        yield Row(f"{name}: surface within 5 mm of a touch", ", ".join(texts))
    costs = np.concatenate([*statistics.target_costs(entries, "touches").values()])
    yield figure(f"{name}: targets reached", float(np.isfinite(costs).mean()), ".0%")
    if len(pairs := statistics.stated_and_true(entries)):
        held = statistics.held_share(pairs)
        yield figure(f"{name}: bound of 95 % held, of {len(pairs)}", held, ".0%")


def _finals_text(finals: Sequence[Final]) -> str:
    summed, near, far = (
        float(np.median([getattr(final, field) for final in finals]))
        for field in ("chamfer_sum_m", "f_score_1mm", "f_score_5mm")
    )
    return f"{1e3 * summed:.3f} mm, {near:.3f}, {far:.3f}"


def _demand_rows(table: statistics.Table) -> Iterator[Row]:
    demands, ours = AccuracyDemands(), table[methods.OURS]
    strict = TARGETS[np.less(TARGETS, demands.dominated_below)]
    for name, entries in table.items():
        if name == methods.OURS:
            continue
        worse = [
            target
            for target in strict.tolist()
            if not statistics.dominated_at(
                *(
                    statistics.target_costs(runs, "touches", np.array([target]))
                    for runs in (ours, entries)
                )
            )
        ]
        missed = ", ".join(f"{100 * target:.2g}" for target in worse)
        where = f" (not at {missed} %)" if worse else ""
        yield Row(
            f"palpate dominates {name} at targets below {100 * demands.dominated_below:g} %",
            *(f"{len(strict) - len(worse)} of {len(strict)}{where}", "all", not worse),
        )
    if len(pairs := statistics.stated_and_true(ours)):
        held = statistics.held_share(pairs)
        yield at_least("palpate: bound of 95 % holds", held, demands.min_held, ".0%")
    smooth = {entry: runs for entry, runs in ours.items() if entry[0] in SMOOTH}
    if smooth:
        target = demands.middle_target
        costs = statistics.target_costs(smooth, "touches", np.array([target]))
        most = max(float(np.median(touches)) for touches in costs.values())
        title = f"{100 * target:g} % on {len(costs)} smooth objects: touches, most"
        yield at_most(title, most, demands.max_middle_touches, ".0f")
    ratios = [_loose_over_strict(runs) for runs in ours.values()]
    loose, strictest = (100 * AccuracySettings().tolerances[i] for i in (0, -1))
    title = f"touches at {loose:g} % over those at {strictest:g} %, median"
    yield at_most(title, float(np.median(ratios)), demands.max_loose_ratio, ".2f")


def _loose_over_strict(runs: Sequence[Run]) -> float:
    asked = sorted((run for run in runs if run.curve), key=lambda run: run.tolerance_m or 0.0)
    return asked[-1].curve[-1].touches / asked[0].curve[-1].touches if asked else float("inf")
