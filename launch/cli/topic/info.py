"""``palpate topic info``: one topic of a running graph."""

from __future__ import annotations

import click

from palpate.launch.cli.looking import card_of, refusals, run_option


@click.command("info")
@click.argument("topic")
@run_option
@click.option("-v", "--verbose", is_flag=True, help="Add the fields with their units.")
def command(topic: str, run: str | None, verbose: bool) -> None:
    """Say what TOPIC carries, who publishes it and who listens."""
    from palpate.launch.looking.field_text import field_lines
    from palpate.launch.looking.topics import find_topic, type_of

    with refusals():
        found = find_topic(card_of(run), topic)
        lines = field_lines(type_of(found)) if verbose else []
    click.echo(f"Type: {found.type or 'not said'}")
    click.echo(f"Publisher count: {len(found.publishers)}  {', '.join(found.publishers)}")
    click.echo(f"Subscription count: {len(found.listeners)}  {', '.join(found.listeners)}".rstrip())
    if lines:
        click.echo("Fields:")
    for line in lines:
        click.echo(f"  {line}")
