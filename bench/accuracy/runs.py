"""Runs in a file: the error of each model of an exploration, and what it costs.

docs/benchmark.md describes the format for those who write it with other programs.
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
# Sources on which runs depend, in a checkout.
SOURCES = (
    *("core", "messages", "nodes", "launch", "bench/loop.py"),
    *("bench/harness.py", "bench/explored.py"),
    *("bench/accuracy/gp_explorer.py", "bench/accuracy/methods.py"),
)
Cost = Annotated[float, Meta(ge=0.0)]
Length = Annotated[float, Meta(ge=0.0)]  # m
Name = Annotated[str, Meta(min_length=1, max_length=300)]


class Point(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Error and cost of a model."""

    touches: Annotated[int, Meta(ge=0)]  # Of all fingers, without those of a grasp
    robot_time_s: Cost  # With the time of the grasp
    compute_s: Cost  # Of one processor, without scoring
    rms_m: Length  # Root mean square distance, as in docs/distances.md
    chamfer_m: Length  # Mean of the two one-way mean distances
    bound_m: Length | None = None  # Stated bound of `rms_m`; null without one

    def cost(self, which: str) -> float:
        """The cost that `which` names: ``touches``, ``robot`` or ``compute``."""
        return {"touches": self.touches, "robot": self.robot_time_s}.get(which, self.compute_s)


class Final(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Figures of the last model as other papers give them."""

    chamfer_sum_m: Length  # Sum of the two one-way mean distances
    f_score_1mm: Annotated[float, Meta(ge=0.0, le=1.0)]  # Harmonic mean of precision and recall
    f_score_5mm: Annotated[float, Meta(ge=0.0, le=1.0)]
    # Share of the true surface within 5 mm of a touched point, by the number of touches.
    touched_5mm: Mapping[str, Annotated[float, Meta(ge=0.0, le=1.0)]] = {}


class Run(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One exploration; its last point is that of its last model."""

    method: Name
    object: Name
    seed: int
    tolerance_m: Annotated[float, Meta(gt=0.0)] | None  # null if the method takes none
    size_m: Annotated[float, Meta(gt=0.0)]  # Height of the object
    sampling_floor_m: Length
    curve: tuple[Point, ...]  # In the order of the models; empty for a failed run
    final: Final | None
    failed: str = ""  # Reason, for a failed run

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
        """Unique in a file: method, object, seed, and tolerance in um."""
        tolerance = None if self.tolerance_m is None else round(1e6 * self.tolerance_m, 3)
        return self.method, self.object, self.seed, tolerance

    @property
    def error(self) -> float:
        """Root mean square error of the last model over the height; infinite without a model."""
        return self.curve[-1].rms_m / self.size_m if self.curve else float("inf")


class Runs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All runs of a file."""

    form: str  # `FORM`
    version: int  # `VERSION`
    methods: Mapping[Name, str]  # A sentence about each
    runs: tuple[Run, ...]
    machine: Mapping[str, Any] = {}
    absent: tuple[str, ...] = ()  # Methods that were not installed
    sources: str = ""  # Digest of palpate's sources


def read_runs(path: Path) -> Runs:
    """The runs in a file; raises InputError if it holds none, or of another version."""
    content = read_form(path, FORM, VERSION, Runs)
    keys = [run.key for run in content.runs]
    if len(set(keys)) < len(keys):
        double = next(key for key in keys if keys.count(key) > 1)
        raise InputError(f"{path}: has the run {double} more than once")
    for run in content.runs:
        if run.method not in content.methods:
            raise InputError(f"{path}: {run.method!r} has runs but is missing in methods")
    return content


class RunsFile:
    """Runs as they are made; rewrites their file after each addition, and keeps earlier runs.

    Raises InputError if the earlier runs were made by other sources of palpate.
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
        """Add runs, and write the file."""
        self.content = msgspec.structs.replace(self.content, runs=(*self.content.runs, *made))
        write_form(self.path, self.content)


def check_sources(path: Path, sources: str) -> None:
    """Raise InputError if the digest of a file's runs is not that of these sources."""
    if sources != sources_digest():
        raise InputError(
            f"{path}: was measured with another palpate; name another folder with --sheet, or "
            "remove the file"
        )


def sources_digest() -> str:
    """SHA-256 of all sources on which runs depend."""
    digest, root = hashlib.sha256(), Path(__file__).parents[2]
    for place in SOURCES:
        top = root / place
        for path in sorted(top.rglob("*.py")) if top.is_dir() else [top]:
            digest.update(path.read_bytes())
    return digest.hexdigest()
