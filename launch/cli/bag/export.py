"""``palpate bag export``: a recording in a format that other programs read."""

from __future__ import annotations

from pathlib import Path

import click

HELP = """Write the recording BAG in a format that other programs read.

BAG is a run directory or an MCAP file, which must not be damaged: see palpate bag recover.

csv is a folder with one table a topic, one row a message, and units.json beside them. npz is one
file with an array for each field, messages first, for numpy.load. foxglove is an MCAP file in JSON
that Foxglove shows: models, contours, touched points, the finger and the log.
"""


@click.command("export", help=HELP)
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "--format", "kind", type=click.Choice(["csv", "npz", "foxglove"]), required=True, help="Format."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="The new file or folder, not there yet.",
)
@click.option("--topics", default="", metavar="A,B", help="Topics to write; all if left out.")
def command(bag: Path, kind: str, output: Path, topics: str) -> None:
    """Export a recording; `HELP` says how."""
    from palpate.launch.bag.export import export_bag

    names = tuple(name.strip() for name in topics.split(",") if name.strip())
    click.echo(export_bag(bag, kind, output, names))
