"""Verbs on recordings: bag info, play, pause, resume, step, recover, diff and export, and cost."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.tools.cli import command_line

bag_group = command_line.NamedGroup(
    "bag", help="Look into recordings; record, play, recover, compare and export them."
)


@bag_group.command("info", short_help="Say what a recording holds.")
@command_line.BAG
@command_line.JSON
def bag_info_command(bag: Path, as_json: bool) -> int:
    """Say what the recording BAG holds.

    BAG is a run directory or an MCAP file. A table shows how many messages each topic has, their
    bytes before they were packed, and their share of all. A damaged recording is shown up to the
    damage.

    Exits with 0 if the recording is whole, with 1 if it is damaged or was never closed.
    """
    from palpate.tools.bag.contents import bag_info, info_text

    info = bag_info(bag)
    command_line.print_figures(info, info_text(info), as_json=as_json)
    return 0 if info["closed"] else 1


@bag_group.command("record", short_help="Record a running graph.")
@command_line.out_option("The new file; palpate_ with date and time if left out.")
@command_line.TOPICS
@click.option("--duration", type=click.FloatRange(0.0, min_open=True), help="End after, s.")
@command_line.RUN
def bag_record_command(
    out: Path | None, topics: tuple[str, ...], duration: float | None, run: str | None
) -> int:
    """Record a running graph until it ends, or Ctrl-C, from its first message on.

    What it had published before is asked for, and what is lost on the way as well. What no node
    has subscribed to is recorded from now on only. A graph of palpate run or launch records itself;
    this is for one that does not, or for some of its topics.

    Exits with 1 if something is missing.
    """
    from palpate.launch.processes.registry import find_run
    from palpate.tools.bag.live_recording import default_path, record_graph, recorded_text
    from palpate.tools.introspection.topics import STATUS_TOPICS, find_topics, topics_of

    with as_input_errors():
        card = find_run(run)
        known = topics_of(card)
        names = topics or [name for name in known if name not in STATUS_TOPICS]
        found = find_topics(card, names)
        path = out or default_path()
        done = record_graph(card, found, path, duration=duration, echo=click.echo)
    click.echo(recorded_text(done))
    return int(bool(done.lost))


@bag_group.command("play", short_help="Publish again what a recording holds, at its own pace.")
@command_line.BAG
@click.option("-r", "--rate", default=1.0, show_default=True, help="Recorded s in a second.")
@click.option("-l", "--loop", is_flag=True, help="Begin anew at the end, until Ctrl-C.")
@click.option("--start-offset", default=0.0, help="Begin so many s after the first message.")
@click.option("--until", type=float, help="End so many s after the first message.")
@command_line.TOPICS
@click.option("-m", "--remap", multiple=True, metavar="OLD:=NEW", help="Rename; repeatable.")
@click.option(
    "--clock",
    type=float,
    is_flag=False,
    flag_value=40.0,
    default=0.0,
    metavar="[HZ]",
    help="Publish the recording's time on /clock, 40 times a second if no number is given.",
)
@click.option("-p", "--start-paused", "paused", is_flag=True, help="Wait for resume or step.")
@command_line.quiet_option()
def bag_play_command(bag: Path, remap: tuple[str, ...], quiet: bool, **params: Any) -> int:
    """Publish again what the recording BAG holds: a file, or a run directory.

    Latched messages from before the offset are published first. Tools receive it as from any graph:
    palpate topic echo. In a terminal the space bar pauses and resumes, the right arrow steps;
    palpate bag pause, resume and step do the same from elsewhere.
    """
    from palpate.tools.bag.playback import play_recording, player_entry, read_remap

    return play_recording(player_entry(bag, params, read_remap(remap)), quiet=quiet)


def control_player(run: str | None, kind: str) -> None:
    """Send a request to the player of a running graph."""
    from palpate.tools.introspection import requests

    requests.control_player(run, kind)


for verb, told in (("pause", "stand still"), ("resume", "go on")):
    bag_group.command(
        verb,
        short_help=f"Have a player {told}.",
        help=f"Have the player of a running graph {told}.",
    )(command_line.RUN(partial(control_player, kind=verb)))


@bag_group.command("step", short_help="Have a player that stands still publish the next message.")
@click.option("-n", "--messages", type=click.IntRange(1, 1 << 31), default=1, show_default=True)
@command_line.RUN
def bag_step_command(messages: int, run: str | None) -> None:
    """Have the player of a running graph, if it stands still, publish the next MESSAGES."""
    from palpate.tools.introspection import requests

    requests.control_player(run, "step", number=messages)


@bag_group.command("recover", short_help="Save what is whole of a damaged recording.")
@command_line.BAG
@command_line.out_option("The new file, not there yet; NAME.recovered.mcap beside BAG if left out.")
@command_line.JSON
def bag_recover_command(bag: Path, out: Path | None, as_json: bool) -> int:
    """Save what is whole of the recording BAG.

    BAG is a run directory or an MCAP file. All messages from the beginning to the first damage are
    written into a new recording, with whatever else the recording says; parts that a restarted
    recorder wrote are joined. The new file is read again and compared before it is put in its
    place.
    """
    from palpate.tools.bag.contents import recover_recording, recovered_text

    saved = recover_recording(bag, out)
    text = recovered_text(saved)
    command_line.print_figures(saved.figures(), text, as_json=as_json)
    return 0


@bag_group.command("diff", short_help="Name the first message in which two recordings differ.")
@click.argument("a", **command_line.RUN_PATH)
@click.argument("b", **command_line.RUN_PATH)
@command_line.TOPICS
@command_line.JSON
def bag_diff_command(a: Path, b: Path, topics: tuple[str, ...], as_json: bool) -> int:
    """Compare the recordings A and B, message by message, topic by topic.

    Each is a topics.mcap, or the folder of a run. The n-th message of a topic in A belongs to the
    n-th in B. Names the first message that differs, in the order in which A sent them, and counts
    all that do. Neither times nor restarts matter, nor in which order different topics came.

    Exits with 0 if they are identical, with 1 if not, with 2 if one cannot be read.
    """
    from palpate.tools.bag.contents import compare_recordings, diff_text

    with as_input_errors():
        found = compare_recordings(a, b, topics)
    command_line.print_figures(found.figures(), diff_text(found), as_json=as_json)
    return int(bool(found.first))


@bag_group.command("export", short_help="Write a recording in a format that other programs read.")
@command_line.BAG
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    required=True,
    help="csv, ply, npz, foxglove, rerun, or one that another package adds.",
)
@command_line.out_option("The new file or folder, not there yet.", required=True)
@command_line.TOPICS
def bag_export_command(bag: Path, kind: str, out: Path, topics: tuple[str, ...]) -> None:
    """Write the recording BAG in a format that other programs read.

    BAG is a run directory or an MCAP file, which must not be damaged: see palpate bag recover.

    csv is a folder with one table a topic, one row a message, and units.json beside them; meshes
    are left to ply, a folder with one file a message. npz is one file with an array for each field,
    messages first, for numpy.load. foxglove is an MCAP file in JSON that Foxglove shows: models,
    contours, touched points, the finger and the log. rerun is an RRD file that Rerun shows, of the
    same, the tactile image, error and bound; it needs pip install 'palpate[rerun]'.
    """
    from palpate.tools.bag.export import export_bag

    click.echo(export_bag(bag, kind, out, topics))


@click.command("cost")
@click.argument("run", **command_line.RUN_PATH)
@click.option("--robot", "robots", multiple=True, metavar="NAME", help="Of this only. Repeatable.")
@command_line.picture_option(
    "--plot", "Draw error and bound against cost, to standard output if no file is named."
)
@command_line.JSON
def cost_command(run: Path, robots: tuple[str, ...], picture: Path | None, as_json: bool) -> int:
    """Say what the moves of RUN would have cost each robot, in s.

    RUN is the folder of a run, or its topics.mcap. A recording keeps the way, the turn and the
    approach of each touch, so that its time follows for any arm: modern, a collaborative one of
    today; puma, one of the 1990s; sliding, the modern one, if it stayed on the surface between two
    touches of a contour. Where computing time went follows, by node and by step, with the
    diagnostics of the last fit.

    With --plot it draws instead what accuracy has cost RUN: true error and stated bound
    after each contour against touches, robot time and compute time, what the next halving of the
    error is foretold to cost, and where the processor's time went. Every run leaves this as
    cost.svg; docs/cost.md says how to read it.
    """
    from palpate.launch.run_directory import SUMMARY, read_summary, run_directory_of
    from palpate.launch.summary_text import computing_lines
    from palpate.tools.cost import plot_cost, robot_time, robot_time_text

    if picture is not None:
        if robots or as_json:
            raise InputError("--plot draws the run as it was: leave out --robot and --json")
        plot_cost(run, picture)
        return 0
    costs = robot_time(run, robots)
    command_line.print_figures(costs, robot_time_text(costs), as_json=as_json)
    if not (robots or as_json) and (run_directory_of(run) / SUMMARY).is_file():
        click.echo("\n".join(["", *computing_lines(read_summary(run))]))
    return 0
