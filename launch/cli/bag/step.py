"""``palpate bag step``: a word to a player."""

from __future__ import annotations

import click


@click.command("step")
@click.option("-n", "--messages", type=click.IntRange(1, 1 << 31), default=1, show_default=True)
@click.option("--run", metavar="ID", help="Which running graph; the latest if left out.")
def command(messages: int, run: str | None) -> None:
    """Have the player of a running graph, if it stands still, say the next MESSAGES."""
    from palpate.launch.bag.control import control

    control(run, "step", number=messages)
