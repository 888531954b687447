"""One run: planned and checked whole, then performed into its run directory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.launch.closing import closing_text
from palpate.launch.demand import check_demand
from palpate.launch.export import export_model
from palpate.launch.launch_file import Described, describe
from palpate.launch.located import InputError, Located
from palpate.launch.override import override
from palpate.launch.processes.before import Before
from palpate.launch.progress import GATHERED, Display, Gatherer
from palpate.launch.resolved import resolved_text
from palpate.launch.run_dir import RunDir, choose_run_dir
from palpate.launch.summary import exit_code, summarise
from palpate.launch.versions import versions_text
from palpate.messages.types import ShapeModel
from palpate.nodes.ending import Ending
from palpate.nodes.recording import RECORDER, with_description
from palpate.nodes.wiring import Wiring


@dataclass(frozen=True, slots=True)
class Plan:
    """A run that has passed every check and has left no trace yet."""

    name: str
    """What tools call it."""
    wirings: tuple[Wiring, ...]
    """The nodes, wired."""
    ends: str
    """The node whose Finished ends the graph."""
    about: Mapping[str, str]
    """What it says of itself, text by name: launch file, scene, seed, versions."""
    folder: RunDir
    """Where the results will be."""
    before: Before | None = None
    """An earlier run, if it goes on with one."""


@dataclass(frozen=True, slots=True)
class Run:
    """What a run came to."""

    folder: Path
    """The run directory."""
    ending: Ending
    """How the graph ended."""
    summary: Mapping[str, Any]
    """The figures, as in ``summary.json``."""
    model: ShapeModel | None
    """The last model."""
    exit_code: int
    """0 done, 1 the goal was missed, 3 a node died or all stood still, 130 interrupted."""

    @property
    def text(self) -> str:
        """The figures for people."""
        files = sorted(path.name for path in self.folder.iterdir())
        return closing_text(self.summary, files, self.folder)


def check_run(
    path: Path, args: Mapping[str, Located], settings: Mapping[str, Located], out: Path
) -> tuple[Described, tuple[Wiring, ...]]:
    """What a launch file comes to with arguments and settings, checked whole, and its wiring.

    Parameters are those of `plan_run`; `out` is the run directory, which need not exist.

    Raises
    ------
    InputError
        If anything is wrong.
    """
    found = describe(path, args, out)
    graph = override(found.graph, settings)
    wirings = graph.wirings()
    check_demand(graph, wirings)
    return Described(graph, found.scene, found.args), wirings


def plan_run(
    path: Path,
    args: Mapping[str, Located],
    settings: Mapping[str, Located],
    *,
    name: str,
    out: Path | None = None,
) -> Plan:
    """Read and check everything that a run needs.

    Parameters
    ----------
    path : Path
        The launch file.
    args : map
        Its arguments.
    settings : map
        ``node.param`` to its value.
    name : str
        Name of the run, for its directory.
    out : Path or None
        The run directory, if the user chooses it.

    Raises
    ------
    InputError
        If anything is wrong; nothing has been started or written.
    """
    folder = choose_run_dir(name, out)
    described, wirings = check_run(path, args, settings, folder.path)
    about = _about(described, resolved_text(described.graph, wirings))
    told = with_description(wirings, about)
    return Plan(name, told, described.graph.ends, about, folder)


def perform(plan: Plan, *, composed: bool, display: Display) -> Run:
    """Start the graph, watch it to its end and write what it leaves.

    Parameters
    ----------
    plan : Plan
        What to run.
    composed : bool
        All nodes in this process instead of one process each; the results are the same.
    display : Display
        Shows the progress.

    Raises
    ------
    InputError
        If the run directory cannot be written, or its disk is too full for a recording.
    """
    folder, about = plan.folder, plan.about
    for wiring in plan.wirings:
        if wiring.module == RECORDER:
            folder.check_room(wiring.params.spare)
    folder.create()
    if "scene" in about:
        folder.write_text("scene.yaml", about["scene"])
    folder.write_text("launch.yaml", about["launch"])
    with (folder.path / "log.jsonl").open("w", encoding="utf-8") as log:
        gatherer = Gatherer(len(plan.wirings), display, log)
        try:
            ending = _start(plan, gatherer, composed=composed)
        finally:
            display.close()
    progress = gatherer.progress
    seed = int(about["seed"]) if "seed" in about else None
    summary = summarise(ending, progress, about.get("scene_name"), seed)
    if progress.model is not None:
        export_model(progress.model, folder.path)
    folder.write_json("summary.json", summary)
    types = {name for wiring in plan.wirings for name in wiring.types.values()}
    code = exit_code(summary, rebuilds=ShapeModel.__name__ in types)
    return Run(folder.path, ending, summary, progress.model, code)


def _start(plan: Plan, gatherer: Gatherer, *, composed: bool) -> Ending:
    said = {topic: name for wiring in plan.wirings for topic, name in wiring.types.items()}
    gathered = {cls.__name__ for cls in GATHERED}
    ends, hear = plan.ends, tuple(topic for topic, name in said.items() if name in gathered)
    if composed:
        from palpate.launch.processes.interrupts import as_ctrl_c
        from palpate.nodes.composed import run_composed

        with as_ctrl_c():
            return run_composed(plan.wirings, ends=ends, hear=hear, watcher=gatherer)
    from palpate.launch.launcher import launch

    try:
        return launch(
            plan.wirings,
            ends=ends,
            hear=hear,
            watcher=gatherer,
            name=plan.name,
            run_dir=plan.folder.path,
            before=plan.before,
        )
    except ValueError as error:
        raise InputError(str(error)) from None


def _about(described: Described, resolved: str) -> dict[str, str]:
    """What a recording says of its run, beside the graph."""
    about = {"launch": resolved, "versions": versions_text(), "ends": described.graph.ends}
    if described.scene is not None:
        about |= {"scene": described.scene.text, "scene_name": described.scene.name}
    seed = _seed(described)
    return about if seed is None else {**about, "seed": str(seed)}


def _seed(described: Described) -> int | None:
    seed = described.args.get("seed")
    return seed if isinstance(seed, int) else None
