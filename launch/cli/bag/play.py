"""``palpate bag play``: the messages of a recording once more, at their own pace."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("play")
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("-r", "--rate", default=1.0, show_default=True, help="Recorded s in a second.")
@click.option("-l", "--loop", is_flag=True, help="Begin anew at the end, until Ctrl-C.")
@click.option("--start-offset", default=0.0, help="Begin so many s after the first message.")
@click.option("--until", type=float, help="End so many s after the first message.")
@click.option("--topics", multiple=True, metavar="TOPIC", help="Only these; repeatable.")
@click.option("-m", "--remap", multiple=True, metavar="OLD:=NEW", help="Rename; repeatable.")
@click.option(
    "--clock",
    type=float,
    is_flag=False,
    flag_value=40.0,
    default=0.0,
    metavar="[HZ]",
    help="Say the recording's time on /clock, 40 times a second if no number is given.",
)
@click.option("-p", "--start-paused", is_flag=True, help="Wait for resume or step.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    bag: Path,
    rate: float,
    loop: bool,
    start_offset: float,
    until: float | None,
    topics: tuple[str, ...],
    remap: tuple[str, ...],
    clock: float,
    start_paused: bool,
    quiet: bool,
) -> int:
    """Say again what the recording BAG holds: a file, or a run directory.

    Latched messages from before the offset are said first. Tools hear it as they hear any graph:
    palpate topic echo. In a terminal the space bar pauses and resumes, the right arrow steps;
    palpate bag pause, resume and step do the same from elsewhere.
    """
    from palpate.launch.bag.play import play, player_entry, read_remap

    params = {
        "rate": rate,
        "loop": loop,
        "start_offset": start_offset,
        "until": until,
        "topics": list(topics),
        "clock": clock,
        "paused": start_paused,
    }
    return play(player_entry(bag, params, read_remap(remap)), quiet=quiet)
