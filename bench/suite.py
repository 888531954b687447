"""``palpate bench``: every measurement by its name."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click

from palpate.bench.results import ResultsFile, comparison_lines, read_results
from palpate.bench.table import Group, named, run_groups
from palpate.launch.files.file_access import check_new
from palpate.launch.files.source_map import InputError, hint
from palpate.tools.cli.command_line import JSON, out_option

RESULTS = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
COSTS = ("touches", "robot", "compute")


class Bench(NamedTuple):
    """A measurement of ``palpate bench``."""

    shows: str  # For the list and the help
    # ``module:function`` by name, within palpate.bench; each module is imported at its turn.
    groups: Mapping[str, str]
    options: Mapping[str, Sequence[str]] = {}  # Of each group that takes any
    in_all: bool = True  # Whether `all` includes it; false if it takes hours or needs files


BENCHES: Mapping[str, Bench] = {
    "accuracy": Bench(
        "what accuracy costs: every method on eighteen objects (docs/benchmark.md)",
        {"methods": "accuracy.measuring:accuracy_rows"},
        {"methods": ("sheet", "cost", "meshes", "add", "method")},
        in_all=False,
    ),
    "real": Bench(
        "meshes, or drawn thin objects, explored with noise: errors, bounds, coverage, pictures",
        {"meshes": "real:real_rows"},
        {"meshes": ("sheet", "meshes")},
        in_all=False,
    ),
    "thesis": Bench(
        "the thesis and palpate: curvature, two examples, recordings, and both systems",
        {
            "curvature": "curvature:curvature_rows",
            "examples": "thesis:thesis_rows",
            "recorded": "thesis:recorded_rows",
            "systems": "systems:system_rows",
        },
        {"recorded": ("runs",)},
    ),
    "contours": Bench(
        "solids from contours of eight objects, beside lofts, radial functions and the thesis",
        {"peers": "contours:peer_rows"},
        {"peers": ("sheet",)},
    ),
    "planners": Bench(
        "contours that each planner needs, step templates, and tolerances against results",
        {
            "planners": "planners:planner_rows",
            "templates": "planners:template_rows",
            "tolerances": "tolerances:tolerance_rows",
        },
    ),
    "procedures": Bench(
        "every exploratory procedure on twelve objects: error, touches and robot time",
        {"procedures": "procedures:procedure_rows"},
    ),
    "recognition": Bench(
        "recognition of stored and of other objects in any pose, with noise",
        {"recognition": "recognition:recognition_rows"},
    ),
    "ablation": Bench(
        "each part of palpate: error and cost without it over those with it",
        {"parts": "ablation:part_rows", "taxels": "ablation:taxel_rows"},
    ),
    "effects": Bench(
        "each effect of a scene: its cost, and the error of a contour with it",
        {"effects": "effects:effect_rows"},
    ),
    "growth": Bench(
        "error and cost as contours, points, taxels, fingers and nodes grow, and memory",
        {"growth": "growth:growth_rows", "memory": "memory:memory_rows"},
        {"growth": ("sheet",)},
    ),
    "speed": Bench(
        "a touch, a message, splines, and the shipped scenes from start to exit",
        {
            "touches": "speed:touch_rows",
            "messages": "bus:hop_rows",
            "splines": "splines:spline_rows",
            "scenes": "speed:scene_rows",
            "runs": "speed:growth_rows",
        },
        {"scenes": ("against",)},
    ),
}
ALL = "all"
BENCH_HELP = """Measure the accuracy and the speed of palpate on this machine.

NAME is one of these, or `all` for all of them but accuracy and real, which take hours:

\b
{benches}

The exit code is 0 if all groups were measured, else 1. A demand that is not met is printed with
MISSED; with --strict it makes the exit code 1. --compare lists the figures that changed by more
than the range of their repeats; of figures measured once, counts that changed, times that changed
by more than 10 %, and others by more than 2 %.
"""


def bench_lines() -> Iterator[str]:
    """Name and purpose of each bench, folded."""
    wrap = textwrap.TextWrapper(78, subsequent_indent=12 * " ", break_on_hyphens=False)
    yield from (wrap.fill(f"{name:<12}{bench.shows}") for name, bench in BENCHES.items())


@click.command("bench", help=BENCH_HELP.format(benches="\n".join(bench_lines())))
@click.argument("name", required=False)
@click.option("--list", "listed", is_flag=True, help="List the names, and their groups.")
@click.option("--quick", is_flag=True, help="Fewer objects, seeds, scenes or frames.")
@click.option("--only", metavar="GROUP", help="One group of figures.")
@JSON
@out_option("Write the results here, as JSON.", type=RESULTS)
@click.option(
    "--compare", metavar="OLD", type=RESULTS, help="List what changed since these results."
)
@click.option("--strict", is_flag=True, help="Exit with 1 if a demand is missed.")
@click.option("--against", type=FOLDER, metavar="DIR", help="speed: an older checkout, in turns.")
@click.option("--sheet", type=FOLDER, metavar="DIR", help="Folder for runs and pictures.")
@click.option("--meshes", type=FOLDER, metavar="DIR", help="accuracy, real: explore these too.")
@click.option("--cost", type=click.Choice(COSTS), help="accuracy: against which error is drawn.")
@click.option("--add", type=RESULTS, multiple=True, help="accuracy: runs of another method.")
@click.option("--method", metavar="MODULE:FUNCTION", multiple=True, help="accuracy: a method.")
@click.option("--runs", type=FOLDER, metavar="RUN", multiple=True, help="thesis: recorded runs.")
def bench_command(
    name: str | None,
    listed: bool,
    quick: bool,
    only: str | None,
    out: Path | None,
    compare: Path | None,
    as_json: bool,
    strict: bool,
    **options: Any,
) -> int:
    """Measure one bench or all."""
    if listed or name is None:
        for line in bench_lines():
            click.echo(line)
        return 0
    groups = chosen_groups(name, only, {key: value for key, value in options.items() if value})
    old = None if compare is None else read_results(compare, quick=quick)
    if out is not None:
        check_new(out)
    kept = ResultsFile(out, quick=quick)
    code = run_groups(
        groups, quick=quick, as_json=as_json, strict=strict, echo=click.echo, keep=kept.add
    )
    if old is not None and compare is not None:
        for line in comparison_lines(old, kept.results, compare):
            click.echo(line, err=as_json)
    return code


def chosen_groups(
    name: str, only: str | None, options: Mapping[str, Any]
) -> Mapping[str, str | Group]:
    """Groups by ``bench/group``: ``module:function``, or a call of that with its options.

    Raises InputError for an unknown name, group or option.
    """
    if name not in (*BENCHES, ALL):
        raise InputError(f"there is no bench {name!r}; {hint(name, [*BENCHES, ALL])}")
    names = [key for key, bench in BENCHES.items() if bench.in_all] if name == ALL else [name]
    known = [group for key in names for group in BENCHES[key].groups]
    if only is not None and only not in known:
        raise InputError(f"--only {only}: there is no such group; there are {', '.join(known)}")
    groups: dict[str, str | Group] = {}
    taken: set[str] = set()
    for key in names:
        for group, place in BENCHES[key].groups.items():
            if only not in (None, group):
                continue
            full = f"palpate.bench.{place}"
            own = {k: options[k] for k in BENCHES[key].options.get(group, ()) if k in options}
            groups[f"{key}/{group}"] = partial(named(full), **own) if own else full
            taken |= own.keys()
    if unused := sorted(options.keys() - taken):
        raise InputError(f"--{unused[0]}: nothing that is measured here takes it")
    return groups
