"""``palpate node``: which kinds of node there are, what they hear, say and take."""

from __future__ import annotations

import click


@click.group("node")
def command() -> None:
    """List the kinds of node and what they hear and say."""


@command.command("list")
def list_nodes() -> None:
    """Name the kinds of node."""
    from palpate.launch.kinds import kinds

    for name in kinds():
        click.echo(name)


@command.command("info")
@click.argument("kind")
def info(kind: str) -> None:
    """Say what a node of this KIND hears and says, and its parameters."""
    from palpate.launch.kinds import describe_kind

    click.echo(describe_kind(kind))
