"""``palpate sweep``."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from palpate.launch.files.source_map import InputError
from palpate.tools.cli import command_line

SWEEP_HELP = """Explore with every combination of parameters in FILE, and draw the cost of accuracy.

\b
scene: vase                             # a name or a file, or a list of them
seeds: 3                                # 0, 1, 2; or a list of seeds
grid:                                   # every combination of these
  tolerance: [1mm, 0.5mm]               # also: feature, budget, fingers
  scene.sensor.pitch: [1.0e-3, 1.2e-3]  # any value within the scene
list:                                   # each of these, with all of the grid
  - {planner.planner: predicted}          # any parameter of a node
  - {planner.planner: uniform, planner.settings.count: 9}

All runs are checked before the first one starts. Each has its own folder, beside table.csv and
index.html, where each dot links to its run. The same command with the same folder resumes a sweep,
also with another FILE; so does the folder in place of FILE.

Exits with 0 if all runs are done, with 1 if one missed its goal or failed, as the table shows, with
2 if FILE is invalid or the cluster cannot be reached, with 130 if it was interrupted. See
docs/sweep.md.
"""


@click.command(
    "sweep",
    short_help="Explore with many parameters, and draw the cost of accuracy.",
    help=SWEEP_HELP,
)
@click.argument("file", type=command_line.PATH)
@command_line.out_option("Folder of the sweep; new, empty, or of a sweep to resume.")
@click.option(
    "--workers", type=click.IntRange(1, 1024), help="Processes. Default: one for each core."
)
@click.option("--scheduler", metavar="ADDRESS", help="Send the runs to this dask cluster instead.")
@click.option("--no-record", is_flag=True, help="Do not record the messages.")
@command_line.JSON
@command_line.quiet_option()
def sweep_command(
    file: Path, out: Path | None, workers: int | None, scheduler: str | None, **how: bool
) -> int:
    """Explore with many parameters; see `SWEEP_HELP`."""
    from palpate.tools.sweep.sweep_file import read_sweep
    from palpate.tools.sweep.sweep_folder import ASKED, ClusterWorkers, LocalWorkers, run_sweep

    if (workers and scheduler) or (out and file.is_dir()):
        raise InputError("--workers and --scheduler exclude each other, so do --out and a folder")
    if file.is_dir():
        file, out = file / ASKED, file
    sweep = read_sweep(file, record=not how["no_record"])
    local = None if scheduler else LocalWorkers(workers or os.cpu_count() or 1)
    pool = local or ClusterWorkers(scheduler or "")
    result = run_sweep(sweep, out, pool, command_line.progress_printer(not how["quiet"]))
    if how["as_json"]:
        click.echo(json.dumps(result.figures, indent=2, default=str))
    elif not how["quiet"]:
        click.echo(result.text)
    return result.exit_code
