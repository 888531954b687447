"""``palpate bag diff``: whether two runs said the same."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.launch.located import InputError

HELP = """Compare the recordings A and B, message by message, topic by topic.

Each is a topics.mcap, or the folder of a run. The n-th message of a topic in A belongs to the n-th
in B. Names the first message that differs, in the order in which A sent them, and counts all that
do. Neither times nor restarts matter, nor in which order different topics came.

Exits with 0 if they are identical, with 1 if not, with 2 if one cannot be read.
"""


@click.command("diff", help=HELP)
@click.argument("a", metavar="A", type=click.Path(path_type=Path))
@click.argument("b", metavar="B", type=click.Path(path_type=Path))
@click.option("--topics", default="", metavar="/X,/Y", help="Topics to compare; all if none.")
def command(a: Path, b: Path, topics: str) -> int:
    """Compare two recordings; `HELP` says how."""
    from palpate.launch.bag.diff import compare
    from palpate.launch.bag.diff_text import diff_text

    names = tuple(name.strip() for name in topics.split(",") if name.strip())
    try:
        found = compare(a, b, names)
    except ValueError as error:
        raise InputError(str(error)) from None
    click.echo(diff_text(found))
    return int(bool(found.first))
