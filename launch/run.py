"""One run: planned and checked whole, then performed into its run directory.

Nothing is started or written before everything has been checked: launch file, scene, parameters,
wiring, and whether sensor, fingers and object allow what is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import to_builtins

from palpate.core.archive import arrays_from_bytes
from palpate.core.explore import SURVEYING, GraspSettings
from palpate.core.explore.planners import Uniform, make_planner
from palpate.core.geometry import areas_and_normals
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.launch.demand import Demanded, demand_text, demanded_of
from palpate.launch.files.file_access import plain_name
from palpate.launch.files.mesh_file import MODEL_FILE, export_model
from palpate.launch.files.source_map import (
    InputError,
    SourceMapped,
    as_input_errors,
    key_path,
    set_within,
)
from palpate.launch.files.yaml_file import parse_yaml, yaml_text
from palpate.launch.forecast import SizeLimits, size_cost
from palpate.launch.graph import Graph, override, resolved_text
from palpate.launch.launch_file import LaunchDescription, describe
from palpate.launch.node_kinds import INPUTS, Entry, own_modules
from palpate.launch.printing import titled
from palpate.launch.processes.registry import EarlierRun
from palpate.launch.progress import GATHERED_TYPES, Display, ProgressWatcher
from palpate.launch.run_directory import (
    SUMMARY,
    RunDirectory,
    choose_run_directory,
    exit_code,
    read_summary,
    run_directory_of,
    summarise,
    versions_text,
)
from palpate.launch.summary_text import details_text, headline_text, run_lines
from palpate.messages.types import ShapeModel
from palpate.nodes import planner, simulator
from palpate.nodes.runtime.composed import Ending
from palpate.nodes.runtime.node import RECORDER, Wiring, with_description
from palpate.nodes.specs.objects import EXTENT_LEVEL, build_shape
from palpate.nodes.specs.sensors import build_pipeline, info_of, resolution_of_info

if TYPE_CHECKING:
    from palpate.core.rebuild import Solid

LOG = "log.jsonl"  # File of the run directory to which what nodes report is written
_PLUGIN = re.compile(r"[\w.]+:[A-Za-z_]\w*")  # ``module:Class``


@dataclass(frozen=True, slots=True)
class Plan:
    """A run that has passed every check and has left no trace yet."""

    name: str  # What tools call it
    wirings: tuple[Wiring, ...]  # The nodes, wired
    ends: str  # The node whose Finished ends the graph
    # What it tells of itself, text by name: launch file, scene, seed, versions.
    about: Mapping[str, str]
    folder: RunDirectory  # Where the results will be
    before: EarlierRun | None = None  # An earlier run, if it goes on with one
    # Files that the run needs to be run again, by their names in its folder.
    inputs: Mapping[str, Path] = field(default_factory=dict)
    demanded: Demanded | None = None  # What is asked of the planner; None if there is none
    asked: str = ""  # What is asked of it and what that is expected to cost, in lines


@dataclass(frozen=True, repr=False)
class Run:
    """What a run came to."""

    folder: Path  # The run directory
    ending: Ending  # How the graph ended
    summary: Mapping[str, Any]  # The figures, as in ``summary.json``
    model: ShapeModel | None  # The last model
    # 0 done, 1 the goal was missed, 3 a node died or all stood still, 130 interrupted.
    exit_code: int
    trace: Path | None = None  # File with the trace of what a node failed of, if one did

    def __repr__(self) -> str:
        """Five lines: what was found, its bound, what it cost, how it ended and where it lies."""
        summary = self.summary
        return "\n".join(
            (
                f"<Run of {summary['scene'] or self.folder.name}, {self.ending.status}",
                *run_lines(summary),
                f"  folder  {self.folder}>",
            )
        )

    @cached_property
    def solid(self) -> Solid | None:
        """The last model as a solid; None if nothing was rebuilt.

        A `LatticeSolid` or a `GeneralSolid` if the model is final; else, and of an exploratory
        procedure, a `MeshSolid`. Its final mesh is that of the model.
        """
        if self.model is None or not len(self.model.faces):
            return None
        from palpate.launch.files.solid_file import solid_of

        packed = self.model.archive
        arrays = arrays_from_bytes(packed) if len(packed) else {}
        return solid_of(arrays | {"vertices": self.model.vertices, "faces": self.model.faces})

    @property
    def text(self) -> str:
        """What was found, what it cost and what to doubt, in at most 12 lines."""
        return headline_text(self.summary, self.files, self.folder)

    @property
    def details(self) -> str:
        """All figures for people."""
        return details_text(self.summary, self.files)

    @property
    def files(self) -> list[str]:
        """Names of what the run left in its folder."""
        return sorted(path.name for path in self.folder.iterdir())


def load_run(path: str | Path) -> Run:
    """The run whose directory this is, as ``runs/latest``, or whose recording.

    What only concerned its processes, the last counters of each node, is left out of its ending.
    Raises InputError if it is no directory of a run, or a file in it cannot be read.
    """
    from palpate.launch.files.solid_file import read_model

    folder = run_directory_of(Path(path))
    summary = read_summary(folder)
    model = folder / MODEL_FILE
    keys = ("status", "reason", "gaps", "duplicates", "restarts")
    try:
        ending = Ending(**{key: summary[key] for key in keys})
        code = exit_code(summary, rebuilds=summary["method"] is not None)
    except KeyError as error:
        raise InputError(f"{folder / SUMMARY}: has no {error}: is it of this version?") from None
    return Run(folder, ending, summary, read_model(model) if model.is_file() else None, code)


def check_run(
    path: Path,
    args: Mapping[str, SourceMapped],
    settings: Mapping[str, SourceMapped],
    out: Path,
    *,
    realtime: bool = False,
) -> tuple[LaunchDescription, tuple[Wiring, ...]]:
    """What a launch file comes to with arguments and settings, checked whole, and its wiring.

    `out` is the run directory, which need not exist; `realtime` as in `plan_run`. Raises InputError
    if anything is wrong.
    """
    found = describe(path, args, out)
    graph = override(found.graph, settings)
    if realtime:
        graph = replace(graph, rate=1.0)
    wirings = graph.wirings()
    check_feasibility(graph, wirings)
    return LaunchDescription(graph, found.scene, found.args), wirings


def check_feasibility(graph: Graph, wirings: Sequence[Wiring]) -> None:
    """Refuse a tolerance that the sensor cannot tell, and fingers that have nothing to do.

    Says nothing of a graph that has no planner or no simulator of palpate's own.
    """
    places = {entry.name: entry for entry in graph.entries}
    plans = [one for one in wirings if isinstance(one.params, planner.Params)]
    fingers = [one for one in wirings if isinstance(one.params, simulator.Params)]
    if len(plans) == 1 and fingers:
        asked, place = plans[0].params, places[plans[0].name]
        _check_tolerance(asked, place, fingers[0].params)
        _check_budget(asked, place, fingers[0].params)
        demanded = demanded_of(wirings)
        assert demanded is not None
        _check_size(demanded, place, fingers[0].params)
        if len(fingers) > 1:
            _check_room(asked, place, fingers[0].params, len(fingers))


def _check_tolerance(asked: planner.Params, place: Entry, hand: simulator.Params) -> None:
    pipeline = build_pipeline(hand.sensor, hand.effects, ROBOT_PRESETS[hand.robot])
    resolution = resolution_of_info(info_of(hand.sensor, pipeline.noise))
    if asked.tolerance < resolution:
        raise place.settings.error(
            ("tolerance",),
            f"tolerance is {asked.tolerance} m; it must be at least what the sensor can tell, "
            f"{resolution:g} m",
        )


def _check_budget(asked: planner.Params, place: Entry, hand: simulator.Params) -> None:
    """Refuse a robot time in which the hand cannot even close twice."""
    if asked.most_seconds is None:
        return
    least = GraspSettings().least_seconds(ROBOT_PRESETS[hand.robot], hand.reach_of_finger)
    if asked.most_seconds < least:
        raise place.settings.error(
            ("most_seconds",),
            f"most_seconds is {asked.most_seconds:g} s; the grasp alone may take {least:.1f} s "
            f"with the robot {hand.robot!r}: allow more",
        )


def _check_size(demanded: Demanded, place: Entry, hand: simulator.Params) -> None:
    """Refuse an object that takes too long or too much memory, before a touch is made of it."""
    vertices, faces = build_shape(hand.object).mesh(EXTENT_LEVEL)
    size = np.ptp(vertices, axis=0).tolist()
    area = float(areas_and_normals(vertices[faces])[0].sum())
    width = hand.sensor.pitch * max(hand.sensor.rows, hand.sensor.cols)
    limits = SizeLimits()
    cost = size_cost(demanded.asked, size, area, width, demanded.quality)
    sides = " x ".join(f"{side:.3g}" for side in size)
    if cost.seconds > limits.max_seconds or cost.memory > limits.max_memory:
        raise place.error(
            f"the object measures {sides} m and would take about {cost.touches:.0f} touches, "
            f"{cost.seconds / 60.0:.0f} min of computing and {1e-9 * cost.memory:.1f} GB; at most "
            f"{limits.max_seconds / 60.0:.0f} min and {1e-9 * limits.max_memory:g} GB are begun: "
            "allow fewer touches (--touches), or multiply by 0.001 what is in millimetres"
        )
    if max(size) > limits.max_extent:
        raise place.error(
            f"the object measures {sides} m, and at most {limits.max_extent:g} m can be rebuilt: "
            "multiply by 0.001 what is in millimetres"
        )


def _check_room(asked: planner.Params, place: Entry, hand: simulator.Params, fingers: int) -> None:
    rule = make_planner(asked.planner, asked.settings)
    if isinstance(rule, Uniform) and rule.count < fingers:
        raise place.settings.error(
            ("settings", "count"),
            f"count is {rule.count}, but there are {fingers} fingers; a finger would have nothing "
            "to do: ask for more slices or take fewer fingers",
        )
    low, high = build_shape(hand.object).bounds()
    apart = SURVEYING.finger_spacing * hand.sensor.pitch * max(hand.sensor.rows, hand.sensor.cols)
    room = int((high[2] - low[2]) / apart) + 1
    if fingers > room:
        raise place.error(
            f"fingers is {fingers}, but an object of {high[2] - low[2]:.3g} m has room for {room}, "
            f"{apart:.3g} m apart; take fewer fingers"
        )


def plan_run(
    path: Path,
    args: Mapping[str, SourceMapped],
    settings: Mapping[str, SourceMapped],
    *,
    name: str,
    out: Path | None = None,
    realtime: bool = False,
) -> Plan:
    """Read and check everything that a run needs.

    `settings` are values by ``node.param``; `name` and `out` choose the run directory; `realtime`:
    robot time passes as fast as time. Raises InputError if anything is wrong; nothing has been
    started or written.
    """
    name = plain_name(name)
    folder = choose_run_directory(name, out)
    described, wirings = check_run(path, args, settings, folder.path, realtime=realtime)
    again: dict[str, Any] = {"scene": "scene.yaml"} if described.scene is not None else {}
    if isinstance(seed := described.args.get("seed"), int):
        again["seed"] = seed
    resolved = resolved_text(described.graph, wirings, folder.path, again)
    about = _about(described, resolved, {**settings, **args})
    told = with_description(wirings, about)
    scene = described.scene
    asked = [demand_text(wirings, settings, None if scene is None else scene.size)]
    if scene is not None and scene.told:
        asked = [*titled("mesh", scene.told), *asked]
    inputs = dict(scene.inputs) if scene is not None else {}
    inputs |= {f"{INPUTS}/{place}": file for place, file in own_modules(_named(wirings)).items()}
    return Plan(
        name,
        told,
        described.graph.ends,
        about,
        folder,
        inputs=inputs,
        demanded=demanded_of(wirings),
        asked="\n".join(asked),
    )


def _named(wirings: Sequence[Wiring]) -> set[str]:
    """Modules of the nodes, and what their parameters name as ``module:Class``."""
    return {one.module for one in wirings} | {
        name
        for one in wirings
        for name in _plugins(to_builtins(one.params, builtin_types=(bytes,)))
    }


def _plugins(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _plugins(key)
            yield from _plugins(one)
    elif isinstance(value, str) and _PLUGIN.fullmatch(value):
        yield value


def _about(
    described: LaunchDescription, resolved: str, given: Mapping[str, SourceMapped]
) -> dict[str, str]:
    about = {"launch": resolved, "versions": versions_text(), "ends": described.graph.ends}
    if described.scene is not None:
        text = _scene_text(described.scene.text, given)
        about |= {"scene": text, "scene_name": described.scene.name}
    seed = described.args.get("seed")
    return {**about, "seed": str(seed)} if isinstance(seed, int) else about


def _scene_text(text: str, given: Mapping[str, SourceMapped]) -> str:
    """A scene's text with the seed and what was asked of the planner, so that it runs again."""
    value = kept = parse_yaml(text, "").value
    for name, one in given.items():
        key = ("explore", *key_path(f".{name}")[1:]) if name.startswith("planner.") else (name,)
        if key[0] == "explore" or name == "seed":
            value = set_within(value, key, one)
    return text if value == kept else yaml_text(value)


def perform(plan: Plan, *, composed: bool, display: Display) -> Run:
    """Start the graph, watch it to its end and write what it leaves.

    `composed` has all nodes in this process instead of one each; the results are the same. Raises
    InputError if the run directory cannot be written, or its disk is too full for a recording.
    """
    folder, about = plan.folder, plan.about
    if not composed:
        from palpate.launch.processes.node_status import check_open_files

        with as_input_errors():
            check_open_files(len(plan.wirings))
    for wiring in plan.wirings:
        if wiring.module == RECORDER:
            folder.check_room(wiring.params.spare)
    folder.create()
    if "scene" in about:
        folder.write_text("scene.yaml", about["scene"])
    folder.write_text("launch.yaml", about["launch"])
    folder.copy_inputs(plan.inputs)
    exports: list[Future[object]] = []
    # The final model is written while it is still being measured.
    with (
        (folder.path / LOG).open("w", encoding="utf-8") as log,
        ThreadPoolExecutor(1) as pool,
    ):

        def export(model: ShapeModel) -> None:
            exports.append(pool.submit(export_model, model, folder.path))

        gatherer = ProgressWatcher(len(plan.wirings), display, log, export)
        if plan.demanded is not None:
            gatherer.progress.tolerance = plan.demanded.asked.tolerance
            gatherer.expectation = plan.demanded.expectation
        try:
            ending = _start(plan, gatherer, composed=composed)
        finally:
            display.close()
        progress = gatherer.progress
        if progress.model is not None and not progress.model.final:
            export(progress.model)
        for written in exports:
            written.result()
    if progress.procedure is not None:
        folder.write_result(progress.procedure, progress.recovered)
    seed = int(about["seed"]) if "seed" in about else None
    summary = summarise(ending, progress, about.get("scene_name"), seed)
    folder.write_summary(summary)
    types = {name for wiring in plan.wirings for name in wiring.types.values()}
    code = exit_code(summary, rebuilds=ShapeModel.__name__ in types)
    trace = folder.path / LOG if progress.has_trace else None
    return Run(folder.path, ending, summary, progress.model, code, trace)


def _start(plan: Plan, gatherer: ProgressWatcher, *, composed: bool) -> Ending:
    types = {topic: name for wiring in plan.wirings for topic, name in wiring.types.items()}
    gathered = {cls.__name__ for cls in GATHERED_TYPES}
    ends, watch = plan.ends, tuple(topic for topic, name in types.items() if name in gathered)
    if composed:
        from palpate.launch.processes.fork_server import signals_as_ctrl_c
        from palpate.nodes.runtime.composed import run_composed

        with signals_as_ctrl_c():
            return run_composed(plan.wirings, ends=ends, watch=watch, watcher=gatherer)
    from palpate.launch.launcher import launch

    with as_input_errors():
        return launch(
            plan.wirings,
            ends=ends,
            watch=watch,
            watcher=gatherer,
            name=plan.name,
            run_dir=plan.folder.path,
            before=plan.before,
        )
