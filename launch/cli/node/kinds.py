"""``palpate node kinds``: which kinds of node there are, what they hear, say and take."""

from __future__ import annotations

import click


@click.command("kinds")
@click.argument("kind", required=False)
def command(kind: str | None) -> None:
    """Name the kinds of node; of one KIND, say what it hears and says, and its parameters."""
    from palpate.launch.kinds import describe_kind, kinds

    for line in kinds() if kind is None else [describe_kind(kind)]:
        click.echo(line)
