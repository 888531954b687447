"""``palpate replay``: the same nodes on the same messages must say the same."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.launch.located import InputError


@click.command("replay")
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--nodes", default="", metavar="A,B", help="Nodes to run; all exact ones if none.")
def command(bag: Path, nodes: str) -> int:
    """Run nodes on the recording BAG and compare what they say with what they said.

    Exits with 0 if all of it is identical, with 1 and the first difference if not.
    """
    names = tuple(name.strip() for name in nodes.split(",") if name.strip())
    from palpate.launch.replay import replay

    try:
        return replay(bag, names, click.echo)
    except ValueError as error:
        raise InputError(str(error)) from None
