"""Runs in a file: the error of each model on the way, against what it took.

docs/benchmark.md tells the format to those who write it with other programs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from palpate.bench.results import read_form, this_machine, write_form
from palpate.launch.files.source_map import InputError

FORM, VERSION = "palpate tolerance", 1
# What the runs depend on, in a checkout.
SOURCES = (
    *("core", "messages", "nodes", "launch", "bench/loop.py"),
    *("bench/harness.py", "bench/explored.py"),
    *("bench/accuracy/gp_explorer.py", "bench/accuracy/methods.py"),
)
Cost = Annotated[float, Meta(ge=0.0)]
Length = Annotated[float, Meta(ge=0.0)]  # m
Name = Annotated[str, Meta(min_length=1, max_length=300)]


class Point(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A model on the way, and what it took."""

    touches: Annotated[int, Meta(ge=0)]  # Of all fingers, those of a grasp apart
    robot_time_s: Cost  # Grasp included
    compute_s: Cost  # Of one processor, without scoring
    rms_m: Length  # Root mean square distance, as in docs/distances.md
    chamfer_m: Length  # Mean of the two one-way mean distances
    bound_m: Length | None = None  # What the method states of `rms_m`; null if nothing

    def cost(self, which: str) -> float:
        """Touches, or seconds of robot or computer: what its name begins with says which."""
        return {"touches": self.touches, "robot": self.robot_time_s}.get(which, self.compute_s)


class Final(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What other papers print of the last model."""

    chamfer_sum_m: Length  # Sum of the two one-way mean distances
    f_score_1mm: Annotated[float, Meta(ge=0.0, le=1.0)]  # Harmonic mean of precision and recall
    f_score_5mm: Annotated[float, Meta(ge=0.0, le=1.0)]
    # Share of the true surface within 5 mm of a touched point, by the number of touches.
    touched_5mm: Mapping[str, Annotated[float, Meta(ge=0.0, le=1.0)]] = {}


class Run(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One exploration; its last point is what it ended with."""

    method: Name
    object: Name
    seed: int
    tolerance_m: Annotated[float, Meta(gt=0.0)] | None  # That was asked for; null: it takes none
    size_m: Annotated[float, Meta(gt=0.0)]  # Height of the object
    sampling_floor_m: Length
    curve: tuple[Point, ...]  # In the order made; none of a run that failed
    final: Final | None
    failed: str = ""  # Why, if it did

    def __post_init__(self) -> None:
        for before, after in zip(self.curve, self.curve[1:], strict=False):
            for which in ("touches", "robot", "compute"):
                if after.cost(which) < before.cost(which):
                    raise ValueError(
                        f"the curve of {self.method} on {self.object} must not become cheaper, "
                        f"got {after.cost(which):g} {which} after {before.cost(which):g}"
                    )

    @property
    def key(self) -> tuple[str, str, int, float | None]:
        """What no other run of a file shares: method, object, seed, tolerance in um."""
        asked = self.tolerance_m
        return self.method, self.object, self.seed, None if asked is None else round(1e6 * asked, 3)

    @property
    def error(self) -> float:
        """Root mean square error of the last model over the height; infinite if there is none."""
        return self.curve[-1].rms_m / self.size_m if self.curve else float("inf")


class Runs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All runs of a file."""

    form: str
    version: int
    methods: Mapping[Name, str]  # What each is, in a sentence
    runs: tuple[Run, ...]
    machine: Mapping[str, Any] = {}
    absent: tuple[str, ...] = ()  # Methods that were not to be had
    sources: str = ""  # Digest of the palpate that explored


def read_runs(path: Path) -> Runs:
    """The runs in a file; raises InputError if it holds none, or of another version."""
    found = read_form(path, FORM, VERSION, Runs)
    keys = [one.key for one in found.runs]
    if len(set(keys)) < len(keys):
        double = next(key for key in keys if keys.count(key) > 1)
        raise InputError(f"{path}: has the run {double} more than once")
    for one in found.runs:
        if one.method not in found.methods:
            raise InputError(f"{path}: methods says nothing of {one.method!r}, which has runs")
    return found


class RunsFile:
    """Runs as they are made, written anew after each few; those that are there already are kept.

    Raises InputError if what is there was explored by other sources of palpate.
    """

    def __init__(self, path: Path, methods: Mapping[str, str], absent: Iterable[str]) -> None:
        self.path = path
        head = Runs(FORM, VERSION, methods, (), this_machine(), tuple(absent), sources_digest())
        if path.exists():
            old = read_runs(path)
            check_sources(path, old.sources)
            head = msgspec.structs.replace(head, methods={**old.methods, **methods}, runs=old.runs)
        self.content = head

    def add(self, made: Iterable[Run]) -> None:
        """Keep some more."""
        self.content = msgspec.structs.replace(self.content, runs=(*self.content.runs, *made))
        write_form(self.path, self.content)


def check_sources(path: Path, sources: str) -> None:
    """Refuse a file of runs of other sources than these; raises InputError."""
    if sources != sources_digest():
        raise InputError(
            f"{path}: was measured with another palpate; name another folder with --sheet, or "
            "remove the file"
        )


def sources_digest() -> str:
    """SHA-256 of everything that explores."""
    digest, root = hashlib.sha256(), Path(__file__).parents[2]
    for place in SOURCES:
        top = root / place
        for path in sorted(top.rglob("*.py")) if top.is_dir() else [top]:
            digest.update(path.read_bytes())
    return digest.hexdigest()
