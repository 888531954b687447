"""``palpate topic pub``: speak to a running graph through its console."""

from __future__ import annotations

import click


@click.command("pub")
@click.argument("topic")
@click.argument("body")
@click.option("-r", "--rate", default=1.0, show_default=True, help="Messages in a second.")
@click.option("-1", "--once", is_flag=True, help="Publish once.")
@click.option("-t", "--times", type=click.IntRange(1), help="Publish so many times.")
@click.option("--run", metavar="ID", help="Which running graph; the latest if left out.")
def command(
    topic: str, body: str, rate: float, once: bool, times: int | None, run: str | None
) -> None:
    r"""Publish BODY, a message's fields in YAML, on TOPIC.

    A graph has one publisher for each topic. So what is to be spoken from outside belongs to a
    console in its launch file:

    \b
        console: {params: {topics: {/finger/goal: TouchGoal}}}

    What is published is recorded and heard like any other message.
    """
    from palpate.launch.looking.publish import publish

    publish(topic, body, rate=rate, times=1 if once else times, run=run, echo=click.echo)
