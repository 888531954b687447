"""``palpate bench``: speed and accuracy, measured here. Found by the command line by name."""

from __future__ import annotations

from collections.abc import Callable

import click

WHAT = ("scenes", "explore", "bus", "touch", "effects", "curvature", "shapes", "rebuild")
BENCH_HELP = """Measure one of eight things, here and now.

\b
scenes     the shipped scenes from start to end: accuracy and time
explore    tracing, grasps and planners; whole explorations of sixteen objects, and whether
           what a run says of its error is so; takes hours without --quick or --only
bus        the message bus alone: losses, latency, a million messages among stalls and deaths,
           start, lock between machines, tools; and damaged messages and files, of which none may
           do more than be refused
touch      one touch: frames a second, and the error of cast and curvature
effects    each effect: its cost, and the error of a contour that it causes
curvature  filters and estimators against noise and impulses
shapes     superquadrics, splines and other models: exactness, recoveries, costs
rebuild    solids from contours: errors over those of lofts, radial functions and the
           thesis on eight objects, disorder, stray points, trust and costs
"""


@click.command("bench", help=BENCH_HELP)
@click.argument("what", type=click.Choice(WHAT), default="scenes")
@click.option("--quick", is_flag=True, help="Fewer scenes, messages or frames.")
@click.option(
    "--figures",
    type=click.Path(file_okay=False),
    help="With curvature, shapes or rebuild: write their figures here.",
)
@click.option("--only", metavar="GROUP", help="With bus or explore: one group of figures.")
@click.option("--json", "as_json", is_flag=True, help="With explore: one JSON object a line.")
def bench_command(
    what: str, quick: bool, figures: str | None, only: str | None, as_json: bool
) -> int:
    """Measure one thing; `BENCH_HELP` says which there are."""
    if figures is not None:
        _write_figures(what, figures)
    if what == "explore":
        return _explore(quick, only, as_json)
    if as_json:
        raise click.UsageError("--json belongs to explore")
    if what == "bus":
        return _bus(quick, only)
    if only is not None:
        raise click.UsageError("--only belongs to bus and explore")
    return _benches()[what](quick)


def _write_figures(what: str, folder: str) -> None:
    if what == "curvature" or what == "shapes":
        pass
    elif what == "rebuild":
        from palpate.bench.suite.figures import write_peer_figures as write_peers
        from palpate.bench.suite.figures import write_thesis_figures

        write_peers(folder)
    else:
        raise click.UsageError("--figures belongs to curvature, shapes and rebuild")
    write_thesis_figures(folder)


def _benches() -> dict[str, Callable[[bool], int]]:
    return {
        "scenes": _scenes,
        "touch": _touch,
        "effects": _effects,
        "curvature": _curvature,
        "shapes": _shapes,
        "rebuild": _rebuild,
    }


def _scenes(quick: bool) -> int:
    from palpate.bench.suite.groups import bench_scenes

    return bench_scenes(quick=quick)


def _explore(quick: bool, only: str | None, as_json: bool) -> int:
    from palpate.bench.suite.groups import EXPLORE_GROUPS, bench_explore

    if only is not None and only not in EXPLORE_GROUPS:
        raise click.UsageError(f"there is no group {only!r}; there are {', '.join(EXPLORE_GROUPS)}")
    return bench_explore(quick=quick, only=only, as_json=as_json, echo=click.echo)


def _bus(quick: bool, only: str | None) -> int:
    from palpate.bench.suite.groups import BUS_GROUPS
    from palpate.bench.table import print_groups

    if only is not None and only not in BUS_GROUPS:
        raise click.UsageError(f"there is no group {only!r}; there are {', '.join(BUS_GROUPS)}")
    chosen = BUS_GROUPS.values() if only is None else (BUS_GROUPS[only],)
    return print_groups(chosen, quick=quick, echo=click.echo)


def _touch(quick: bool) -> int:
    from palpate.bench.touch import bench_touch

    return bench_touch(quick=quick, echo=click.echo)


def _effects(quick: bool) -> int:
    from palpate.bench.touch import bench_effects

    return bench_effects(quick=quick, echo=click.echo)


def _curvature(quick: bool) -> int:
    from palpate.bench.touch import bench_curvature

    return bench_curvature(quick=quick, echo=click.echo)


def _shapes(quick: bool) -> int:
    from palpate.bench.suite.groups import SHAPE_GROUPS
    from palpate.bench.table import print_groups

    return print_groups(SHAPE_GROUPS, quick=quick, echo=click.echo)


def _rebuild(quick: bool) -> int:
    from palpate.bench.suite.groups import REBUILD_GROUPS
    from palpate.bench.table import print_groups

    return print_groups(REBUILD_GROUPS, quick=quick, echo=click.echo)
