"""``palpate cost``: what a recorded run would have cost another robot."""

from __future__ import annotations

from pathlib import Path

import click

HELP = """Say what the moves of RUN would have cost each robot, in s.

RUN is the folder of a run, or its topics.mcap. A recording keeps the way, the turn and the approach
of each touch, so that its time follows for any arm: modern, a collaborative one of today; puma, one
of the 1990s; sliding, the modern one, if it stayed on the surface between two touches of a contour.
"""


@click.command("cost", help=HELP)
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--robot", "robots", multiple=True, metavar="NAME", help="Of this only. Repeatable.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def command(run: Path, robots: tuple[str, ...], as_json: bool) -> int:
    """Apply robots to recorded moves; `HELP` says how."""
    import json

    from palpate.launch.robot_time import robot_time
    from palpate.launch.robot_time_text import robot_time_text

    found = robot_time(run, robots)
    click.echo(json.dumps(found, indent=2, allow_nan=False) if as_json else robot_time_text(found))
    return 0
