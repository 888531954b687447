"""``palpate bag recover``: what is whole of a recording, as a new one."""

from __future__ import annotations

from pathlib import Path

import click

HELP = """Save what is whole of the recording BAG.

BAG is a run directory or an MCAP file. All messages from the beginning to the first damage are
written into a new recording, with whatever else the recording says; parts that a restarted recorder
wrote are joined. The new file is read again and compared before it is put in its place.
"""


@click.command("recover", help=HELP)
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="The new file, not there yet; NAME.recovered.mcap beside BAG if left out.",
)
def command(bag: Path, output: Path | None) -> int:
    """Recover a recording; `HELP` says how."""
    from palpate.launch.bag.recover import recover, recovered_text

    click.echo(recovered_text(recover(bag, output)))
    return 0
