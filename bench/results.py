"""What benches measured, in a file; and what moved between two such files beyond noise.

A figure has moved if the ranges of its repeats do not meet. Where it was measured once, a rule
stands for them: counts are exact, times move by 10 %, anything else by 2 %, and what is known as
printed also by half of its last digit. Times of other or busy machines are not compared.
"""

from __future__ import annotations

import os
import platform
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import msgspec

from palpate import __version__
from palpate.bench.table import Figure, Kind, Measured
from palpate.launch.files.file_access import read_bounded, write_atomically
from palpate.launch.files.source_map import InputError

FORM, VERSION = "palpate bench", 1
MOST_BYTES = 64 * 2**20
NOISE: Mapping[Kind, float] = {"time": 0.10, "count": 0.0, "error": 0.02}  # Shares of the value
NEGLIGIBLE = 1e-12  # In any unit: what is less comes of rounding
BUSY = 0.75  # Load for each core from which times are doubtful
SMALLER_IS_BETTER = ("s", "ms", "us", "ns", "m", "mm", "um", "deg", "% of height")
Verdict = Literal["worse", "better", "moved"]
Kept = TypeVar("Kept")


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """What one call of ``palpate bench`` measured."""

    form: str
    version: int
    palpate: str
    date: str  # As it began, ISO 8601
    quick: bool
    machine: Mapping[str, Any]  # As `this_machine` tells it
    lines: tuple[Measured, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict)  # Why, by group


class ResultsFile:
    """Results as they come in, written anew after each group if there is a place for them."""

    def __init__(self, path: Path | None, *, quick: bool) -> None:
        self._path = path
        self.results = Results(
            form=FORM,
            version=VERSION,
            palpate=__version__,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            quick=quick,
            machine=this_machine(),
        )

    def add(self, group: str, lines: Sequence[Measured], failure: str) -> None:
        """Keep what a group measured, and why it failed or nothing."""
        failed = {**self.results.failed, **({group: failure} if failure else {})}
        self.results = replace(self.results, lines=(*self.results.lines, *lines), failed=failed)
        if self._path is not None:
            write_form(self._path, self.results)


def this_machine() -> dict[str, Any]:
    """The machine that this runs on, what it calculates with, and how busy it is."""
    import numpy as np  # noqa: F401  # whose library of linear algebra is looked for
    from threadpoolctl import threadpool_info

    found = (one for one in threadpool_info() if one["user_api"] == "blas")
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count() or 1,
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
        "blas": ", ".join(sorted({f"{one['internal_api']} {one['version']}" for one in found})),
        "load": round(os.getloadavg()[0], 2),  # Processes that wanted to run, in the last minute
    }


def _cpu() -> str:
    with suppress(OSError, StopIteration):  # not of Linux
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(x.partition(":")[2].strip() for x in lines if x.startswith("model name"))
    return platform.processor() or platform.machine()


def read_results(path: Path, *, quick: bool) -> Results:
    """Earlier results to compare with; raises InputError if they are none, or of another kind."""
    found = read_form(path, FORM, VERSION, Results)
    if found.quick != quick:
        how = "with --quick" if found.quick else "without --quick"
        raise InputError(f"{path}: was measured {how}; measure as it was to compare")
    return found


def write_form(path: Path, content: object) -> None:
    """Write a JSON file that `read_form` reads, whole or not at all."""
    text = msgspec.json.format(msgspec.json.encode(content), indent=1)
    write_atomically({path: lambda part: part.write_bytes(text)})


def read_form(path: Path, form: str, version: int, kind: type[Kept]) -> Kept:
    """What a JSON file keeps; raises InputError if it is of another form or version."""
    data = read_bounded(path, MOST_BYTES, "the results ")
    try:
        head = msgspec.json.decode(data)
        if not isinstance(head, dict) or head.get("form") != form:
            raise InputError(f"{path}: holds no results of {form}")
        if head.get("version") != version:
            raise InputError(
                f"{path}: holds results of version {head.get('version')!r}; this palpate reads "
                f"version {version}: measure them anew"
            )
        return msgspec.convert(head, kind)
    except msgspec.MsgspecError as error:
        raise InputError(f"{path}: holds no results of {form}: {error}") from None


class Move(NamedTuple):
    """A figure that differs by more than noise."""

    verdict: Verdict
    line: Measured  # As it is now
    old: Figure
    new: Figure

    def __str__(self) -> str:
        old, new = self.old, self.new
        name = ", ".join(filter(None, (self.line.name, new.name)))
        then, now = (
            f"{'not finite' if one.value is None else f'{one.value:.6g}'} {one.unit}".rstrip()
            for one in (old, new)
        )
        told = f"{self.verdict:<7} {self.line.group}: {name}: {then} -> {now}"
        if old.value and new.value is not None:
            told += f" ({new.value / old.value - 1.0:+.1%})"
        return told if self.line.holds else f"{told}  MISSED"


def compare_results(old: Results, new: Results) -> tuple[list[Move], dict[str, int]]:
    """What moved beyond noise in the groups that were measured now, and how much did what."""
    groups = {line.group for line in new.lines}
    before, now = _by_name(line for line in old.lines if line.group in groups), _by_name(new.lines)
    moves, skipped = list[Move](), 0
    mine, theirs = new.machine, old.machine
    timed = all(mine[key] == theirs[key] for key in ("cpu", "cores"))
    timed = timed and max(mine["load"], theirs["load"]) <= BUSY * mine["cores"]
    for key in before.keys() & now.keys():
        (_, first), (line, second) = before[key], now[key]
        if not timed and "time" in (first.kind, second.kind):
            skipped += 1
        elif has_moved(first, second):
            moves.append(Move(_verdict(line, first, second), line, first, second))
    moves.sort(key=lambda one: (one.verdict != "worse", one.verdict, one.line.group, one.line.name))
    return moves, {
        "moved beyond noise": len(moves),
        "did not": len(before.keys() & now.keys()) - len(moves) - skipped,
        "are new": len(now.keys() - before.keys()),
        "are gone": len(before.keys() - now.keys()),
        "are times of another or of a busy machine, not compared": skipped,
    }


def _by_name(lines: Iterable[Measured]) -> dict[tuple[str, str, int, int], tuple[Measured, Figure]]:
    """Figures by group, name, how often the name came before, and place in the line."""
    turns, found = Counter[tuple[str, str]](), {}
    for line in lines:
        turn = turns[line.group, line.name]
        turns[line.group, line.name] += 1
        for place, one in enumerate(line.figures):
            found[line.group, line.name, turn, place] = line, one
    return found


def has_moved(old: Figure, new: Figure) -> bool:
    """Whether a figure differs by more than noise."""
    if old.value is None or new.value is None or old.unit != new.unit:
        return (old.value, old.unit) != (new.value, new.unit)
    noise = old.spread + new.spread + NEGLIGIBLE
    if not (old.repeated and new.repeated):
        noise += NOISE[new.kind] * max(abs(old.value), abs(new.value))
    return abs(new.value - old.value) > noise


def _verdict(line: Measured, old: Figure, new: Figure) -> Verdict:
    """Better or worse where the demand, or else the unit, tells which way is which."""
    if old.value is None or new.value is None or old.unit != new.unit:
        return "moved"
    smaller = line.target.startswith("<") or new.unit in SMALLER_IS_BETTER
    if line.target.startswith(">") or (new.unit == "/s" and not smaller):
        return "better" if new.value > old.value else "worse"
    return "moved" if not smaller else "worse" if new.value > old.value else "better"


def comparison_lines(old: Results, new: Results, where: Path) -> Iterator[str]:
    """What moved, worse first, and how much did not."""
    moves, counts = compare_results(old, new)
    machine, now = old.machine, new.machine
    told = f"{machine['cpu']}, a load of {machine['load']} then and {now['load']} now"
    yield f"compared with {where}: palpate {old.palpate}, {old.date}, {told}"
    yield from map(str, moves)
    yield "figures: " + ", ".join(f"{count} {what}" for what, count in counts.items() if count)
