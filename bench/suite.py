"""``palpate dev bench``: what it measures, by name. The verb is found by name."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click

from palpate.bench.results import ResultsFile, comparison_lines, read_results
from palpate.bench.table import Group, named, run_groups
from palpate.launch.files import check_new
from palpate.tools.cli import JSON, out_option

SPEED = "speed/scenes"  # The group that takes an older checkout
RESULTS = click.Path(dir_okay=False, path_type=Path)


class Bench(NamedTuple):
    """What ``palpate dev bench`` measures by one name."""

    told: str  # What it measures, for the help
    # ``module:function`` by name, within palpate.bench, each imported at its turn; quickest first.
    groups: Mapping[str, str]


BENCHES: Mapping[str, Bench] = {
    "speed": Bench(
        "the shipped scenes from start to exit: accuracy, and where their time goes, in turns with "
        "an older checkout (--against); a touch by its taxels; splines against scipy's; and how "
        "runs grow",
        {
            "touches": "speed:touch_rows",
            "splines": "splines:spline_rows",
            "scenes": "speed:scene_rows",
            "growth": "speed:growth_rows",
        },
    ),
    "procedures": Bench(
        "every exploratory procedure on twelve objects: error, touches, robot time, and what it "
        "cannot do (docs/procedures.md)",
        {"procedures": "procedures:procedure_rows"},
    ),
}
ALL = "all"
BENCH_HELP = """Measure one thing, or all, here and now.

\b
{benches}

The exit code is 0 if everything was measured that was to be. A demand that is not met is printed
with MISSED; with --strict it makes the exit code 1, as a group that fails always does.

--compare says which figures moved: if they were repeated, by more than the repeats differ; else
counts by anything, times by 10 %, and the rest by 2 %.
"""


def _help() -> str:
    told = {**{name: one.told for name, one in BENCHES.items()}, ALL: "all of these"}
    wrap = textwrap.TextWrapper(76, subsequent_indent=11 * " ", break_on_hyphens=False)
    return BENCH_HELP.format(benches="\n".join(wrap.fill(f"{n:<10} {t}") for n, t in told.items()))


@click.command("bench", help=_help())
@click.argument("what", type=click.Choice([*BENCHES, ALL]), default="speed")
@click.option("--quick", is_flag=True, help="Fewer scenes, messages or frames.")
@click.option("--only", metavar="GROUP", help="One group of figures.")
@JSON
@out_option("Write the results here, as JSON.", type=RESULTS)
@click.option("--compare", metavar="OLD", type=RESULTS, help="Say what moved since these results.")
@click.option("--strict", is_flag=True, help="Exit with 1 if a demand is missed.")
@click.option(
    "--against",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="An older checkout, with which scenes are run in turns.",
)
def bench_command(
    what: str, only: str | None, out: Path | None, compare: Path | None, quick: bool, **how: Any
) -> int:
    """Measure one thing or all; `_help` says which there are."""
    chosen = _chosen(what, only, how.pop("against"))
    old = None if compare is None else read_results(compare, quick=quick)
    if out is not None:
        check_new(out)
    kept = ResultsFile(out, quick=quick)
    code = run_groups(chosen, quick=quick, echo=click.echo, keep=kept.add, **how)
    if old is not None and compare is not None:
        for line in comparison_lines(old, kept.results, compare):
            click.echo(line, err=how["as_json"])
    return code


def _chosen(what: str, only: str | None, against: Path | None) -> Mapping[str, str | Group]:
    """Groups as ``bench/group``, each with where it is or what measures it."""
    benches = BENCHES if what == ALL else {what: BENCHES[what]}
    places = {
        f"{bench}/{group}": f"palpate.bench.{place}"
        for bench, one in benches.items()
        for group, place in one.groups.items()
    }
    if only is not None:
        wanted = only if what == ALL else f"{what}/{only}"
        if wanted not in places:
            known = places if what == ALL else benches[what].groups
            raise click.UsageError(f"there is no group {only!r}; there are {', '.join(known)}")
        places = {wanted: places[wanted]}
    if against is None:
        return places
    if SPEED not in places:
        raise click.UsageError("--against belongs to speed")
    return {**places, SPEED: partial(named(places[SPEED]), against=against)}
