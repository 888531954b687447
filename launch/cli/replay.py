"""``palpate replay``: the same nodes on the same messages must say the same."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("replay")
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--nodes", required=True, metavar="A,B", help="Nodes to run, by name.")
def command(bag: Path, nodes: str) -> int:
    """Run nodes on the recording BAG and compare what they say with what they said."""
    names = tuple(name.strip() for name in nodes.split(",") if name.strip())
    if not names:
        raise click.UsageError("--nodes names no node; give it as filter,curvature")
    from palpate.launch.replay import replay

    return replay(bag, names)
