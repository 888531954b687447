"""``palpate node info``: one node of a running graph."""

from __future__ import annotations

import click

from palpate.launch.cli.looking import card_of, refusals, run_option


@click.command("info")
@click.argument("node")
@run_option
def command(node: str, run: str | None) -> None:
    """Say how NODE is doing, what it hears from whom and says to whom, and its parameters."""
    from palpate.launch.looking.node_text import node_text

    with refusals():
        click.echo(node_text(card_of(run), node))
