"""Verbs that start graphs: run, launch, replay, chaos, and host and keys for several machines."""

from __future__ import annotations

import json
from pathlib import Path

import click

from palpate.launch.files import InputError

REPLAY_HELP = """Run nodes on the recording BAG and compare what they publish with what they had.

BAG is a topics.mcap, or the folder of a run. What one of the nodes publishes now is what the others
receive; all else comes from the recording. A table tells what has changed, by topic and field.

Exits with 0 if all of it is identical, with 1 if not, or if a node fails. With --set the table is
what was asked for: then it exits with 1 only if a node fails.

With --from contour=12 or --from end, the exploration goes on from there, in a new run directory,
and comes to the solid of a run that was never interrupted. What was recorded is gone through
without being published; what acts on the world does nothing again.
"""
CHAOS_HELP = """Put faults into running explorations of a scene, and say what they survive.

The scene is explored undisturbed first. Then it is explored again and again, while nodes are
killed and stopped, the recorder has no more room, a source floods it, tools join late and hang,
and the launcher is interrupted and killed. Each run must come to the same solid and the same
messages, and leave a recording that holds every message once; whoever is ended must leave nothing
behind, and go on from its recording to the same end.

\b
Kinds: kill, stop, recorder, full, neighbours, flood, late, ctrl_c, launcher.

Prints one line. Exits with 1 if anything did not survive; what it was, and the seed that repeats
it with --minutes 0, is on standard error. docs/chaos.md says more.
"""


@click.command("run")
@click.argument("scene", default="vase")
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; new or empty.")
@click.option("--seed", type=click.IntRange(0, 1 << 53), help="Overrides the scene's seed.")
@click.option("--fingers", type=int, help="Fingers that explore at once, 1 to 8.")
@click.option("--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable.")
@click.option("--composed", is_flag=True, help="All nodes in one process.")
@click.option("--no-record", is_flag=True, help="Do not keep the messages.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def run_command(
    scene: str,
    out: Path | None,
    seed: int | None,
    fingers: int | None,
    settings: tuple[str, ...],
    composed: bool,
    no_record: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Explore SCENE, a shipped scene's name or a YAML file, and rebuild its object."""
    from palpate.launch import EXPLORE, prestart_fork_server

    if not composed:
        prestart_fork_server(EXPLORE)
    from palpate.launch import find_scene, plan_run, read_settings
    from palpate.launch.files import SourceMapped
    from palpate.tools.report import perform_and_print

    path = find_scene(scene)
    args = {
        "scene": SourceMapped(str(path), ""),
        "record": SourceMapped(not no_record, "--no-record"),
    }
    if seed is not None:
        args["seed"] = SourceMapped(seed, "--seed")
    if fingers is not None:
        args["fingers"] = SourceMapped(fingers, "--fingers")
    plan = plan_run(EXPLORE, args, read_settings(settings), name=path.stem, out=out)
    return perform_and_print(plan, composed=composed, as_json=as_json, quiet=quiet)


@click.command("launch")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("arguments", nargs=-1, metavar="[ARG:=VALUE]...")
@click.option("--show-args", "-s", is_flag=True, help="Print the arguments; start nothing.")
@click.option("--print", "-p", "only_print", is_flag=True, help="Print the wiring; start nothing.")
@click.option(
    "--graph",
    "picture",
    type=click.Path(path_type=Path, allow_dash=True),
    is_flag=False,
    flag_value="-",
    metavar="[OUT.svg]",
    help="Draw the wiring, to standard output if no file is named; start nothing.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; new or empty.")
@click.option("--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable.")
@click.option("--composed", is_flag=True, help="All nodes in one process.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def launch_command(
    file: Path,
    arguments: tuple[str, ...],
    show_args: bool,
    only_print: bool,
    picture: Path | None,
    out: Path | None,
    settings: tuple[str, ...],
    composed: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Start the graph that FILE describes; explore.yaml is the one that comes with palpate."""
    from palpate.launch import find_launch_file, prestart_fork_server

    path = find_launch_file(file)
    if show_args:
        from palpate.launch import arguments_table as table_of

        click.echo(table_of(path))
        return 0
    if not (composed or only_print or picture):
        prestart_fork_server(path)
    from palpate.launch import check_run, plan_run, read_arguments, read_settings
    from palpate.tools.report import perform_and_print

    args, given = read_arguments(arguments), read_settings(settings)
    if not (only_print or picture):
        plan = plan_run(path, args, given, name=path.stem, out=out)
        return perform_and_print(plan, composed=composed, as_json=as_json, quiet=quiet)
    described, _ = check_run(path, args, given, out or Path("runs"))
    if only_print:
        click.echo(f"launch file {path}\n{described.graph.table()}")
    if picture:
        from palpate.tools.graph_drawing import write_picture

        write_picture(described.graph, picture, f"Wiring of {path.name}")
    return 0


@click.command("replay", help=REPLAY_HELP)
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--nodes", default="", metavar="A,B", help="Nodes to run; all exact ones if none.")
@click.option("--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable.")
@click.option("--from", "place", metavar="contour=N|end", help="Go on with the exploration.")
@click.option("--out", type=click.Path(path_type=Path), help="With --from: the run directory.")
@click.option("--json", "as_json", is_flag=True, help="With --from: print summary.json.")
@click.option("--quiet", is_flag=True, help="With --from: print nothing.")
def replay_command(
    bag: Path,
    nodes: str,
    settings: tuple[str, ...],
    place: str | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run nodes of a recording again; `REPLAY_HELP` says how."""
    names = tuple(name.strip() for name in nodes.split(",") if name.strip())
    if place is not None:
        if settings:
            raise InputError("--set and --from exclude each other: other parameters, other solid")
        return _resume(bag, place, names, out, as_json=as_json, quiet=quiet)
    if out is not None or as_json or quiet:
        raise InputError("--out, --json and --quiet belong to --from")
    from palpate.launch import read_settings
    from palpate.tools.replay import replay

    try:
        return replay(bag, names, click.echo, settings=read_settings(settings))
    except ValueError as error:
        raise InputError(str(error)) from None


def _resume(
    bag: Path, place: str, names: tuple[str, ...], out: Path | None, *, as_json: bool, quiet: bool
) -> int:
    from palpate.tools.replay import past_differences, plan_resume
    from palpate.tools.report import perform_and_print

    kind, _, number = place.partition("=")
    if place != "end" and not (kind == "contour" and number.isdecimal() and int(number) > 0):
        raise InputError(f"--from {place}: must look like contour=12, or be the word end")
    try:
        plan = plan_resume(bag, None if place == "end" else int(number), nodes=names, out=out)
    except ValueError as error:
        raise InputError(str(error)) from None
    code = perform_and_print(plan, composed=False, as_json=as_json, quiet=quiet)
    different = past_differences(bag, plan.folder.path) if code == 0 else ""
    if different:
        click.echo(f"palpate: {different}", err=True)
    return 1 if different else code


@click.command("chaos", help=CHAOS_HELP)
@click.option("--seed", type=click.IntRange(0, 1 << 53), default=1, help="Of the first run.")
@click.option("--minutes", type=click.FloatRange(0), default=5.0, help="Begin no run after that.")
@click.option("--scene", default="vase", help="A shipped scene's name or a YAML file.")
@click.option("--fingers", type=click.IntRange(1, 8), default=1, help="Fingers that explore.")
@click.option("--kinds", metavar="A,B", help="Only these faults.")
@click.option("--json", "as_json", is_flag=True, help="Print all figures.")
def chaos_command(
    seed: int, minutes: float, scene: str, fingers: int, kinds: str | None, as_json: bool
) -> int:
    """Put faults into explorations; `CHAOS_HELP` says which."""
    from palpate.launch import find_scene
    from palpate.tools.chaos import Exploration, run_trials

    path = find_scene(scene).resolve()
    subject = Exploration("explore", (f"scene:={path}", f"fingers:={fingers}"))
    try:
        tally = run_trials(
            subject, seed=seed, minutes=minutes, kinds=_fault_kinds(kinds), echo=_print_progress
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    click.echo(json.dumps(tally.figures) if as_json else str(tally))
    for failed, what in tally.failed:
        click.echo(f"palpate: chaos --seed {failed} --minutes 0: {what}", err=True)
    return 1 if tally.failed else 0


def _fault_kinds(text: str | None) -> tuple[str, ...]:
    from palpate.launch.files import hint
    from palpate.tools.chaos import FAULT_KINDS

    named = (
        FAULT_KINDS
        if text is None
        else tuple(one.strip() for one in text.split(",") if one.strip())
    )
    unknown = [one for one in named if one not in FAULT_KINDS]
    if unknown or not named:
        raise InputError(
            f"--kinds {text}: there is no {unknown[0]!r}; {hint(unknown[0], FAULT_KINDS)}"
            if unknown
            else f"--kinds names none; there are {', '.join(FAULT_KINDS)}"
        )
    return named


def _print_progress(line: str) -> None:
    click.echo(line, err=True)


@click.command("host")
@click.argument("address")
def host_command(address: str) -> None:
    """Lend this machine at its ADDRESS, 192.168.1.5 or 192.168.1.5:7447, until Ctrl-C.

    Whoever has the same key (palpate keys) may run nodes here, and nobody else: a node is a
    program. A launch file names the machine with host: ADDRESS.
    """
    from palpate.launch import key_file, read_host, run_host_agent

    where, port = read_host(address)
    try:
        run_host_agent(where, port, key_file(), lambda text: click.echo(text))
    except ValueError as error:
        raise InputError(str(error)) from None


@click.command("keys")
def keys_command() -> None:
    """Make the key that the machines of a graph share.

    Copy it to the same place on the other machines, readable by nobody but you.
    """
    from palpate.launch import key_file
    from palpate.messages.bus import make_key

    path = key_file()
    try:
        make_key(path)
    except FileExistsError as error:
        raise InputError(str(error)) from None
    click.echo(f"{path}: written; copy it to the other machines, to the same place and mode")
