"""``palpate topic hz``: how often topics are published."""

from __future__ import annotations

import click

from palpate.launch.cli.topic.measuring import measure, measuring


@click.command("hz")
@measuring
def command(
    topics: tuple[str, ...], run: str | None, window: int, every: bool, duration: float | None
) -> None:
    """Measure how often TOPICs are published, by their publishers' own numbers and times."""
    from palpate.launch.looking.rate_text import rate_text

    measure(topics, run, window=window, every=every, duration=duration, say=rate_text)
