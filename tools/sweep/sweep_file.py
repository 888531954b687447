"""A sweep file: the explorations of a sweep, all checked before the first one starts."""

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

MAX_RUNS = 10_000  # of a sweep; checking takes about 25 ms for each
# Names without a dot: an argument of the launch file, and demands with their units.
FINGERS, DEMANDS = "fingers", ("tolerance", "feature", "budget")
Settings = Mapping[str, SourceMapped]
Item = TypeVar("Item")
Several = Annotated[list[Item], Meta(min_length=1)]


class SweepSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Contents of a sweep file."""

    scene: str | Several[str]  # names of shipped scenes, or files, as on the command line
    # Number of seeds, from 0, or a list of them; None: that of the scene.
    seeds: Annotated[int, Meta(ge=1, le=MAX_RUNS)] | Several[Seed] | None = None
    grid: dict[str, Several[Any]] = {}  # by ``node.param`` or ``scene.path``; all combinations
    # Single combinations, each with all of the grid.
    combinations: list[dict[str, Any]] = field(default_factory=list, name="list")


@dataclass(frozen=True, slots=True)
class SweepRun:
    """A checked exploration of a sweep."""

    mark: str  # hash of its resolved parameters and of palpate's version
    name: str  # for people; ends with the mark
    asked: Mapping[str, Any]  # scene, parameters by name, seed
    args: Settings
    settings: Settings

    def plan(self, folder: Path) -> Plan:
        """Plan of the run into a folder, which must be new or empty."""
        return plan_run(EXPLORE, self.args, self.settings, name=self.name, out=folder)


@dataclass(frozen=True, slots=True)
class Sweep:
    """A checked sweep."""

    name: str  # of the file, without suffix
    text: str  # of the file
    runs: tuple[SweepRun, ...]  # in the order of the file, seeds innermost
    repeated: int  # combinations that are the same run as an earlier one


def read_sweep(path: Path, *, record: bool = True) -> Sweep:
    """The sweep in a YAML file; `record`: whether the messages of each run are recorded.

    Raises InputError, with file and line, if a run is invalid.
    """
    source = read_yaml(path)
    spec = convert(source, SweepSpec)
    scenes = [source.part(("scene",))] if isinstance(spec.scene, str) else _items(source, "scene")
    numbers = range(spec.seeds) if isinstance(spec.seeds, int) else spec.seeds
    seeds = [SourceMapped(number, source.place(("seeds",))) for number in numbers or ()]
    asked = (
        (scene, settings, seed)
        for scene in scenes
        for settings in _combinations(source, spec)
        for seed in seeds or (None,)
    )
    listed = list(islice(asked, MAX_RUNS + 1))
    if len(listed) > MAX_RUNS:
        raise source.error((), f"has more than {MAX_RUNS} runs, the most that are made")
    runs: dict[str, SweepRun] = {}
    for combination in listed:
        run = _checked(*combination, record=record)
        runs.setdefault(run.mark, run)
    text = path.read_text(encoding="utf-8")
    return Sweep(path.stem, text, tuple(runs.values()), len(listed) - len(runs))


def _items(source: SourceMapped, *path: str) -> list[SourceMapped]:
    """Items of the list at a path."""
    return [source.part((*path, i)) for i in range(len(source.part(path).value))]


def _combinations(source: SourceMapped, spec: SweepSpec) -> Iterator[Settings]:
    """Each entry of the list with every combination of the other parameters of the grid."""
    listed = _items(source, "list") if spec.combinations else []
    entries = [{key: item.part((key,)) for key in item.value} for item in listed] or [{}]
    for key in spec.grid:
        if all(key in entry for entry in entries):
            raise source.error(
                ("grid", key),
                f"every entry of list says {key}, so that the grid's values are never used; take "
                "it out of the grid, or add the entry {} to the list: the grid as it is",
            )
    grid = {key: _items(source, "grid", key) for key in spec.grid}
    for entry in entries:
        rest = {key: grid[key] for key in grid if key not in entry}
        for chosen in product(*rest.values()):
            yield {**dict(zip(rest, chosen, strict=True)), **entry}


def _checked(
    scene: SourceMapped, settings: Settings, seed: SourceMapped | None, *, record: bool
) -> SweepRun:
    """One run; raises InputError if it cannot be started."""
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
    tolerance, feature, budget = (str(value.value) if name == d else None for d in DEMANDS)
    try:
        demand = read_demand(tolerance, feature, budget, None, None, None)
    except InputError as error:
        raise value.error((), str(error).removeprefix("--")) from None
    return {target: SourceMapped(d.value, value.source) for target, d in demand.items()}


def _located(text: str, settings: Settings) -> str:
    """An error text with the whole combination, without lines of the launch file."""
    if settings and text.startswith(str(EXPLORE)):
        text = f"{[*settings.values()][-1].source}: {text.partition(': ')[2]}"
    combination = ", ".join(f"{name} {value.value}" for name, value in settings.items())
    return f"{text} (with {combination})" if len(settings) > 1 else text


def mark_of(wirings: tuple[Wiring, ...], n_digits: int = 12) -> str:
    """Hash of the resolved parameters of a run: the first hexadecimal digits of their SHA-256."""
    nodes = [node for node in wirings if node.module != RECORDER]
    resolved = [(node.name, node.module, plain_params(node.params)) for node in nodes]
    text = json.dumps([__version__, resolved], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:n_digits]


def run_name(scene: str, values: Mapping[str, Any], max_letters: int = 80) -> str:
    """Name of a run for people, of letters that are safe in folders and links."""
    parts = [f"{key.rpartition('.')[2]}-{value}" for key, value in values.items() if key != "scene"]
    return re.sub(r"[^A-Za-z0-9._-]+", "-", "_".join((scene, *parts)))[:max_letters]
