"""What accuracy costs: every method on every object, in two processes, and the sheet."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from palpate.bench.accuracy import methods, statistics
from palpate.bench.accuracy.runs import Final, Run, RunsFile, read_runs
from palpate.bench.accuracy.sheet import write_sheet
from palpate.bench.explored import EXPLORED_OBJECTS
from palpate.bench.table import Row, at_least, at_most, figure
from palpate.launch.files.source_map import InputError

FOLDER, FILE = "bench-tolerance", "results.json"
SHARES, QUICK_SHARES = (0.01, 0.005, 0.002, 0.001, 0.0005), (0.01, 0.002, 0.0005)
SEEDS, QUICK_SEEDS = 3, 1
QUICK_OBJECTS = ("egg", "vase", "box", "bottle")
SMOOTH = ("sphere", "ellipsoid", "egg", "bottle", "vase", "pear", "hourglass", "potato")
QUICK_TOUCHES = 100  # At which a method without an end of its own is ended
PROCESSES = 2
STRICT, MIDDLE, MOST_MIDDLE = 0.003, 0.005, 90  # Targets, over the height; and touches
MOST_LOOSE, LEAST_HELD = 0.45, 0.90


def accuracy_rows(
    quick: bool,
    *,
    sheet: Path | None = None,
    cost: str = "touches",
    meshes: Path | None = None,
    add: Sequence[Path] = (),
    method: Sequence[str] = (),
) -> Iterator[Row | str]:
    """Make the runs that are missing, draw the sheet, and tell what is demanded.

    `sheet`: folder of runs and sheet. `cost`: against which is drawn. `meshes`: folder of those
    that are explored, too. `add`: files of runs of other methods. `method`: functions that are
    methods, too.
    """
    added = [read_runs(path) for path in add]
    names = [
        name
        for name in methods.CONTENDERS
        if name != methods.POISSON or methods.poisson_installed()
    ]
    absent = [name for name in methods.CONTENDERS if name not in names]
    if ":" in "".join(method) and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # where a planner of one's own is looked for, too
    wanted = (*names, *method)
    units = units_of(quick, wanted, meshes)
    folder = sheet or Path(FOLDER)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--sheet: {folder} cannot be made: {error.strerror}") from None
    told = {name: methods.contender_of(name).told for name in wanted}
    file = RunsFile(folder / FILE, told, absent)
    for name in {one for other in added for one in other.methods} & {*file.content.methods}:
        raise InputError(f"--add: there is a method {name!r} already; call it something else")
    yield f"methods that are not installed: {', '.join(absent) or 'none'}"
    yield from _make_runs(file, [one for one in units if not _is_made(one, file.content.runs)])
    runs = [*file.content.runs, *(run for other in added for run in other.runs)]
    write_sheet(folder, runs, methods.OURS, cost)
    yield f"{folder / FILE}, sheet.svg, sheet.png"
    yield from sheet_rows(runs)


def units_of(quick: bool, names: Sequence[str], meshes: Path | None) -> list[methods.Unit]:
    """Everything that is to be measured, object by object."""
    objects = [*(QUICK_OBJECTS if quick else EXPLORED_OBJECTS)]
    objects += methods.meshes_in(meshes) if meshes else []
    shares, seeds = (QUICK_SHARES, QUICK_SEEDS) if quick else (SHARES, SEEDS)
    most = QUICK_TOUCHES if quick else methods.CHECKPOINTS[-1]
    together = tuple(name for name in names if name in methods.TOGETHER)
    groups = [together, *((name,) for name in names if name not in methods.TOGETHER)]
    return [
        methods.Unit(group, name, seed, share, most, meshes)
        for name in objects
        for seed in range(seeds)
        for group in groups
        for share in (shares if methods.contender_of(group[0]).asked else shares[-1:])
    ]


def _is_made(unit: methods.Unit, runs: Sequence[Run]) -> bool:
    """Whether all runs of a unit are there."""
    there = {
        run.method
        for run in runs
        if (run.object, run.seed) == (unit.object, unit.seed)
        and (run.tolerance_m is None or np.isclose(run.tolerance_m, unit.share * run.size_m))
    }
    return there >= set(unit.methods)


def _make_runs(file: RunsFile, units: Sequence[methods.Unit]) -> Iterator[str]:
    """Make the runs of units, keep each, and say so; what is finished stays after Ctrl-C."""
    if not units:
        return
    with get_context("forkserver").Pool(min(PROCESSES, len(units)), _ignore_interrupts) as pool:
        for number, made in enumerate(pool.imap_unordered(methods.runs_of, units), 1):
            file.add(made)
            ends = ", ".join(_told(run) for run in made)
            first = made[0]
            yield f"{number} of {len(units)}: {first.object}, seed {first.seed}: {ends}"


def _ignore_interrupts() -> None:
    """The first process ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _told(run: Run) -> str:
    if not run.curve:
        return f"{run.method} FAILED: {run.failed}"
    return f"{run.method} {100 * run.error:.3f} % in {run.curve[-1].touches}"


def sheet_rows(runs: Sequence[Run]) -> Iterator[Row]:
    """Medians and shares of every method, and what is demanded of ours."""
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
        some = [r for r in runs if f"{100 * (r.tolerance_m or 0) / r.size_m:.3g}" == share]
        lasts = [run.curve[-1] for run in some]
        touches, robot, compute = (
            float(np.median([one.cost(which) for one in lasts]))
            for which in ("touches", "robot", "compute")
        )
        error = 100.0 * float(np.median([run.error for run in some]))
        title = f"{name}, {'to its end' if share == '0' else f'asked for {share} %'}"
        shown = f"{error:.3f} %, {touches:.0f}, {robot:.0f} s, {compute:.0f} s"
        yield Row(f"{title}: rms, touches, robot, processor", shown)
        if finals := [run.final for run in some if run.final is not None]:
            yield Row(f"{title}: two-way sum, F at 1 and 5 mm", _told_finals(finals))
    stages: dict[str, list[float]] = {}
    for run in runs:
        for count, touched in (run.final.touched_5mm if run.final else {}).items():
            stages.setdefault(count, []).append(touched)
    told = [f"{count}: {np.median(stages[count]):.0%}" for count in sorted(stages, key=int)]
    if told:
        yield Row(f"{name}: surface within 5 mm of a touch", ", ".join(told))
    costs = np.concatenate([*statistics.target_costs(entries, "touches").values()])
    yield figure(f"{name}: targets reached", float(np.isfinite(costs).mean()), ".0%")
    if len(pairs := statistics.stated_and_true(entries)):
        held = statistics.held_share(pairs)
        yield figure(f"{name}: bound of 95 % held, of {len(pairs)}", held, ".0%")


def _told_finals(finals: Sequence[Final]) -> str:
    summed, near, far = (
        float(np.median([getattr(one, field) for one in finals]))
        for field in ("chamfer_sum_m", "f_score_1mm", "f_score_5mm")
    )
    return f"{1e3 * summed:.3f} mm, {near:.3f}, {far:.3f}"


def _demand_rows(table: statistics.Table) -> Iterator[Row]:
    ours, strict = table[methods.OURS], statistics.TARGETS[statistics.TARGETS < STRICT]
    for name, entries in table.items():
        if name == methods.OURS:
            continue
        worse = [
            target
            for target in strict.tolist()
            if not statistics.dominated_at(
                *(
                    statistics.target_costs(one, "touches", np.array([target]))
                    for one in (ours, entries)
                )
            )
        ]
        where = f" (not at {', '.join(f'{100 * one:.2g}' for one in worse)} %)" if worse else ""
        yield Row(
            f"palpate dominates {name} at targets below {100 * STRICT:g} %",
            *(f"{len(strict) - len(worse)} of {len(strict)}{where}", "all", not worse),
        )
    if len(pairs := statistics.stated_and_true(ours)):
        held = statistics.held_share(pairs)
        yield at_least("palpate: bound of 95 % holds", held, LEAST_HELD, ".0%")
    smooth = {entry: runs for entry, runs in ours.items() if entry[0] in SMOOTH}
    if smooth:
        costs = statistics.target_costs(smooth, "touches", np.array([MIDDLE]))
        most = max(float(np.median(one)) for one in costs.values())
        title = f"{100 * MIDDLE:g} % on {len(costs)} smooth objects: touches, most"
        yield at_most(title, most, MOST_MIDDLE, ".0f")
    ratios = [_loose_over_strict(runs) for runs in ours.values()]
    title = f"touches at {100 * SHARES[0]:g} % over those at {100 * SHARES[-1]:g} %, median"
    yield at_most(title, float(np.median(ratios)), MOST_LOOSE, ".2f")


def _loose_over_strict(runs: Sequence[Run]) -> float:
    asked = sorted((run for run in runs if run.curve), key=lambda run: run.tolerance_m or 0.0)
    return asked[-1].curve[-1].touches / asked[0].curve[-1].touches if asked else float("inf")
