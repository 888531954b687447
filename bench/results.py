"""Results of benches in a file, and the figures that changed between two such files.

A figure has changed if the ranges of its repeats do not overlap. For a figure measured once a rule
replaces them: counts are exact, times vary by 10 %, anything else by 2 %, and a figure that is only
printed also by half of its last digit. Times of different or busy machines are not compared.
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
MAX_BYTES = 64 * 2**20  # Of a file
SMALLER_IS_BETTER = ("s", "ms", "us", "ns", "m", "mm", "um", "deg", "% of height")
Verdict = Literal["worse", "better", "moved"]
Content = TypeVar("Content")


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonSettings:
    """When a figure has changed."""

    time_noise: float = 0.10  # [fraction of the value] of a time measured once
    error_noise: float = 0.02  # [fraction of the value] of any other size measured once
    min_change: float = 1e-12  # in any unit: smaller changes are rounding
    max_load: float = 0.75  # processes ready to run / cores; above it times are not compared

    def noise_of(self, kind: Kind) -> float:
        """Noise as a fraction of the value of a figure measured once; counts are exact."""
        return {"time": self.time_noise, "count": 0.0, "error": self.error_noise}[kind]


DEFAULT_COMPARISON = ComparisonSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """Results of one call of ``palpate bench``."""

    form: str
    version: int
    palpate: str
    date: str  # Of its start, ISO 8601
    quick: bool
    machine: Mapping[str, Any]  # As `this_machine` returns it
    lines: tuple[Measured, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict)  # Reason, by group


class ResultsFile:
    """Collects results; rewrites their file after each group, if there is a path."""

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
        """Add the rows of a group, and the reason of its failure or an empty string."""
        failed = {**self.results.failed, **({group: failure} if failure else {})}
        self.results = replace(self.results, lines=(*self.results.lines, *lines), failed=failed)
        if self._path is not None:
            write_form(self._path, self.results)


def this_machine() -> dict[str, Any]:
    """Describe this machine, its numerical libraries, and its load."""
    import numpy as np  # noqa: F401  # so that its library of linear algebra is loaded
    from threadpoolctl import threadpool_info

    libraries = (library for library in threadpool_info() if library["user_api"] == "blas")
    blas = {f"{library['internal_api']} {library['version']}" for library in libraries}
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count() or 1,
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
        "blas": ", ".join(sorted(blas)),
        "load": round(os.getloadavg()[0], 2),  # Processes ready to run, mean over the last minute
    }


def _cpu() -> str:
    with suppress(OSError, StopIteration):  # other systems than Linux
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(x.partition(":")[2].strip() for x in lines if x.startswith("model name"))
    return platform.processor() or platform.machine()


def read_results(path: Path, *, quick: bool) -> Results:
    """Read results; raises InputError if the file holds none, or `quick` differs."""
    results = read_form(path, FORM, VERSION, Results)
    if results.quick != quick:
        how = "with --quick" if results.quick else "without --quick"
        raise InputError(f"{path}: was measured {how}; measure as it was to compare")
    return results


def write_form(path: Path, content: object) -> None:
    """Write a JSON file that `read_form` reads, whole or not at all."""
    text = msgspec.json.format(msgspec.json.encode(content), indent=1)
    write_atomically({path: lambda part: part.write_bytes(text)})


def read_form(path: Path, form: str, version: int, kind: type[Content]) -> Content:
    """Content of a JSON file; raises InputError if it has another form or version."""
    data = read_bounded(path, MAX_BYTES, "the results ")
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


class Change(NamedTuple):
    """A figure that differs by more than noise."""

    verdict: Verdict
    line: Measured  # Of the new results
    old: Figure
    new: Figure

    def __str__(self) -> str:
        old, new = self.old, self.new
        name = ", ".join(filter(None, (self.line.name, new.name)))
        then, now = (
            f"{'not finite' if side.value is None else f'{side.value:.6g}'} {side.unit}".rstrip()
            for side in (old, new)
        )
        text = f"{self.verdict:<7} {self.line.group}: {name}: {then} -> {now}"
        if old.value and new.value is not None:
            text += f" ({new.value / old.value - 1.0:+.1%})"
        return text if self.line.holds else f"{text}  MISSED"


def compare_results(
    old: Results, new: Results, settings: ComparisonSettings = DEFAULT_COMPARISON
) -> tuple[list[Change], dict[str, int]]:
    """Changes beyond noise in the groups of the new results, worse ones first, and counts."""
    groups = {line.group for line in new.lines}
    before, now = _by_name(line for line in old.lines if line.group in groups), _by_name(new.lines)
    changes, skipped = list[Change](), 0
    machine, earlier = new.machine, old.machine
    is_same = all(machine[key] == earlier[key] for key in ("cpu", "cores"))
    is_idle = max(machine["load"], earlier["load"]) <= settings.max_load * machine["cores"]
    for key in before.keys() & now.keys():
        (_, first), (line, second) = before[key], now[key]
        if not (is_same and is_idle) and "time" in (first.kind, second.kind):
            skipped += 1
        elif has_changed(first, second, settings):
            changes.append(Change(_verdict(line, first, second), line, first, second))
    changes.sort(key=lambda c: (c.verdict != "worse", c.verdict, c.line.group, c.line.name))
    return changes, {
        "moved beyond noise": len(changes),
        "did not": len(before.keys() & now.keys()) - len(changes) - skipped,
        "are new": len(now.keys() - before.keys()),
        "are gone": len(before.keys() - now.keys()),
        "are times of another or of a busy machine, not compared": skipped,
    }


def _by_name(lines: Iterable[Measured]) -> dict[tuple[str, str, int, int], tuple[Measured, Figure]]:
    """Figures by group, name, number of earlier rows of that name, and index in the row."""
    repeats, figures = Counter[tuple[str, str]](), {}
    for line in lines:
        repeat = repeats[line.group, line.name]
        repeats[line.group, line.name] += 1
        for i, figure in enumerate(line.figures):
            figures[line.group, line.name, repeat, i] = line, figure
    return figures


def has_changed(
    old: Figure, new: Figure, settings: ComparisonSettings = DEFAULT_COMPARISON
) -> bool:
    """Whether a figure differs by more than noise."""
    if old.value is None or new.value is None or old.unit != new.unit:
        return (old.value, old.unit) != (new.value, new.unit)
    noise = old.spread + new.spread + settings.min_change
    if not (old.repeated and new.repeated):
        noise += settings.noise_of(new.kind) * max(abs(old.value), abs(new.value))
    return abs(new.value - old.value) > noise


def _verdict(line: Measured, old: Figure, new: Figure) -> Verdict:
    """Better or worse, if the demand or else the unit says which; otherwise moved."""
    if old.value is None or new.value is None or old.unit != new.unit:
        return "moved"
    smaller = line.target.startswith("<") or new.unit in SMALLER_IS_BETTER
    if line.target.startswith(">") or (new.unit == "/s" and not smaller):
        return "better" if new.value > old.value else "worse"
    return "moved" if not smaller else "worse" if new.value > old.value else "better"


def comparison_lines(old: Results, new: Results, where: Path) -> Iterator[str]:
    """Changes, worse ones first, and counts."""
    changes, counts = compare_results(old, new)
    machine, now = old.machine, new.machine
    loads = f"{machine['cpu']}, a load of {machine['load']} then and {now['load']} now"
    yield f"compared with {where}: palpate {old.palpate}, {old.date}, {loads}"
    yield from map(str, changes)
    yield "figures: " + ", ".join(f"{count} {what}" for what, count in counts.items() if count)
