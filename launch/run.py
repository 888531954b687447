"""One run: planned and checked whole, then performed into its run directory.

Nothing is started or written before everything is checked: launch file, scene, parameters, wiring,
and whether sensor, fingers and object allow what is requested.
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
from palpate.core.explore import DEFAULT_SURVEY, GraspSettings
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
from palpate.launch.progress import GATHERED_TYPES, Display, Progress, ProgressWatcher
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
from palpate.nodes.specs.objects import DEFAULT_REACH, build_shape
from palpate.nodes.specs.sensors import build_pipeline, info_of, resolution_of_info

if TYPE_CHECKING:
    from palpate.core.rebuild import Solid

LOG = "log.jsonl"  # file of the run directory with the log records of the nodes
_PLUGIN = re.compile(r"[\w.]+:[A-Za-z_]\w*")  # ``module:Class``


@dataclass(frozen=True, slots=True)
class Plan:
    """A checked run that is not started, and of which nothing is written."""

    name: str  # by which tools find it
    wirings: tuple[Wiring, ...]  # of the nodes
    ends: str  # node whose Finished ends the graph
    # Description of the run, texts by name: launch file, scene, seed, versions.
    about: Mapping[str, str]
    folder: RunDirectory  # for the results
    before: EarlierRun | None = None  # run that it continues, if any
    # Files that are needed to repeat the run, by their names in its folder.
    inputs: Mapping[str, Path] = field(default_factory=dict)
    demanded: Demanded | None = None  # of the planner; None without a planner
    asked: str = ""  # the same and its expected cost, as lines of text


@dataclass(frozen=True, repr=False)
class Run:
    """The results of a run."""

    folder: Path  # run directory
    ending: Ending  # of the graph
    summary: Mapping[str, Any]  # figures, as in ``summary.json``
    model: ShapeModel | None  # the last one
    exit_code: int  # as of `palpate.launch.run_directory.exit_code`
    trace: Path | None = None  # file with the trace of a node's error, if there was one

    def __repr__(self) -> str:
        """The status, the solid, the limits, the cost and the folder, a line each."""
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

        It is a `LatticeSolid` or a `GeneralSolid` if the model is final; otherwise, and for an
        exploratory procedure, a `MeshSolid`. Its final mesh is that of the model.
        """
        if self.model is None or not len(self.model.faces):
            return None
        from palpate.launch.files.solid_file import solid_of

        packed = self.model.archive
        arrays = arrays_from_bytes(packed) if len(packed) else {}
        return solid_of(arrays | {"vertices": self.model.vertices, "faces": self.model.faces})

    @property
    def text(self) -> str:
        """The solid, the cost and doubts, in about 12 lines."""
        return headline_text(self.summary, self.files, self.folder)

    @property
    def details(self) -> str:
        """All figures as lines of text."""
        return details_text(self.summary, self.files)

    @property
    def files(self) -> list[str]:
        """Names of the files in its folder."""
        return sorted(path.name for path in self.folder.iterdir())


def load_run(path: str | Path) -> Run:
    """The run with this directory, as ``runs/latest``, or recording.

    Its ending has no statuses of nodes. Raises InputError if the path is no directory of a run, or
    a file in it cannot be read.
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
    """The description by a launch file with arguments and settings, checked whole, and its wiring.

    `out`: the run directory, which need not exist. `realtime`: as in `plan_run`. Raises InputError
    if anything is wrong.
    """
    description = describe(path, args, out)
    graph = override(description.graph, settings)
    if realtime:
        graph = replace(graph, rate=1.0)
    wirings = graph.wirings()
    check_feasibility(graph, wirings)
    return LaunchDescription(graph, description.scene, description.args), wirings


def check_feasibility(graph: Graph, wirings: Sequence[Wiring]) -> None:
    """Raise InputError if sensor, robot or fingers do not suit the demand or the object.

    A graph without exactly one planner, or without a simulator, of palpate is not checked.
    """
    planners = [wiring for wiring in wirings if isinstance(wiring.params, planner.Params)]
    fingers = [wiring for wiring in wirings if isinstance(wiring.params, simulator.Params)]
    if len(planners) == 1 and fingers:
        entry = next(entry for entry in graph.entries if entry.name == planners[0].name)
        asked, hand = planners[0].params, fingers[0].params
        _check_tolerance(asked, entry, hand)
        _check_budget(asked, entry, hand)
        demanded = demanded_of(wirings)
        assert demanded is not None
        _check_size(demanded, entry, hand)
        if len(fingers) > 1:
            _check_room(asked, entry, hand, len(fingers))


def _check_tolerance(asked: planner.Params, entry: Entry, hand: simulator.Params) -> None:
    """Refuse a tolerance below the resolution of the sensor."""
    pipeline = build_pipeline(hand.sensor, hand.effects, ROBOT_PRESETS[hand.robot])
    resolution = resolution_of_info(info_of(hand.sensor, pipeline.noise))
    if asked.tolerance < resolution:
        raise entry.settings.error(
            ("tolerance",),
            f"tolerance is {asked.tolerance} m; it must be at least the resolution of the "
            f"sensor, {resolution:g} m",
        )


def _check_budget(asked: planner.Params, entry: Entry, hand: simulator.Params) -> None:
    """Refuse a robot time that is too short for the grasp."""
    if asked.most_seconds is None:
        return
    needed = GraspSettings().least_seconds(ROBOT_PRESETS[hand.robot], hand.reach_of_finger)
    if asked.most_seconds < needed:
        raise entry.settings.error(
            ("most_seconds",),
            f"most_seconds is {asked.most_seconds:g} s; the grasp alone may take {needed:.1f} s "
            f"with the robot {hand.robot!r}: allow more",
        )


def _check_size(demanded: Demanded, entry: Entry, hand: simulator.Params) -> None:
    """Refuse an object that would take too much time or memory."""
    vertices, faces = build_shape(hand.object).mesh(DEFAULT_REACH.mesh_level)
    size = np.ptp(vertices, axis=0).tolist()
    area = float(areas_and_normals(vertices[faces])[0].sum())
    width = hand.sensor.pitch * max(hand.sensor.rows, hand.sensor.cols)
    limits = SizeLimits()
    cost = size_cost(demanded.asked, size, area, width, demanded.quality)
    sides = " x ".join(f"{side:.3g}" for side in size)
    if cost.seconds > limits.max_seconds or cost.memory > limits.max_memory:
        raise entry.error(
            f"the object measures {sides} m and would take about {cost.touches:.0f} touches, "
            f"{cost.seconds / 60.0:.0f} min of computing and {1e-9 * cost.memory:.1f} GB; at most "
            f"{limits.max_seconds / 60.0:.0f} min and {1e-9 * limits.max_memory:g} GB are begun: "
            "allow fewer touches (--touches), or multiply by 0.001 if it is in millimetres"
        )
    if max(size) > limits.max_extent:
        raise entry.error(
            f"the object measures {sides} m, and at most {limits.max_extent:g} m can be rebuilt: "
            "multiply by 0.001 if it is in millimetres"
        )


def _check_room(asked: planner.Params, entry: Entry, hand: simulator.Params, fingers: int) -> None:
    """Refuse more fingers than slices, or than fit above each other along the object."""
    rule = make_planner(asked.planner, asked.settings)
    if isinstance(rule, Uniform) and rule.count < fingers:
        raise entry.settings.error(
            ("settings", "count"),
            f"count is {rule.count}, but there are {fingers} fingers; a finger would have nothing "
            "to do: ask for more slices or take fewer fingers",
        )
    low, high = build_shape(hand.object).bounds()
    spacing = (
        DEFAULT_SURVEY.finger_spacing * hand.sensor.pitch * max(hand.sensor.rows, hand.sensor.cols)
    )
    room = int((high[2] - low[2]) / spacing) + 1
    if fingers > room:
        raise entry.error(
            f"fingers is {fingers}, but an object of {high[2] - low[2]:.3g} m has room for {room}, "
            f"{spacing:.3g} m apart; take fewer fingers"
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
    """Read and check everything that a run needs; nothing is started or written.

    `settings`: values by ``node.param``. `name`, `out`: as of `choose_run_directory`. `realtime`:
    robot time passes as fast as wall time. Raises InputError if anything is wrong.
    """
    name = plain_name(name)
    folder = choose_run_directory(name, out)
    described, wirings = check_run(path, args, settings, folder.path, realtime=realtime)
    again: dict[str, Any] = {"scene": "scene.yaml"} if described.scene is not None else {}
    if isinstance(seed := described.args.get("seed"), int):
        again["seed"] = seed
    resolved = resolved_text(described.graph, wirings, folder.path, again)
    about = _about(described, resolved, {**settings, **args})
    scene = described.scene
    asked = [demand_text(wirings, settings, None if scene is None else scene.size)]
    if scene is not None and scene.mesh_notes:
        asked = [*titled("mesh", scene.mesh_notes), *asked]
    inputs = dict(scene.inputs) if scene is not None else {}
    inputs |= {f"{INPUTS}/{place}": file for place, file in own_modules(_named(wirings)).items()}
    return Plan(
        name,
        with_description(wirings, about),
        described.graph.ends,
        about,
        folder,
        inputs=inputs,
        demanded=demanded_of(wirings),
        asked="\n".join(asked),
    )


def _named(wirings: Sequence[Wiring]) -> set[str]:
    """Modules of the nodes, and texts ``module:Class`` in their parameters."""
    return {wiring.module for wiring in wirings} | {
        name
        for wiring in wirings
        for name in _plugins(to_builtins(wiring.params, builtin_types=(bytes,)))
    }


def _plugins(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _plugins(key)
            yield from _plugins(item)
    elif isinstance(value, str) and _PLUGIN.fullmatch(value):
        yield value


def _about(
    described: LaunchDescription, resolved: str, changes: Mapping[str, SourceMapped]
) -> dict[str, str]:
    """The description of a run that is recorded with it, texts by name."""
    about = {"launch": resolved, "versions": versions_text(), "ends": described.graph.ends}
    if described.scene is not None:
        text = _scene_text(described.scene.text, changes)
        about |= {"scene": text, "scene_name": described.scene.name}
    seed = described.args.get("seed")
    return {**about, "seed": str(seed)} if isinstance(seed, int) else about


def _scene_text(text: str, changes: Mapping[str, SourceMapped]) -> str:
    """A scene's text with changed seed and settings of the planner, so that it runs again."""
    value = original = parse_yaml(text, "").value
    for name, change in changes.items():
        key = ("explore", *key_path(f".{name}")[1:]) if name.startswith("planner.") else (name,)
        if key[0] == "explore" or name == "seed":
            value = set_within(value, key, change)
    return text if value == original else yaml_text(value)


def perform(plan: Plan, *, composed: bool, display: Display) -> Run:
    """Start the graph, watch it until it ends and write its results.

    `composed`: all nodes run in this process instead of one process each, with the same results.
    Raises InputError if the run directory cannot be written, or its disk is too full for a
    recording.
    """
    _prepare_folder(plan, composed=composed)
    ending, progress = _watch(plan, composed=composed, display=display)
    folder, about = plan.folder, plan.about
    if progress.procedure is not None:
        folder.write_result(progress.procedure, progress.recovered)
    seed = int(about["seed"]) if "seed" in about else None
    summary = summarise(ending, progress, about.get("scene_name"), seed)
    folder.write_summary(summary)
    types = {name for wiring in plan.wirings for name in wiring.types.values()}
    code = exit_code(summary, rebuilds=ShapeModel.__name__ in types)
    trace = folder.path / LOG if progress.has_trace else None
    return Run(folder.path, ending, summary, progress.model, code, trace)


def _prepare_folder(plan: Plan, *, composed: bool) -> None:
    """Check limits of the machine, then make the run directory with the inputs of the run."""
    folder = plan.folder
    if not composed:
        from palpate.launch.processes.node_status import check_open_files

        with as_input_errors():
            check_open_files(len(plan.wirings))
    for wiring in plan.wirings:
        if wiring.module == RECORDER:
            folder.check_room(wiring.params.spare)
    folder.create()
    if "scene" in plan.about:
        folder.write_text("scene.yaml", plan.about["scene"])
    folder.write_text("launch.yaml", plan.about["launch"])
    folder.copy_inputs(plan.inputs)


def _watch(plan: Plan, *, composed: bool, display: Display) -> tuple[Ending, Progress]:
    """Run the graph to its end; write its log, and the final model while it is measured."""
    folder, exports = plan.folder.path, list[Future[object]]()
    with (folder / LOG).open("w", encoding="utf-8") as log, ThreadPoolExecutor(1) as pool:

        def export(model: ShapeModel) -> None:
            exports.append(pool.submit(export_model, model, folder))

        watcher = ProgressWatcher(len(plan.wirings), display, log, export)
        progress = watcher.progress
        if plan.demanded is not None:
            progress.tolerance = plan.demanded.asked.tolerance
            watcher.expectation = plan.demanded.expectation
        try:
            ending = _start(plan, watcher, composed=composed)
        finally:
            display.close()
        if progress.model is not None and not progress.model.final:
            export(progress.model)
        for exported in exports:
            exported.result()
    return ending, progress


def _start(plan: Plan, watcher: ProgressWatcher, *, composed: bool) -> Ending:
    types = {topic: name for wiring in plan.wirings for topic, name in wiring.types.items()}
    gathered = {cls.__name__ for cls in GATHERED_TYPES}
    ends, watch = plan.ends, tuple(topic for topic, name in types.items() if name in gathered)
    if composed:
        from palpate.launch.processes.fork_server import signals_as_ctrl_c
        from palpate.nodes.runtime.composed import run_composed

        with signals_as_ctrl_c():
            return run_composed(plan.wirings, ends=ends, watch=watch, watcher=watcher)
    from palpate.launch.launcher import launch

    with as_input_errors():
        return launch(
            plan.wirings,
            ends=ends,
            watch=watch,
            watcher=watcher,
            name=plan.name,
            run_dir=plan.folder.path,
            before=plan.before,
        )
