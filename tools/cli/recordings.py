"""Commands on recordings: bag, with its subcommands, and cost."""

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


@bag_group.command("info", short_help="Show the contents of a recording.")
@command_line.BAG
@command_line.JSON
def bag_info_command(bag: Path, as_json: bool) -> int:
    """Show the contents of the recording BAG.

    BAG is a run directory or an MCAP file. A table shows the number of messages of each topic,
    their uncompressed bytes, and their share of all bytes. A damaged recording is shown up to the
    damage.

    Exits with 0 if the recording is intact, with 1 if it is damaged or was never closed.
    """
    from palpate.tools.bag.contents import bag_info, info_text

    info = bag_info(bag)
    command_line.print_figures(info, info_text(info), as_json=as_json)
    return 0 if info["closed"] else 1


@bag_group.command("record", short_help="Record a running graph.")
@command_line.out_option("The new file. Default: palpate_ with date and time.")
@command_line.TOPICS
@click.option("--duration", type=click.FloatRange(0.0, min_open=True), help="End after, s.")
@command_line.RUN
def bag_record_command(
    out: Path | None, topics: tuple[str, ...], duration: float | None, run: str | None
) -> int:
    """Record a running graph until it ends, or Ctrl-C, from its first message on.

    Earlier messages, and messages that are lost on the way, are requested from the nodes. A topic
    without a subscriber is recorded from now on only. A graph of palpate run or launch records
    itself; this command is for graphs that do not, or for some topics.

    Exits with 1 if messages are missing.
    """
    from palpate.launch.processes.registry import find_run
    from palpate.tools.bag.live_recording import default_path, record_graph, recorded_text
    from palpate.tools.introspection.topics import STATUS_TOPICS, find_topics, topics_of

    with as_input_errors():
        card = find_run(run)
        known = topics_of(card)
        names = topics or [name for name in known if name not in STATUS_TOPICS]
        chosen = find_topics(card, names)
        path = out or default_path()
        done = record_graph(card, chosen, path, duration=duration, echo=click.echo)
    click.echo(recorded_text(done))
    return int(bool(done.lost))


@bag_group.command("play", short_help="Publish the messages of a recording again, at their pace.")
@command_line.BAG
@click.option(
    "-r", "--rate", default=1.0, show_default=True, help="Speed, over that of the recording."
)
@click.option("-l", "--loop", is_flag=True, help="Start again at the end, until Ctrl-C.")
@click.option("--start-offset", default=0.0, help="Start, s after the first message.")
@click.option("--until", type=float, help="End, s after the first message.")
@command_line.TOPICS
@click.option("-m", "--remap", multiple=True, metavar="OLD:=NEW", help="Rename; repeatable.")
@click.option(
    "--clock",
    type=float,
    is_flag=False,
    flag_value=40.0,
    default=0.0,
    metavar="[HZ]",
    help="Publish the time of the recording on /clock; default: 40 times a second.",
)
@click.option("-p", "--start-paused", "paused", is_flag=True, help="Wait for resume or step.")
@command_line.quiet_option()
def bag_play_command(bag: Path, remap: tuple[str, ...], quiet: bool, **params: Any) -> int:
    """Publish the messages of the recording BAG, a file or a run directory, again.

    Latched messages from before the offset are published first. Tools receive the messages as from
    any graph: palpate topic echo. In a terminal the space bar pauses and resumes, the right arrow
    steps; palpate bag pause, resume and step do so from another terminal.
    """
    from palpate.tools.bag.playback import play_recording, player_entry, read_remap

    return play_recording(player_entry(bag, params, read_remap(remap)), quiet=quiet)


def control_player(run: str | None, kind: str) -> None:
    """Send a request to the player of a running graph."""
    from palpate.tools.introspection import requests

    requests.control_player(run, kind)


for verb in ("pause", "resume"):
    bag_group.command(
        verb,
        short_help=f"{verb.capitalize()} a player.",
        help=f"{verb.capitalize()} the player of a running graph.",
    )(command_line.RUN(partial(control_player, kind=verb)))


@bag_group.command("step", short_help="Publish the next message of a paused player.")
@click.option("-n", "--messages", type=click.IntRange(1, 1 << 31), default=1, show_default=True)
@command_line.RUN
def bag_step_command(messages: int, run: str | None) -> None:
    """Publish the next MESSAGES of the paused player of a running graph."""
    from palpate.tools.introspection import requests

    requests.control_player(run, "step", number=messages)


@bag_group.command("recover", short_help="Save the intact beginning of a damaged recording.")
@command_line.BAG
@command_line.out_option("The new file. Default: NAME.recovered.mcap beside BAG.")
@command_line.JSON
def bag_recover_command(bag: Path, out: Path | None, as_json: bool) -> int:
    """Save the intact beginning of the recording BAG.

    BAG is a run directory or an MCAP file. All messages up to the first damage are written into a
    new recording, with all other records; parts that a restarted recorder wrote are joined. The
    new file is read again and compared before it is put in its place.
    """
    from palpate.tools.bag.contents import recover_recording, recovered_text

    recovered = recover_recording(bag, out)
    text = recovered_text(recovered)
    command_line.print_figures(recovered.figures(), text, as_json=as_json)
    return 0


@bag_group.command("diff", short_help="Name the first message in which two recordings differ.")
@click.argument("a", **command_line.RUN_PATH)
@click.argument("b", **command_line.RUN_PATH)
@command_line.TOPICS
@command_line.JSON
def bag_diff_command(a: Path, b: Path, topics: tuple[str, ...], as_json: bool) -> int:
    """Compare the recordings A and B, message by message, topic by topic.

    Each is a topics.mcap, or the folder of a run. The n-th message of a topic in A is compared with
    the n-th in B. Names the first message that differs, in the order of sending in A, and counts
    all that do. Times, restarts and the order between topics are ignored.

    Exits with 0 if they are identical, with 1 if not, with 2 if one cannot be read.
    """
    from palpate.tools.bag.contents import compare_recordings, diff_text

    with as_input_errors():
        diff = compare_recordings(a, b, topics)
    command_line.print_figures(diff.figures(), diff_text(diff), as_json=as_json)
    return int(bool(diff.first))


@bag_group.command("export", short_help="Write a recording in a format that other programs read.")
@command_line.BAG
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    required=True,
    help="csv, ply, npz, foxglove, rerun, or one that another package adds.",
)
@command_line.out_option("The new file or folder.", required=True)
@command_line.TOPICS
def bag_export_command(bag: Path, kind: str, out: Path, topics: tuple[str, ...]) -> None:
    """Write the recording BAG in a format that other programs read.

    BAG is a run directory or an MCAP file, which must not be damaged: see palpate bag recover.

    csv is a folder with a table for each topic, a row for each message, and units.json; meshes are
    left to ply, a folder with a file for each message. npz is one file with an array for each
    field, messages first, for numpy.load. foxglove is an MCAP file in JSON for Foxglove, with
    models, contours, touched points, the finger and the log. rerun is an RRD file for Rerun, with
    the tactile image, error and bound as well; it needs pip install 'palpate[rerun]'.
    """
    from palpate.tools.bag.export import export_bag

    click.echo(export_bag(bag, kind, out, topics))


@click.command("cost")
@click.argument("run", **command_line.RUN_PATH)
@click.option(
    "--robot", "robots", multiple=True, metavar="NAME", help="Only this robot. Repeatable."
)
@command_line.picture_option(
    "--plot", "Draw error and bound against cost, to standard output if no file is named."
)
@command_line.JSON
def cost_command(run: Path, robots: tuple[str, ...], picture: Path | None, as_json: bool) -> int:
    """Compute the time of the moves of RUN, in s, for each robot.

    RUN is the folder of a run, or its topics.mcap. A recording has the distance, the turn and the
    approach of each touch, from which its time follows for any arm: modern, a collaborative one of
    today; puma, one of the 1990s; sliding, the modern one, if it stayed on the surface between two
    touches of a contour. The computing time by node and by step follows, with the diagnostics of
    the last fit.

    With --plot the cost of accuracy is drawn instead: true error and stated bound after each
    contour against touches, robot time and compute time, the predicted cost of halving the error,
    and the processor time by step. Each run writes this drawing to cost.svg; docs/cost.md explains
    it.
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
