"""``palpate topic list``: the topics of a running graph."""

from __future__ import annotations

import click

from palpate.launch.cli.looking import card_of, run_option


@click.command("list")
@run_option
@click.option("-t", "--show-types", is_flag=True, help="Add the type.")
@click.option("-c", "--count-topics", is_flag=True, help="Print only how many there are.")
@click.option("-v", "--verbose", is_flag=True, help="Add who publishes and who listens.")
def command(run: str | None, show_types: bool, count_topics: bool, verbose: bool) -> None:
    """Name the topics of the running graph."""
    from palpate.launch.looking.topics import topics_of

    topics = topics_of(card_of(run)).values()
    if count_topics:
        click.echo(len(topics))
        return
    for topic in topics:
        line = f"{topic.name} [{topic.type}]" if show_types or verbose else topic.name
        if verbose:
            listeners = ", ".join(topic.listeners) or "nobody"
            line += f" from {', '.join(topic.publishers)} to {listeners}"
        click.echo(line)
