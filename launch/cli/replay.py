"""``palpate replay``: the same nodes on the same messages must say the same."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.launch.located import InputError

HELP = """Run nodes on the recording BAG and compare what they say with what they had said.

BAG is a topics.mcap, or the folder of a run. What one of the nodes says now is what the others
hear; all else comes from the recording. A table tells what has changed, by topic and field.

Exits with 0 if all of it is identical, with 1 if not, or if a node fails. With --set the table is
what was asked for: then it exits with 1 only if a node fails.
"""


@click.command("replay", help=HELP)
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--nodes", default="", metavar="A,B", help="Nodes to run; all exact ones if none.")
@click.option("--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable.")
def command(bag: Path, nodes: str, settings: tuple[str, ...]) -> int:
    """Run nodes of a recording again; `HELP` says how."""
    names = tuple(name.strip() for name in nodes.split(",") if name.strip())
    from palpate.launch.override import read_settings
    from palpate.launch.replay.again import replay

    try:
        return replay(bag, names, click.echo, settings=read_settings(settings))
    except ValueError as error:
        raise InputError(str(error)) from None
