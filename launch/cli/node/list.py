"""``palpate node list``: the nodes of a running graph."""

from __future__ import annotations

import click

from palpate.launch.cli.looking import card_of, refusals, run_option


@click.command("list")
@run_option
@click.option("-a", "--all", "every", is_flag=True, help="Also nodes that have ended.")
def command(run: str | None, every: bool) -> None:
    """Name the nodes of the running graph."""
    from palpate.launch.looking.node_text import living_nodes

    card = card_of(run)
    with refusals():
        names = sorted(one.name for one in card.nodes) if every else living_nodes(card)
    for name in names:
        click.echo(name)
