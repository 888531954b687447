"""Verbs for who wants to see something: view and report."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.core.plugins import entry_points_of
from palpate.launch.files.source_map import InputError
from palpate.tools.cli.command_line import (
    JSON,
    RUN_PATH,
    RUN_PATHS,
    out_option,
    print_figures,
)

REPORTS = "palpate.reports"  # Entry points of functions that report folders of a kind of theirs


@click.command("view")
@click.argument("run", required=False, **RUN_PATH)
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=8080,
    show_default=True,
    help="Of this machine; the next free one if it is taken.",
)
@click.option("--attached", is_flag=True, hidden=True)
def view_command(run: Path | None, port: int, attached: bool) -> None:
    """Show RUN in the browser, as it runs or from its recording, until Ctrl-C.

    RUN is a run directory, an MCAP file, or the name or number of a running graph; if it is left
    out, the graph that PALPATE_GRAPH names, or that of this folder, or the only one, or the last
    run. The page is served to this machine alone and asks nothing of any other. A running
    graph is never held up by who looks at it. docs/view.md says what is seen.
    """
    from palpate.tools.view.live import view_run

    view_run(run, port=port, attached=attached, echo=click.echo)


@click.command("report")
@click.argument("runs", **RUN_PATHS)
@out_option("The page; report.html in the run's folder, or here of two runs, if left out.")
@JSON
def report_command(runs: tuple[Path, ...], out: Path | None, as_json: bool) -> None:
    """Write the report of a run, or of two RUNS side by side, as one HTML file.

    A run is its directory or its recording. The page opens from disk without a network: what was
    found, a three-dimensional view with a slider through the run, what accuracy cost, contours,
    load, effects, diagnostics, the graph, and how to run it again. Every run leaves one. Of the
    folder of a sweep, the reports of its runs are written, and its own page anew.
    """
    from palpate.tools.report.page import REPORT, write_report

    if len(runs) > 2:
        raise InputError(f"a report sets at most two runs side by side, got {len(runs)}")
    reports = [point.load() for point in entry_points_of(REPORTS).values()]
    written: list[Path] = next((found for one in reports if (found := one(runs, out))), [])
    if not written:
        beside = runs[0] if runs[0].is_dir() else runs[0].parent
        written = [out or (beside if len(runs) == 1 else Path()) / REPORT]
        write_report(runs, written[0])
    names = [str(one) for one in written]
    print_figures(
        {"written": names}, "\n".join(f"{one}: written" for one in names), as_json=as_json
    )
