"""``palpate bag info``: what a recording holds."""

from __future__ import annotations

from pathlib import Path

import click

HELP = """Say what the recording BAG holds.

BAG is a run directory or an MCAP file. A table shows how many messages each topic has, their bytes
before they were packed, and their share of all. A damaged recording is shown up to the damage.

Exits with 0 if the recording is whole, with 1 if it is damaged or was never closed.
"""


@click.command("info", help=HELP)
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON.")
def command(bag: Path, as_json: bool) -> int:
    """Describe a recording; `HELP` says how."""
    import json

    from palpate.launch.bag.info import bag_info
    from palpate.launch.bag.info_text import info_text

    info = bag_info(bag)
    click.echo(json.dumps(info, indent=2, allow_nan=False) if as_json else info_text(info))
    return 0 if info["closed"] else 1
