"""A sweep file: which explorations are made, each checked whole before the first one starts."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path
from typing import Annotated, Any, TypeVar

from msgspec import Meta, Struct, field

from palpate import __version__
from palpate.launch.demand import read_demand
from palpate.launch.files.source_map import InputError, SourceMapped, hint
from palpate.launch.files.yaml_file import convert, read_yaml
from palpate.launch.graph import plain_params
from palpate.launch.launch_source import EXPLORE
from palpate.launch.run import Plan, check_run, plan_run
from palpate.launch.scene import find_scene
from palpate.nodes.runtime.node import RECORDER, Wiring
from palpate.nodes.specs.objects import Seed

MOST_RUNS = 10_000  # Of a sweep; each is checked before the first starts, which takes some 25 ms
MOST_LETTERS = 80  # Of a run's name, before the mark that tells it from all others
MARK = 12  # Hexadecimal digits of that
# What may be named without a dot: an argument of the launch file, and demands with their units.
FINGERS, DEMANDS = "fingers", ("tolerance", "feature", "budget")
Settings = Mapping[str, SourceMapped]
Item = TypeVar("Item")
Several = Annotated[list[Item], Meta(min_length=1)]


class SweepSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that a sweep file may hold."""

    scene: (
        str | Several[str]
    )  # A shipped scene's name or a file, as on the command line; or several
    # So many, from 0, or which ones; the scene's own if left out.
    seeds: Annotated[int, Meta(ge=1, le=MOST_RUNS)] | Several[Seed] | None = None
    grid: dict[str, Several[Any]] = {}  # By ``node.param`` or ``scene.path``; all combinations run
    # Or these combinations, one after the other, each with all of the grid.
    combinations: list[dict[str, Any]] = field(default_factory=list, name="list")


@dataclass(frozen=True, slots=True)
class SweepRun:
    """One exploration of a sweep, checked."""

    mark: str  # Tells its resolved parameters, and palpate's version, from all others
    name: str  # For people; ends with the mark
    asked: Mapping[str, Any]  # Scene, parameters by name, seed
    args: Settings
    settings: Settings

    def plan(self, folder: Path) -> Plan:
        """The run, ready to be performed into a folder, which must be new or empty."""
        return plan_run(EXPLORE, self.args, self.settings, name=self.name, out=folder)


@dataclass(frozen=True, slots=True)
class Sweep:
    """A checked sweep."""

    name: str  # The file's name without its suffix
    text: str  # The file's text
    runs: tuple[SweepRun, ...]  # In the order of the file, seeds innermost
    repeated: int  # Combinations that are the same run as an earlier one


def read_sweep(path: Path, *, record: bool = True) -> Sweep:
    """The sweep in a YAML file; `record` keeps the messages of each run.

    Raises InputError, with file and line, if anything is wrong with any of its runs.
    """
    given = read_yaml(path)
    spec = convert(given, SweepSpec)
    scenes = [given.part(("scene",))] if isinstance(spec.scene, str) else _items(given, "scene")
    numbers = range(spec.seeds) if isinstance(spec.seeds, int) else spec.seeds
    seeds = [SourceMapped(number, given.place(("seeds",))) for number in numbers or ()]
    asked = (
        (scene, settings, seed)
        for scene in scenes
        for settings in _combinations(given, spec)
        for seed in seeds or (None,)
    )
    listed = list(islice(asked, MOST_RUNS + 1))
    if len(listed) > MOST_RUNS:
        raise given.error((), f"has more than {MOST_RUNS} runs, the most that are made")
    runs: dict[str, SweepRun] = {}
    for each in listed:
        run = _checked(*each, record=record)
        runs.setdefault(run.mark, run)
    text = path.read_text(encoding="utf-8")
    return Sweep(path.stem, text, tuple(runs.values()), len(listed) - len(runs))


def _items(given: SourceMapped, *path: str) -> list[SourceMapped]:
    """What stands in the list at a path."""
    return [given.part((*path, i)) for i in range(len(given.part(path).value))]


def _combinations(given: SourceMapped, spec: SweepSpec) -> Iterator[Settings]:
    """What each entry of the list says, with every combination of the grid's other parameters."""
    listed = _items(given, "list") if spec.combinations else []
    entries = [{key: one.part((key,)) for key in one.value} for one in listed] or [{}]
    for key in spec.grid:
        if all(key in entry for entry in entries):
            raise given.error(
                ("grid", key),
                f"every entry of list says {key}, so that the grid's values are never used; take "
                "it out of the grid, or add the entry {} to the list: the grid as it is",
            )
    grid = {key: _items(given, "grid", key) for key in spec.grid}
    for entry in entries:
        rest = {key: grid[key] for key in grid if key not in entry}
        for chosen in product(*rest.values()):
            yield {**dict(zip(rest, chosen, strict=True)), **entry}


def _checked(
    scene: SourceMapped, settings: Settings, seed: SourceMapped | None, *, record: bool
) -> SweepRun:
    """One run; InputError if it could not be started."""
    try:
        path = find_scene(scene.value)
    except InputError as error:
        raise scene.error((), str(error)) from None
    args = {"scene": SourceMapped(str(path), ""), "record": SourceMapped(record, "")}
    inner: dict[str, SourceMapped] = {}
    for name, value in settings.items():
        if name in DEMANDS:
            inner |= _demand(name, value)
        elif "." not in name and name != FINGERS:
            known = hint(name, (FINGERS, *DEMANDS))
            text = f"there is no parameter {name!r}; {known}; others are node.param or scene.path"
            raise value.error((), text)
        else:
            (args if name == FINGERS or name.startswith("scene.") else inner)[name] = value
    if seed is not None:
        args["seed"] = seed
    try:
        described, wirings = check_run(EXPLORE, args, inner, Path("run"))
    except InputError as error:
        raise InputError(_located(str(error), settings)) from None
    values = {name: value.value for name, value in settings.items()}
    values = {"scene": scene.value, **values, "seed": described.args["seed"]}
    mark = mark_of(wirings)
    return SweepRun(mark, f"{run_name(path.stem, values)}_{mark}", values, args, inner)


def _demand(name: str, value: SourceMapped) -> Settings:
    """A setting of the planner, as on the command line: ``tolerance: 0.2mm``."""
    tolerance, feature, budget = (str(value.value) if name == one else None for one in DEMANDS)
    try:
        found = read_demand(tolerance, feature, budget, None, None, None)
    except InputError as error:
        raise value.error((), str(error).removeprefix("--")) from None
    return {target: SourceMapped(one.value, value.source) for target, one in found.items()}


def _located(text: str, settings: Settings) -> str:
    """A complaint with the whole combination, and never at a line of the launch file."""
    if settings and text.startswith(str(EXPLORE)):
        text = f"{[*settings.values()][-1].source}: {text.partition(': ')[2]}"
    told = ", ".join(f"{name} {value.value}" for name, value in settings.items())
    return f"{text} (with {told})" if len(settings) > 1 else text


def mark_of(wirings: tuple[Wiring, ...]) -> str:
    """What tells a run's resolved parameters from all others: 12 digits of their SHA-256."""
    nodes = [one for one in wirings if one.module != RECORDER]
    kept = [(one.name, one.module, plain_params(one.params)) for one in nodes]
    text = json.dumps([__version__, kept], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:MARK]


def run_name(scene: str, values: Mapping[str, Any]) -> str:
    """A run's name for people, of letters that need no care in folders and links."""
    told = [f"{key.rpartition('.')[2]}-{value}" for key, value in values.items() if key != "scene"]
    return re.sub(r"[^A-Za-z0-9._-]+", "-", "_".join((scene, *told)))[:MOST_LETTERS]
