"""``palpate bench``: speed and accuracy, measured here."""

from __future__ import annotations

import click


@click.command("bench")
@click.argument("what", type=click.Choice(["explore", "bus"]), default="explore")
@click.option("--quick", is_flag=True, help="A few scenes or messages instead of all.")
def command(what: str, quick: bool) -> int:
    """Measure exploring the shipped scenes, or the message BUS alone."""
    if what == "bus":
        from palpate.launch.bench_bus import bench_bus

        click.echo(bench_bus(repeats=5 if quick else 100))
        return 0
    from palpate.launch.bench import bench

    return bench(quick=quick)
