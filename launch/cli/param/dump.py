"""``palpate param dump``: the parameters of a running graph's nodes in YAML."""

from __future__ import annotations

import click

from palpate.launch.cli.looking import card_of, refusals, run_option


@click.command("dump")
@click.argument("node", required=False)
@run_option
def command(node: str | None, run: str | None) -> None:
    """Print the parameters of NODE, or of all nodes, in YAML; bytes by their size and SHA-256."""
    from palpate.launch.looking.parameters import dump_params

    with refusals():
        click.echo(dump_params(card_of(run), node))
