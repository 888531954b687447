"""``palpate topic delay``: how long messages are on their way."""

from __future__ import annotations

import click

from palpate.launch.cli.topic.measuring import measure, measuring


@click.command("delay")
@measuring
def command(
    topics: tuple[str, ...], run: str | None, window: int, every: bool, duration: float | None
) -> None:
    """Measure how long messages of TOPICs are on their way to this tool."""
    from palpate.launch.looking.rate_text import delay_text

    measure(topics, run, window=window, every=every, duration=duration, say=delay_text)
