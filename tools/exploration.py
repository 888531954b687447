"""An exploration from beginning to end, for Python and for the command line, and its report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import click

from palpate import launch
from palpate.launch.files import InputError, SourceMapped


def explore(
    scene: str | Path = "vase",
    *,
    seed: int | None = None,
    fingers: int | None = None,
    settings: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    composed: bool = False,
    record: bool = True,
    realtime: bool = False,
    quiet: bool = True,
) -> launch.Run:
    """Touch the object of a scene and rebuild it.

    Parameters
    ----------
    scene : str or Path
        Name of a shipped scene, or path of a scene file or of a mesh.
    seed : int, optional
        Overrides the scene's seed.
    fingers : int, optional
        So many explore at once, 1 to 8; one if left out.
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
    quiet : bool
        Show no progress.

    Returns
    -------
    Run
        The figures, the last model, and where the files lie.

    Raises
    ------
    InputError
        If the scene or a setting cannot be used; nothing has been started.
    """
    path = launch.find_scene(scene)
    if not composed:
        launch.prestart_fork_server(launch.EXPLORE)
    given = {"scene": str(path), "record": record, "seed": seed, "fingers": fingers}
    plan = launch.plan_run(
        launch.EXPLORE,
        {key: SourceMapped(value, key) for key, value in given.items() if value is not None},
        {key: SourceMapped(value, key) for key, value in (settings or {}).items()},
        name=path.stem,
        out=None if out is None else Path(out),
        realtime=realtime,
    )
    return _perform(plan, composed=composed, display=launch.open_display(quiet=quiet))


def perform_and_print(
    plan: launch.Plan,
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
    from palpate.tools.view import ViewProcess

    with ViewProcess(plan.folder.path, (lambda _: None) if quiet else say) as beside:
        done = _perform_and_print(plan, composed, as_json, quiet, verbose)
        if not silent and done.ending.status != "interrupted":
            beside.stay(say)
    return done.exit_code


def _perform_and_print(
    plan: launch.Plan, composed: bool, as_json: bool, quiet: bool, verbose: bool
) -> launch.Run:
    silent = quiet or as_json
    if plan.asked and not silent:
        click.echo(plan.asked, err=True)
    done = _perform(plan, composed=composed, display=launch.open_display(quiet=silent))
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


def _perform(plan: launch.Plan, *, composed: bool, display: launch.Display) -> launch.Run:
    """Perform a plan, and write its report; one that cannot be written is no fault of the run."""
    done = launch.perform(plan, composed=composed, display=display)
    from palpate.tools.report import REPORT, write_report  # not before: it takes long

    try:
        write_report([done.folder], done.folder / REPORT)
    except InputError as error:
        click.echo(f"palpate: no {REPORT}: {error}", err=True)
    return done
