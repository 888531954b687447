"""``palpate bench``: speed and accuracy, measured here. Found by the command line by name."""

from __future__ import annotations

import click

from palpate.bench.suite.groups import BENCHES, FIGURES
from palpate.bench.table import named, run_groups

BENCH_HELP = """Measure one of nine things, here and now.

\b
scenes     the shipped scenes from start to end: accuracy and time
explore    tracing, grasps and planners; whole explorations of sixteen objects, and whether
           what a run says of its error is so; takes hours without --quick or --only
bus        the message bus alone: losses, latency, a million messages among stalls and deaths,
           start, lock between machines, tools; and damaged messages and files, of which none may
           do more than be refused
touch      one touch: frames a second, the error of cast and curvature, and what single calls cost
effects    each effect: its cost, and the error of a contour that it causes
curvature  filters and estimators against noise and impulses
shapes     superquadrics, splines and other models: exactness, recoveries, costs
rebuild    solids from contours: errors over those of lofts, radial functions and the
           thesis on eight objects, disorder, outliers, confidence and costs
house      palpate itself: lines and files, and how many files one frame, one rebuild and one
           plan run through; the sizes alone with --quick
"""


@click.command("bench", help=BENCH_HELP)
@click.argument("what", type=click.Choice(list(BENCHES)), default="scenes")
@click.option("--quick", is_flag=True, help="Fewer scenes, messages or frames.")
@click.option(
    "--figures",
    type=click.Path(file_okay=False),
    help="With curvature, shapes or rebuild: write their figures here.",
)
@click.option("--only", metavar="GROUP", help="One group of figures.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
def bench_command(
    what: str, quick: bool, figures: str | None, only: str | None, as_json: bool
) -> int:
    """Measure one thing; `BENCH_HELP` says which there are."""
    groups = BENCHES[what]
    if only is not None and only not in groups:
        raise click.UsageError(f"there is no group {only!r}; there are {', '.join(groups)}")
    if figures is not None:
        if what not in FIGURES:
            raise click.UsageError(f"--figures belongs to {', '.join(FIGURES)}")
        for place in FIGURES[what]:
            named(place)(figures)
    chosen = groups if only is None else {only: groups[only]}
    return run_groups(chosen, quick=quick, as_json=as_json, echo=click.echo)
