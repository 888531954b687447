"""What benches measured, in a file; and what moved between two such files beyond noise.

A figure has moved if the ranges of its repeats do not meet. Where it was measured once, a rule
stands for them: counts are exact, times move by 10 %, anything else by 2 %, and what is known only
as it was printed also by half of its last digit. Times of two machines say nothing of palpate, and
are not compared.
"""

from __future__ import annotations

import importlib.util
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from palpate import __version__
from palpate.bench.table import Figure, Kind, Measured
from palpate.launch.files import InputError, read_bounded, write_atomically

FORM, VERSION = "palpate bench", 1
MOST_BYTES = 64 * 2**20
NOISE: Mapping[Kind, float] = {"time": 0.10, "count": 0.0, "error": 0.02}  # Shares of the value
SMALLER_IS_BETTER = ("s", "ms", "us", "ns", "m", "mm", "um", "deg", "% of height")
SKIPPED = "are times of another machine, not compared"
Verdict = Literal["better", "worse", "moved"]


@dataclass(frozen=True, slots=True)
class Machine:
    """Where it was measured."""

    cpu: str  # Model of the processor
    cores: int
    python: str
    packages: Mapping[str, str]  # Versions by name
    blas: str
    load: float  # Of the last minute as it began: processes that wanted to run

    @property
    def same_speed_as(self) -> tuple[str, int]:
        """What two machines must share so that their times may be compared."""
        return self.cpu, self.cores


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """What one call of ``palpate bench`` measured."""

    form: str
    version: int
    palpate: str
    date: str  # As it began, ISO 8601
    quick: bool
    machine: Machine
    absent: tuple[str, ...]  # Peers that are not installed
    lines: tuple[Measured, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict)  # Why, by group


def begin_results(*, quick: bool, peers: Mapping[str, str]) -> Results:
    """Results without a line; `peers` are packages by name with what they are measured for."""
    absent = (f"{name} ({what})" for name, what in peers.items() if not _is_installed(name))
    date = datetime.now(UTC).isoformat(timespec="seconds")
    return Results(
        form=FORM, version=VERSION, palpate=__version__, date=date, quick=quick,
        machine=this_machine(), absent=tuple(absent),
    )  # fmt: skip


class ResultsFile:
    """Results as they come in, written anew after each group if there is a place for them."""

    def __init__(self, results: Results, path: Path | None) -> None:
        self.results = results
        self._path = path

    def add(self, group: str, lines: Sequence[Measured], failure: str) -> None:
        """Keep what a group measured, and why it failed or nothing."""
        failed = {group: failure} if failure else {}
        self.results = replace(
            self.results,
            lines=(*self.results.lines, *lines),
            failed={**self.results.failed, **failed},
        )
        if self._path is not None:
            text = msgspec.json.format(msgspec.json.encode(self.results), indent=1)
            write_atomically({self._path: lambda part: part.write_bytes(text)})


def _is_installed(package: str) -> bool:
    return importlib.util.find_spec(package) is not None


def this_machine() -> Machine:
    """The machine that this runs on, and what it calculates with."""
    import numpy as np  # noqa: F401  # whose library of linear algebra is looked for
    from threadpoolctl import threadpool_info

    found = (one for one in threadpool_info() if one["user_api"] == "blas")
    blas = sorted({f"{one['internal_api']} {one['version']}" for one in found})
    packages = {name: version(name) for name in ("numpy", "scipy")}
    load = os.getloadavg()[0]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return Machine(
        _cpu(), cores or 1, platform.python_version(), packages, ", ".join(blas), round(load, 2)
    )


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:  # not of Linux
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def read_results(path: Path, *, quick: bool) -> Results:
    """Earlier results to compare with; raises InputError if they are none, or of another kind."""
    data = read_bounded(path, MOST_BYTES, "the results ")
    try:
        head = msgspec.json.decode(data)
        if not isinstance(head, dict) or head.get("form") != FORM:
            raise InputError(f"{path}: holds no results of palpate bench --out")
        if head.get("version") != VERSION:
            raise InputError(
                f"{path}: holds results of version {head.get('version')!r}; this palpate compares "
                f"version {VERSION}: measure them anew"
            )
        found = msgspec.convert(head, Results)
    except msgspec.MsgspecError as error:
        raise InputError(f"{path}: holds no results of palpate bench --out: {error}") from None
    if found.quick != quick:
        how = "with --quick" if found.quick else "without --quick"
        raise InputError(f"{path}: was measured {how}; measure as it was to compare")
    return found


class Move(NamedTuple):
    """A figure that differs by more than noise."""

    verdict: Verdict
    line: Measured  # As it is now
    old: Figure
    new: Figure

    def __str__(self) -> str:
        old, new = (_shown(one) for one in (self.old, self.new))
        name = f"{self.line.name}{', ' if self.new.name else ''}{self.new.name}"
        share = ""
        if self.old.value and self.new.value is not None:
            share = f" ({self.new.value / self.old.value - 1.0:+.1%})"
        missed = "" if self.line.holds else "  MISSED"
        return f"{self.verdict:<7} {self.line.group}: {name}: {old} -> {new}{share}{missed}"


def _shown(one: Figure) -> str:
    value = "not finite" if one.value is None else f"{one.value:.6g}"
    return f"{value} {one.unit}".rstrip()


class Comparison(NamedTuple):
    """Two results beside each other; figures that only one of them has are counted."""

    moves: tuple[Move, ...]
    unmoved: int
    skipped: int  # Times of another machine
    gone: int  # Only in the old ones, of groups that were measured now
    fresh: int


def compare_results(old: Results, new: Results) -> Comparison:
    """What moved beyond noise in the groups that were measured now."""
    groups = {line.group for line in new.lines}
    before = _by_name(line for line in old.lines if line.group in groups)
    now = _by_name(new.lines)
    same_speed = old.machine.same_speed_as == new.machine.same_speed_as
    moves, unmoved, skipped = list[Move](), 0, 0
    for key in before.keys() & now.keys():
        (_, first), (line, second) = before[key], now[key]
        if not same_speed and "time" in (first.kind, second.kind):
            skipped += 1
        elif has_moved(first, second):
            moves.append(Move(_verdict(line, first, second), line, first, second))
        else:
            unmoved += 1
    moves.sort(key=lambda one: (one.verdict != "worse", one.verdict, one.line.group, one.line.name))
    gone, fresh = (len(a.keys() - b.keys()) for a, b in ((before, now), (now, before)))
    return Comparison(tuple(moves), unmoved, skipped, gone, fresh)


def _by_name(
    lines: Iterable[Measured],
) -> dict[tuple[str, str, int, int], tuple[Measured, Figure]]:
    """Figures by group, name, how often the name came before, and place in the line."""
    found: dict[tuple[str, str, int, int], tuple[Measured, Figure]] = {}
    for line in lines:
        turn = 0
        while (line.group, line.name, turn, 0) in found:
            turn += 1
        for place, one in enumerate(line.figures):
            found[line.group, line.name, turn, place] = line, one
    return found


def has_moved(old: Figure, new: Figure) -> bool:
    """Whether a figure differs by more than noise."""
    if old.value is None or new.value is None or old.unit != new.unit:
        return (old.value, old.unit) != (new.value, new.unit)
    noise = old.spread + new.spread
    if not (old.repeated and new.repeated):
        noise += NOISE[new.kind] * max(abs(old.value), abs(new.value))
    return abs(new.value - old.value) > noise * (1.0 + 1e-9)


def _verdict(line: Measured, old: Figure, new: Figure) -> Verdict:
    """Better or worse where the demand or the unit tells which way is which."""
    if old.value is None or new.value is None or old.unit != new.unit:
        return "moved"
    more = new.value > old.value
    if line.target[:1] == ">" or (line.target[:1] != "<" and new.unit == "/s"):
        return "better" if more else "worse"
    if line.target[:1] == "<" or new.unit in SMALLER_IS_BETTER:
        return "worse" if more else "better"
    return "moved"


def comparison_lines(old: Results, new: Results, where: Path) -> Iterator[str]:
    """What moved, worse first, and how much did not."""
    found = compare_results(old, new)
    yield f"compared with {where}: palpate {old.palpate}, {old.date}, {old.machine.cpu}"
    yield from map(str, found.moves)
    words: Sequence[tuple[int, str]] = (
        (len(found.moves), "moved beyond noise"),
        (found.unmoved, "did not"),
        (found.fresh, "are new"),
        (found.gone, "are gone"),
        (found.skipped, SKIPPED),
    )
    told = (f"{count} {what}" for count, what in words if count or what != SKIPPED)
    yield "figures: " + ", ".join(told)
