"""Commands that start graphs: run, launch and replay."""

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
@click.option("--seed", type=command_line.SEED, help="Overrides the seed of the scene.")
@command_line.unit_option("Unit of a mesh.")
@command_line.SIZE
@click.option(
    "--up",
    type=click.Choice(["z", "-z", "y", "-y", "x", "-x"]),
    help="Axis of a mesh that points up.",
)
@click.option(
    "--pose", metavar="X,Y,Z[,QX,QY,QZ,QW]", help="Position of the object, m, and its rotation."
)
@click.option(
    "--noise",
    type=click.Choice(["none", "low", "default", "high"]),
    help="Noise of finger and taxels.",
)
@click.option("--fingers", type=int, help="Fingers that explore at once, 1 to 8.")
@click.option(
    "--procedure",
    type=click.Choice(PROCEDURES),
    help="An exploratory procedure instead of slices: docs/procedures.md.",
)
@click.option(
    "--system",
    type=click.Choice([*SYSTEMS]),
    help="Nodes of palpate or of the thesis: docs/thesis.md.",
)
@click.option("--tolerance", metavar="LENGTH", help="Demanded rms error of the solid: 0.2mm.")
@click.option("--feature", metavar="LENGTH", help="Largest height that may stay untouched: 5mm.")
@click.option("--budget", metavar="TIME", help="Largest robot time, with the grasp: 300s.")
@click.option("--touches", type=int, help="Largest number of touches.")
@click.option(
    "--underside",
    type=click.Choice(["flat", "known"]),
    help="Underside of the object: assumed to be flat, or touched after turning it over.",
)
@click.option(
    "--turns",
    type=int,
    help="Largest number of times that the object is turned over, where that pays; default 1.",
)
@click.option(
    "--quality",
    type=click.Choice(["draft", "normal", "fine"]),
    help="Quality of the final mesh: 6,000, 45,000 or 180,000 faces.",
)
@command_line.SETTINGS
@command_line.COMPOSED
@command_line.REALTIME
@command_line.VIEW
@click.option("--no-record", is_flag=True, help="Do not record the messages.")
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

    The run ends when the error is below --tolerance in 95 of 100 runs, and nothing higher than
    --feature, which by default follows from the tolerance, is untouched; or when --budget or
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
    """Start the graph of the launch file FILE; explore.yaml is that of palpate run."""
    from palpate.launch.graph import read_arguments, read_settings
    from palpate.launch.launch_file import arguments_table, list_arguments
    from palpate.launch.run import check_run, plan_run

    path = find_launch_file(file)
    if show_args:
        listed = list_arguments(path)
        text = arguments_table(path, listed)
        command_line.print_figures(listed, text, as_json=how["as_json"])
        return 0
    if not (how["composed"] or only_print or picture):
        prestart_fork_server(path)
    from palpate.tools.exploration import perform_and_print

    args, parameters = read_arguments(arguments), read_settings(settings)
    if not (only_print or picture):
        plan = plan_run(path, args, parameters, name=path.stem, out=out, realtime=realtime)
        return perform_and_print(plan, **how)
    described, _ = check_run(path, args, parameters, out or Path("runs"))
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
@click.option("--from", "place", metavar="contour=N|end", help="Continue the exploration.")
@command_line.out_option("With --from: the run directory.")
@command_line.JSON
@command_line.quiet_option("With --from: print nothing.")
def replay_command(
    bag: Path, nodes: tuple[str, ...], settings: tuple[str, ...], place: str | None, **how: Any
) -> int:
    """Run nodes on the recording BAG and compare what they publish with what they had.

    BAG is a topics.mcap, or the folder of a run. The nodes receive what they publish to each other
    now, and all other messages from the recording. A table shows the differences by topic and
    field.

    Exits with 0 if all messages are identical, with 1 if not, or if a node fails. With --set
    differences are expected: then it exits with 1 only if a node fails.

    With --from contour=12 or --from end, the exploration continues from there, in a new run
    directory, with the same solid as a run that was never interrupted. Recorded messages are
    processed without being published, and no move is made again.
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
        parameters = read_settings(settings)
        return replay_recording(bag, nodes, click.echo, settings=parameters, as_json=how["as_json"])


def _resume(bag: Path, place: str, nodes: tuple[str, ...], out: Path | None, **how: bool) -> int:
    from palpate.tools.exploration import perform_and_print
    from palpate.tools.replay.rerun import past_differences, plan_resume

    kind, _, number = place.partition("=")
    if place != "end" and not (kind == "contour" and number.isdecimal() and int(number) > 0):
        raise InputError(f"--from {place}: must look like contour=12, or be the word end")
    bag = bag.resolve()  # the link ``latest`` will point to the new run
    with as_input_errors():
        plan = plan_resume(bag, int(number) if number else None, nodes=nodes, out=out)
    code = perform_and_print(plan, composed=False, **how)
    differences = past_differences(bag, plan.folder.path) if code in (0, 1) else ""
    if differences:
        click.echo(f"palpate: {differences}", err=True)
    return 1 if differences else code
