"""``palpate topic bw``: how many bytes topics carry."""

from __future__ import annotations

import click

from palpate.launch.cli.topic.measuring import measure, measuring


@click.command("bw")
@measuring
def command(
    topics: tuple[str, ...], run: str | None, window: int, every: bool, duration: float | None
) -> None:
    """Measure how many bytes a second TOPICs carry."""
    from palpate.launch.looking.rate_text import bandwidth_text

    measure(topics, run, window=window, every=every, duration=duration, say=bandwidth_text)
