"""Verbs that start graphs: run, launch, replay; host and keys for machines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.launch_source import (
    PROCEDURES,
    SYSTEMS,
    find_exploration,
    find_launch_file,
    prestart_fork_server,
)
from palpate.tools.cli import command_line

PERFORMING = ("composed", "as_json", "quiet", "verbose", "view")


@click.command("run")
@click.argument("scene", default="vase", shell_complete=command_line.complete_scene)
@command_line.RUN_FOLDER
@click.option("--seed", type=command_line.SEED, help="Overrides the scene's seed.")
@command_line.unit_option("Of a mesh: its file tells none.")
@command_line.SIZE
@click.option(
    "--up", type=click.Choice(["z", "-z", "y", "-y", "x", "-x"]), help="Of a mesh: what points up."
)
@click.option("--pose", metavar="X,Y,Z[,QX,QY,QZ,QW]", help="Where the object stands, m.")
@click.option(
    "--noise", type=click.Choice(["none", "low", "default", "high"]), help="Of finger and taxels."
)
@click.option("--fingers", type=int, help="Fingers that explore at once, 1 to 8.")
@click.option(
    "--procedure",
    type=click.Choice(PROCEDURES),
    help="An exploratory procedure instead of slices: docs/procedures.md.",
)
@click.option(
    "--system", type=click.Choice([*SYSTEMS]), help="Whose parts explore: docs/thesis.md."
)
@click.option("--tolerance", metavar="LENGTH", help="Error asked for, as 0.2mm: rms of the solid.")
@click.option("--feature", metavar="LENGTH", help="Largest height that may stay untouched, as 5mm.")
@click.option("--budget", metavar="TIME", help="Robot time that may pass, grasp included, as 300s.")
@click.option("--touches", type=int, help="Touches that may be made.")
@click.option(
    "--underside",
    type=click.Choice(["flat", "known"]),
    help="What the object stands on: taken for flat, or not done until it is known.",
)
@click.option(
    "--turns",
    type=int,
    help="Times that the object may be set down on another side; 1 where that pays.",
)
@click.option(
    "--quality",
    type=click.Choice(["draft", "normal", "fine"]),
    help="Of the final mesh: 6,000, 45,000 or 180,000 faces.",
)
@command_line.SETTINGS
@command_line.COMPOSED
@command_line.REALTIME
@command_line.VIEW
@click.option("--no-record", is_flag=True, help="Do not keep the messages.")
@command_line.UNTRUSTED
@command_line.JSON
@command_line.quiet_option()
@command_line.VERBOSE
def run_command(
    scene: str,
    procedure: str | None,
    system: str | None,
    settings: tuple[str, ...],
    no_record: bool,
    **asked: Any,
) -> int:
    """Explore SCENE, a shipped scene's name, a YAML file or a mesh, and rebuild its object.

    It ends once the error is within --tolerance in 95 of 100 runs, and nothing higher than
    --feature is untouched, which follows the tolerance if it is left out; or once --budget or
    --touches is spent, which are never exceeded. Exits with 1 if the tolerance was not reached.
    """
    from palpate.launch.graph import read_settings
    from palpate.launch.scene import find_scene

    if not asked["composed"]:
        prestart_fork_server(find_exploration(procedure, system))
    from palpate.tools.exploration import perform_and_print, plan_exploration

    performing = {key: asked.pop(key) for key in PERFORMING}
    plan = plan_exploration(
        find_scene(scene),
        settings=read_settings(settings),
        record=not no_record,
        procedure=procedure,
        system=system,
        **asked,
    )
    return perform_and_print(plan, **performing)


@click.command("launch")
@click.argument("file", type=command_line.PATH)
@click.argument("arguments", nargs=-1, metavar="[ARG:=VALUE]...")
@click.option("--show-args", "-s", is_flag=True, help="Print the arguments; start nothing.")
@click.option("--print", "-p", "only_print", is_flag=True, help="Print the wiring; start nothing.")
@command_line.picture_option(
    "--graph", "Draw the wiring, to standard output if no file is named; start nothing."
)
@command_line.RUN_FOLDER
@command_line.SETTINGS
@command_line.COMPOSED
@command_line.REALTIME
@command_line.VIEW
@command_line.JSON
@command_line.quiet_option()
@command_line.VERBOSE
def launch_command(
    file: Path,
    arguments: tuple[str, ...],
    out: Path | None,
    settings: tuple[str, ...],
    realtime: bool,
    show_args: bool,
    only_print: bool,
    picture: Path | None,
    **how: bool,
) -> int:
    """Start the graph that FILE describes; explore.yaml is the one that comes with palpate."""
    from palpate.launch.graph import read_arguments, read_settings
    from palpate.launch.launch_file import arguments_table, list_arguments
    from palpate.launch.run import check_run, plan_run

    path = find_launch_file(file)
    if show_args:
        taken = list_arguments(path)
        text = arguments_table(path, taken)
        command_line.print_figures(taken, text, as_json=how["as_json"])
        return 0
    if not (how["composed"] or only_print or picture):
        prestart_fork_server(path)
    from palpate.tools.exploration import perform_and_print

    args, given = read_arguments(arguments), read_settings(settings)
    if not (only_print or picture):
        plan = plan_run(path, args, given, name=path.stem, out=out, realtime=realtime)
        return perform_and_print(plan, **how)
    described, _ = check_run(path, args, given, out or Path("runs"))
    if only_print:
        text = f"launch file {path}\n{described.graph.table()}"
        command_line.print_figures(described.graph.links(), text, as_json=how["as_json"])
    if picture:
        from palpate.tools.graph_drawing import write_picture

        write_picture(described.graph, picture, f"Wiring of {path.name}")
    return 0


@click.command("replay")
@command_line.BAG
@command_line.names_option("--nodes", "Nodes to run; all exact ones if none.")
@command_line.SETTINGS
@click.option("--from", "place", metavar="contour=N|end", help="Go on with the exploration.")
@command_line.out_option("With --from: the run directory.")
@command_line.JSON
@command_line.quiet_option("With --from: print nothing.")
def replay_command(
    bag: Path, nodes: tuple[str, ...], settings: tuple[str, ...], place: str | None, **how: Any
) -> int:
    """Run nodes on the recording BAG and compare what they publish with what they had.

    BAG is a topics.mcap, or the folder of a run. What one of the nodes publishes now is what the
    others receive; all else comes from the recording. A table tells what has changed, by topic and
    field.

    Exits with 0 if all of it is identical, with 1 if not, or if a node fails. With --set the table
    is what was asked for: then it exits with 1 only if a node fails.

    With --from contour=12 or --from end, the exploration goes on from there, in a new run
    directory, and comes to the solid of a run that was never interrupted. What was recorded is gone
    through without being published; what acts on the world does nothing again.
    """
    from palpate.launch.graph import read_settings
    from palpate.tools.replay.rerun import replay as replay_recording

    if place is not None:
        if settings:
            raise InputError("--set and --from exclude each other: other parameters, other solid")
        return _resume(bag, place, nodes, **how)
    if how["out"] is not None or how["quiet"]:
        raise InputError("--out and --quiet belong to --from")
    with as_input_errors():
        given = read_settings(settings)
        return replay_recording(bag, nodes, click.echo, settings=given, as_json=how["as_json"])


def _resume(bag: Path, place: str, nodes: tuple[str, ...], out: Path | None, **how: bool) -> int:
    from palpate.tools.exploration import perform_and_print
    from palpate.tools.replay.rerun import past_differences, plan_resume

    kind, _, number = place.partition("=")
    if place != "end" and not (kind == "contour" and number.isdecimal() and int(number) > 0):
        raise InputError(f"--from {place}: must look like contour=12, or be the word end")
    bag = bag.resolve()  # the link ``latest`` will be the new run's
    with as_input_errors():
        plan = plan_resume(bag, int(number) if number else None, nodes=nodes, out=out)
    code = perform_and_print(plan, composed=False, **how)
    different = past_differences(bag, plan.folder.path) if code in (0, 1) else ""
    if different:
        click.echo(f"palpate: {different}", err=True)
    return 1 if different else code
