"""An exploration from beginning to end, for Python and for the command line, and its report."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import click
import numpy as np

from palpate.launch.demand import read_demand, read_mesh_setup, read_setup
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.files.source_map import InputError, SourceMapped, as_input_errors
from palpate.launch.files.yaml_file import yaml_text
from palpate.launch.launch_source import find_exploration, prestart_fork_server
from palpate.launch.progress import Display, open_display
from palpate.launch.run import Plan, Run, perform, plan_run
from palpate.launch.scene import find_scene, load_scene

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from palpate.core.rebuild import HasTriangles

    ObjectScene: TypeAlias = tuple[ArrayLike, ArrayLike] | HasTriangles


# Arguments of the launch file by the options that give them.
ARGUMENTS = {
    "seed": "seed",
    "fingers": "fingers",
}


def explore(
    scene: str | Path | Mapping[str, Any] | ObjectScene = "vase",
    *,
    tolerance: str | float | None = None,
    feature: str | float | None = None,
    budget: str | float | None = None,
    touches: int | None = None,
    underside: Literal["flat", "known"] | None = None,
    turns: int | None = None,
    quality: Literal["draft", "normal", "fine"] | None = None,
    fingers: int | None = None,
    procedure: str | None = None,
    system: str | None = None,
    unit: Literal["m", "cm", "mm", "um", "in", "ft"] | None = None,
    up: Literal["z", "-z", "y", "-y", "x", "-x"] | None = None,
    size: str | float | None = None,
    pose: str | Sequence[float] | None = None,
    noise: Literal["none", "low", "default", "high"] | None = None,
    seed: int | None = None,
    settings: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    composed: bool = False,
    record: bool = True,
    realtime: bool = False,
    progress: bool = True,
    quiet: bool | None = None,
) -> Run:
    """Touch the object of a scene and rebuild it: ``palpate run``, with its options as keywords.

    Parameters
    ----------
    scene : str, Path, map or mesh
        Name of a shipped scene, path of a scene file or of a mesh, what a scene file holds as a
        dict, or a mesh: vertices (n, 3) and faces (m, 3), or an object that has both, as trimesh's.
    tolerance, feature : str or float, optional
        Error asked for, and largest height that may stay untouched: ``"0.2mm"``, or in m.
    budget : str or float, optional
        Robot time that may pass: ``"300s"``, ``"5min"``, or in s.
    touches : int, optional
        Touches that may be made.
    underside : str, optional
        What the object stands on: flat, as which it is taken, or known, for which it is turned
        over.
    turns : int, optional
        Times that the object may be set down on another side, 0 to 8, where that pays; 1 if left
        out.
    quality : str, optional
        Of the final mesh: draft, normal or fine.
    fingers : int, optional
        So many explore at once, 1 to 8; one if left out.
    procedure : str, optional
        An exploratory procedure instead of slices: containment, planar, follower, fearing or
        openings.
    system : str, optional
        Whose parts explore: palpate, which is the default, or thesis.
    unit, up : str, optional
        Of a mesh: the unit of its coordinates (m, cm, mm, um, in, ft), and its axis that points up.
    size : str or float, optional
        Of a mesh: its largest extent, to which it is scaled: ``"80mm"``, or in m.
    pose : str or sequence of 3 or 7 floats, optional
        Where the object stands, m, and its rotation as a quaternion x, y, z, w.
    noise : str, optional
        Of finger and taxels: none, low, default or high.
    seed : int, optional
        Overrides the scene's seed.
    settings : map, optional
        ``{"planner.tolerance": 0.1e-3}``: parameters of single nodes.
    out : str or Path, optional
        The run directory; a new one in ``runs/`` if left out.
    composed : bool
        All nodes in this process instead of one process each; the results are the same.
    record : bool
        Keep every message in ``topics.mcap``.
    realtime : bool
        Robot time passes as fast as time, so that the run can be watched.
    progress : bool
        Show a bar where a terminal or a notebook can; elsewhere nothing is shown.
    quiet : bool, optional
        In place of `progress`: False writes lines where no bar can be shown.

    Returns
    -------
    Run
        The figures, the last model, and where the files lie.

    Raises
    ------
    InputError
        A ValueError of one sentence, in the words of the command line, if the scene or an option
        cannot be used; nothing has been started.
    """
    file = find_exploration(procedure, system)
    if not composed:
        prestart_fork_server(file)
    if quiet is None:
        display = open_display(quiet=not progress, lines=False)
    else:
        display = open_display(quiet=quiet)
    with _scene_file(scene) as path:
        plan = plan_exploration(
            path,
            settings={key: SourceMapped(value, key) for key, value in (settings or {}).items()},
            tolerance=_quantity(tolerance, "m"),
            feature=_quantity(feature, "m"),
            budget=_quantity(budget, "s"),
            touches=touches,
            underside=underside,
            turns=turns,
            quality=quality,
            fingers=fingers,
            procedure=procedure,
            system=system,
            unit=unit,
            up=up,
            size=_quantity(size, "m"),
            pose=pose if pose is None or isinstance(pose, str) else ",".join(map(str, pose)),
            noise=noise,
            seed=seed,
            out=None if out is None else Path(out),
            record=record,
            realtime=realtime,
        )
        return _perform(plan, composed=composed, display=display)


def plan_exploration(
    scene: Path,
    *,
    settings: Mapping[str, SourceMapped],
    tolerance: str | None = None,
    feature: str | None = None,
    budget: str | None = None,
    touches: int | None = None,
    underside: str | None = None,
    turns: int | None = None,
    quality: str | None = None,
    procedure: str | None = None,
    system: str | None = None,
    unit: str | None = None,
    up: str | None = None,
    size: str | None = None,
    pose: str | None = None,
    noise: str | None = None,
    out: Path | None = None,
    record: bool = True,
    realtime: bool = False,
    untrusted: bool = False,
    **arguments: Any,
) -> Plan:
    """The plan of ``palpate run``, given its options as their texts; `arguments`: see `ARGUMENTS`.

    Raises InputError if the scene or an option cannot be used; nothing has been started.
    """
    if untrusted:
        load_scene(scene, untrusted=True)
    args = {"scene": SourceMapped(str(scene), "")}
    for option, name, value in (
        ("--no-record", "record", record),
        *((f"--{key}", ARGUMENTS[key], value) for key, value in arguments.items()),
        *read_mesh_setup(scene, unit, size, up),
        *read_setup(pose, noise),
    ):
        if value is not None:
            args[name] = SourceMapped(value, option)
    demand = read_demand(tolerance, feature, budget, touches, underside, quality, procedure, turns)
    return plan_run(
        find_exploration(procedure, system),
        args,
        {**settings, **demand},
        name=scene.stem,
        out=out,
        realtime=realtime,
    )


def _quantity(value: str | float | None, unit: str) -> str | None:
    """A number in a unit as the text that the command line takes; texts as they are."""
    return value if value is None or isinstance(value, str) else f"{float(value)!r}{unit}"


@contextmanager
def _scene_file(scene: str | Path | Mapping[str, Any] | ObjectScene) -> Iterator[Path]:
    """The file of a scene; of what is none, one that exists until the context ends.

    Raises InputError if there is no such scene, or it is not what can be written into a file.
    """
    if isinstance(scene, str | Path):
        yield find_scene(scene)
        return
    with TemporaryDirectory(prefix="palpate-") as folder:
        if isinstance(scene, Mapping):
            path = Path(folder) / "scene.yaml"
            path.write_text(yaml_text(_own_files(scene, Path(folder))), encoding="utf-8")
        else:
            path = Path(folder) / "object.ply"
            vertices, faces = scene if isinstance(scene, tuple) else (scene.vertices, scene.faces)
            from palpate.core.rebuild import MeshSolid  # heavy, and not needed by the command line

            with as_input_errors():
                mesh = MeshSolid(np.asarray(vertices), np.asarray(faces))
            write_mesh(path, mesh.vertices, mesh.faces)
        try:
            yield path
        except InputError as error:
            raise InputError(str(error).replace(str(path), path.stem)) from None


def _own_files(scene: Mapping[str, Any], folder: Path) -> Any:
    """A scene as plain values, with the files that it names copied into its folder.

    Raises InputError if it holds anything but maps, lists, arrays, texts and numbers.
    """
    try:
        plain = json.loads(json.dumps(scene, default=lambda value: value.tolist()))
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"scene: must hold maps, lists, texts and numbers: {error}") from None
    for section, key in (("object", "mesh"), ("sensor", "calibration")):
        holder = plain.get(section)
        while isinstance(holder, dict) and isinstance(holder.get(key), dict):
            holder, key = holder[key], "file"
        name = holder.get(key) if isinstance(holder, dict) else None
        if isinstance(name, str) and Path(name).is_file():
            copied = shutil.copyfile(name, folder / Path(name).name)
            holder[key] = Path(copied).name
    return plain


def perform_and_print(
    plan: Plan,
    *,
    composed: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool = False,
    view: bool = False,
) -> int:
    """Perform a plan and print its result, or ``summary.json``; returns the exit code.

    What is asked, and what it is expected to cost, is told before it begins. The result comes last,
    so that it stays in sight; `verbose`: all figures before it; `view`: it is shown in the browser.
    """
    silent, say = quiet or as_json, partial(click.echo, err=True)
    if view and composed:
        raise InputError("--view and --composed exclude each other: one process has nothing to tap")
    if not view:
        return _perform_and_print(plan, composed, as_json, quiet, verbose).exit_code
    from palpate.tools.view.beside import ViewProcess

    with ViewProcess(plan.folder.path, (lambda _: None) if quiet else say) as beside:
        done = _perform_and_print(plan, composed, as_json, quiet, verbose)
        if not silent and done.ending.status != "interrupted":
            beside.stay(say)
    return done.exit_code


def _perform_and_print(
    plan: Plan, composed: bool, as_json: bool, quiet: bool, verbose: bool
) -> Run:
    silent = quiet or as_json
    if plan.asked and not silent:
        click.echo(plan.asked, err=True)
    done = _perform(plan, composed=composed, display=open_display(quiet=silent))
    if done.trace is not None and done.ending.status == "died":
        click.echo(f"palpate: the trace of the error is in {done.trace}", err=True)
    if as_json:
        click.echo(json.dumps(done.summary, indent=2, allow_nan=False))
    elif not quiet:
        click.echo(f"{done.details}\n{done.text}" if verbose else done.text)
    elif done.exit_code != 0:
        missed = [*done.summary["missed"], done.summary["reason"]]
        click.echo(f"palpate: {done.ending.status}: {'; '.join(missed)}", err=True)
    return done


def _perform(plan: Plan, *, composed: bool, display: Display) -> Run:
    """Perform a plan, and write its report; one that cannot be written is no fault of the run."""
    done = perform(plan, composed=composed, display=display)
    from palpate.tools.report.page import REPORT, write_report

    try:
        write_report([done.folder], done.folder / REPORT)
    except InputError as error:
        click.echo(f"palpate: no {REPORT}: {error}", err=True)
    return done
