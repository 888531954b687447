"""What ``topic hz``, ``bw`` and ``delay`` share: their arguments, and how they run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from palpate.launch.cli.looking import Command, card_of, refusals, run_option

if TYPE_CHECKING:
    from palpate.launch.looking.rate_text import Say


def measuring(command: Command) -> Command:
    """The arguments of a verb that measures topics."""
    for option in (
        click.option("--duration", type=click.FloatRange(0.0, min_open=True), help="End after, s."),
        click.option("-a", "--all", "every", is_flag=True, help="All topics of the graph."),
        click.option(
            "-w",
            "--window",
            type=click.IntRange(2, 1_000_000),
            default=10_000,
            show_default=True,
            help="Messages over which figures are taken.",
        ),
        run_option,
        click.argument("topics", nargs=-1, metavar="TOPIC..."),
    ):
        command = option(command)
    return command


def measure(
    topics: tuple[str, ...],
    run: str | None,
    *,
    window: int,
    every: bool,
    duration: float | None,
    say: Say,
) -> None:
    """Measure topics of a running graph until it ends, the time is over, or Ctrl-C."""
    from palpate.launch.looking.gauge import Gauge
    from palpate.launch.looking.topics import OWN, find_topics, topics_of

    if every == bool(topics):
        raise click.UsageError("name at least one topic, or take --all of them, not both")
    card = card_of(run)
    with refusals():
        if every:
            found = [one for name, one in topics_of(card).items() if name not in OWN]
        else:
            found = find_topics(card, topics)
        Gauge(found, window, say, click.echo).run(card, found, duration)
