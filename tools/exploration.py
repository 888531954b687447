"""A whole exploration with its report, for Python and for the command line."""

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
        Name of a shipped scene, path of a scene file or of a mesh, contents of a scene file as a
        dict, or a mesh: vertices (n, 3) and faces (m, 3), or an object with both, as of trimesh.
    tolerance, feature : str or float, optional
        Demanded error, and largest height that may stay untouched: ``"0.2mm"``, or a number [m].
    budget : str or float, optional
        Largest robot time: ``"300s"``, ``"5min"``, or a number [s].
    touches : int, optional
        Largest number of touches.
    underside : str, optional
        ``"flat"``: the underside is assumed to be flat; ``"known"``: it is touched after turning
        the object over.
    turns : int, optional
        Largest number of times that the object is set down on another side where this pays, 0 to
        8; default 1.
    quality : str, optional
        Of the final mesh: draft, normal or fine.
    fingers : int, optional
        Number of fingers that explore at once, 1 to 8; default 1.
    procedure : str, optional
        An exploratory procedure instead of slices: containment, planar, follower, fearing or
        openings.
    system : str, optional
        Nodes of palpate, the default, or of the thesis.
    unit, up : str, optional
        Unit of the coordinates of a mesh (m, cm, mm, um, in, ft), and its axis that points up.
    size : str or float, optional
        Largest extent to which a mesh is scaled: ``"80mm"``, or a number [m].
    pose : str or sequence of 3 or 7 floats, optional
        Position of the object [m], and its rotation as a quaternion x, y, z, w.
    noise : str, optional
        Of finger and taxels: none, low, default or high.
    seed : int, optional
        Overrides the seed of the scene.
    settings : map, optional
        Parameters of single nodes: ``{"planner.tolerance": 0.1e-3}``.
    out : str or Path, optional
        Run directory; default: a new one in ``runs/``.
    composed : bool
        Whether all nodes run in this process instead of one process each, with the same results.
    record : bool
        Whether all messages are recorded in ``topics.mcap``.
    realtime : bool
        Whether robot time passes as fast as the clock, so that the run can be watched.
    progress : bool
        Whether a terminal or a notebook shows a bar; elsewhere nothing is shown.
    quiet : bool, optional
        Replaces `progress`: with False, lines are written where no bar can be shown.

    Returns
    -------
    Run
        Figures, the last model, and the paths of the files.

    Raises
    ------
    InputError
        A ValueError in the words of the command line, if the scene or an option is invalid; nothing
        has been started then.
    """
    file = find_exploration(procedure, system)
    if not composed:
        prestart_fork_server(file)
    display = _display(progress, quiet)
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
            pose=_pose_text(pose),
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
    fingers: int | None = None,
    seed: int | None = None,
) -> Plan:
    """The plan of ``palpate run`` with its options as texts.

    Raises InputError if the scene or an option is invalid; nothing has been started then.
    """
    if untrusted:
        load_scene(scene, untrusted=True)
    arguments = _arguments(
        ("", "scene", str(scene)),
        ("--no-record", "record", record),
        ("--seed", "seed", seed),
        ("--fingers", "fingers", fingers),
        *read_mesh_setup(scene, unit, size, up),
        *read_setup(pose, noise),
    )
    demand = read_demand(tolerance, feature, budget, touches, underside, quality, procedure, turns)
    parameters, file = {**settings, **demand}, find_exploration(procedure, system)
    return plan_run(file, arguments, parameters, name=scene.stem, out=out, realtime=realtime)


def _arguments(*options: tuple[str, str, Any]) -> dict[str, SourceMapped]:
    """Arguments of the launch file from options, names and values; None is left out."""
    present = (option for option in options if option[2] is not None)
    return {name: SourceMapped(value, option) for option, name, value in present}


def _display(progress: bool, quiet: bool | None) -> Display:
    """Display of `explore`: `quiet` replaces `progress`, and allows lines where no bar can be."""
    if quiet is None:
        return open_display(quiet=not progress, lines=False)
    return open_display(quiet=quiet)


def _quantity(value: str | float | None, unit: str) -> str | None:
    """A number in a unit as the text that the command line takes; texts are kept."""
    return value if value is None or isinstance(value, str) else f"{float(value)!r}{unit}"


def _pose_text(pose: str | Sequence[float] | None) -> str | None:
    """A pose as the text that the command line takes; texts are kept."""
    return pose if pose is None or isinstance(pose, str) else ",".join(map(str, pose))


@contextmanager
def _scene_file(scene: str | Path | Mapping[str, Any] | ObjectScene) -> Iterator[Path]:
    """File of a scene; a dict or a mesh is written to one that exists until the context ends.

    Raises InputError if there is no such scene, or it cannot be written into a file.
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
            _write_object(scene, path)
        try:
            yield path
        except InputError as error:
            raise InputError(str(error).replace(str(path), path.stem)) from None


def _write_object(scene: ObjectScene, path: Path) -> None:
    """Write a mesh from memory into a file; raises InputError if it is not a valid one."""
    from palpate.core.rebuild import MeshSolid  # slow to import, and not needed by the command line

    vertices, faces = scene if isinstance(scene, tuple) else (scene.vertices, scene.faces)
    with as_input_errors():
        mesh = MeshSolid(np.asarray(vertices), np.asarray(faces))
    write_mesh(path, mesh.vertices, mesh.faces)


def _own_files(scene: Mapping[str, Any], folder: Path) -> Any:
    """A scene as plain values; files that it names are copied into the folder.

    Raises InputError if it has other values than maps, lists, arrays, texts and numbers.
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

    The demand and its expected cost are printed before the run, and the result last. `verbose`:
    all figures are printed before the result; `view`: the run is shown in the browser.
    """
    silent, say = quiet or as_json, partial(click.echo, err=True)
    if view and composed:
        raise InputError("--view and --composed exclude each other: one process has nothing to tap")
    if not view:
        return _perform_and_print(plan, composed, as_json, quiet, verbose).exit_code
    from palpate.tools.view.beside import ViewProcess

    with ViewProcess(plan.folder.path, (lambda _: None) if quiet else say) as view_process:
        done = _perform_and_print(plan, composed, as_json, quiet, verbose)
        if not silent and done.ending.status != "interrupted":
            view_process.stay(say)
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
    """Perform a plan and write its report; a report that cannot be written only gives a message."""
    done = perform(plan, composed=composed, display=display)
    from palpate.tools.report.page import REPORT, write_report

    try:
        write_report([done.folder], done.folder / REPORT)
    except InputError as error:
        click.echo(f"palpate: no {REPORT}: {error}", err=True)
    return done
