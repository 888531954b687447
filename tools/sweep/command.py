"""``palpate sweep``."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from palpate.launch.files.source_map import InputError
from palpate.tools.cli import command_line

SWEEP_HELP = """Explore with every combination of parameters that FILE asks for, and draw what
accuracy costs.

\b
scene: vase                             # a name or a file, or a list of them
seeds: 3                                # 0, 1, 2; or a list of seeds
grid:                                   # every combination of these
  tolerance: [1mm, 0.5mm]               # also: feature, budget, fingers
  scene.sensor.pitch: [1.0e-3, 1.2e-3]  # any value within the scene
list:                                   # each of these, with all of the grid
  - {planner.planner: predicted}          # any parameter of a node
  - {planner.planner: uniform, planner.settings.count: 9}

Every run is checked before the first one starts, and has a folder of its own. Beside them lie
table.csv and index.html, where each dot leads to its run. The same command on the same folder goes
on where it stopped, also with another FILE; so does the folder in place of FILE.

Exits with 0 if all runs are done, with 1 if one missed its goal or failed, as the table says, with
2 if FILE cannot be used or the cluster not be reached, with 130 if it was interrupted.
docs/sweep.md says more.
"""
# What is asked of a graph that is performed, and of how its result is printed.


@click.command(
    "sweep",
    short_help="Explore with many parameters, and draw what accuracy costs.",
    help=SWEEP_HELP,
)
@click.argument("file", type=command_line.PATH)
@command_line.out_option("Folder of the sweep; new, empty, or one to go on with.")
@click.option("--workers", type=click.IntRange(1, 1024), help="Processes; one a core if left out.")
@click.option("--scheduler", metavar="ADDRESS", help="Send the runs to this dask cluster instead.")
@click.option("--no-record", is_flag=True, help="Do not keep the messages.")
@command_line.JSON
@command_line.quiet_option()
def sweep_command(
    file: Path, out: Path | None, workers: int | None, scheduler: str | None, **how: bool
) -> int:
    """Explore with many parameters; `SWEEP_HELP` says how."""
    from palpate.tools.sweep.sweep_file import read_sweep
    from palpate.tools.sweep.sweep_folder import ASKED, ClusterWorkers, LocalWorkers, run_sweep

    if (workers and scheduler) or (out and file.is_dir()):
        raise InputError("--workers and --scheduler exclude each other, so do --out and a folder")
    if file.is_dir():
        file, out = file / ASKED, file
    asked = read_sweep(file, record=not how["no_record"])
    here = None if scheduler else LocalWorkers(workers or os.cpu_count() or 1)
    who = here or ClusterWorkers(scheduler or "")
    done = run_sweep(asked, out, who, command_line.progress_printer(not how["quiet"]))
    if how["as_json"]:
        click.echo(json.dumps(done.figures, indent=2, default=str))
    elif not how["quiet"]:
        click.echo(done.text)
    return done.exit_code
