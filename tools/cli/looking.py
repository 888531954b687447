"""Commands that show a run: view and report."""

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

REPORTS = "palpate.reports"  # entry points of functions that report other kinds of folders


@click.command("view")
@click.argument("run", required=False, **RUN_PATH)
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=8080,
    show_default=True,
    help="Port on this machine; the next free one if it is taken.",
)
@click.option("--attached", is_flag=True, hidden=True)
def view_command(run: Path | None, port: int, attached: bool) -> None:
    """Show RUN in the browser, as it runs or from its recording, until Ctrl-C.

    RUN is a run directory, an MCAP file, or the name or number of a running graph. Default: the
    graph that PALPATE_GRAPH names, or that of this folder, or the only one, or the last run. The
    page is served to this machine only, and loads nothing from others. A view does not delay a
    running graph. docs/view.md describes the page.
    """
    from palpate.tools.view.live import view_run

    view_run(run, port=port, attached=attached, echo=click.echo)


@click.command("report")
@click.argument("runs", **RUN_PATHS)
@out_option("The page. Default: report.html in the folder of the run, or here for two runs.")
@JSON
def report_command(runs: tuple[Path, ...], out: Path | None, as_json: bool) -> None:
    """Write the report of a run, or of two RUNS side by side, as one HTML file.

    RUNS are directories or recordings. The page opens from disk without a network. It has the
    result, a three-dimensional view with a slider through the run, the cost of accuracy, contours,
    load, effects, diagnostics, the graph, and the command that repeats the run. Each run writes
    one at its end. For the folder of a sweep, the reports of its runs and its own page are written.
    """
    from palpate.tools.report.page import REPORT, write_report

    if len(runs) > 2:
        raise InputError(f"a report sets at most two runs side by side, got {len(runs)}")
    reports = [point.load() for point in entry_points_of(REPORTS).values()]
    written: list[Path] = next((paths for report in reports if (paths := report(runs, out))), [])
    if not written:
        folder = runs[0] if runs[0].is_dir() else runs[0].parent
        written = [out or (folder if len(runs) == 1 else Path()) / REPORT]
        write_report(runs, written[0])
    names = [*map(str, written)]
    text = "\n".join(f"{name}: written" for name in names)
    print_figures({"written": names}, text, as_json=as_json)
