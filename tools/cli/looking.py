"""Verbs for who wants to see a run: report and film."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.launch.files import InputError
from palpate.tools.cli.command_line import JSON, RUN_PATH, RUN_PATHS, out_option, print_figures
from palpate.tools.cli.command_line import progress_printer, quiet_option


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
    from palpate.tools import report, sweep

    if len(runs) > 2:
        raise InputError(f"a report sets at most two runs side by side, got {len(runs)}")
    if len(runs) == 1 and (runs[0] / sweep.ASKED).is_file():
        if out is not None:
            raise InputError("--out: the page of a sweep stands in its folder; leave it out")
        written = sweep.write_reports(runs[0])
    else:
        beside = runs[0] if runs[0].is_dir() else runs[0].parent
        written = [out or (beside if len(runs) == 1 else Path()) / report.REPORT]
        report.write_report(runs, written[0])
    names = [str(one) for one in written]
    print_figures(
        {"written": names}, "\n".join(f"{one}: written" for one in names), as_json=as_json
    )


@click.command("film")
@click.argument("run", **RUN_PATH)
@out_option("The film: .mp4, for which ffmpeg must be installed, or .gif.", required=True)
@click.option(
    "--seconds", type=click.FloatRange(1.0, 600.0), default=20.0, show_default=True, help="Length."
)
@quiet_option("Show no progress.")
def film_command(run: Path, out: Path, seconds: float, quiet: bool) -> None:
    """Draw the exploration of RUN, a run directory or a recording, as a film.

    The finger, contours, and the solid as it grows; beside them the tactile image, and error and
    bound against robot time. At the end the solid turns, coloured by its distance from the truth
    where that is known. Needs no screen.
    """
    from palpate.tools.view import make_film, read_timeline

    say = progress_printer(not quiet, "drawing      {}")
    make_film(read_timeline(run), out, seconds=seconds, say=say)
    click.echo(f"{out}: written")
