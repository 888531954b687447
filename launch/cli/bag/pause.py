"""``palpate bag pause``: a word to a player."""

from __future__ import annotations

import click


@click.command("pause")
@click.option("--run", metavar="ID", help="Which running graph; the latest if left out.")
def command(run: str | None) -> None:
    """Have the player of a running graph stand still."""
    from palpate.launch.bag.control import control

    control(run, "pause")
