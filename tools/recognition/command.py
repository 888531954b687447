"""``palpate recognise``."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.tools.cli.command_line import (
    JSON,
    PATH,
    RUN_PATH,
    print_figures,
    progress_printer,
    quiet_option,
    unit_option,
)


@click.command("recognise", short_help="Recognise the object of a run among stored objects.")
@click.argument("run", **RUN_PATH)
@unit_option("Unit of a mesh file.")
@click.option("--objects", type=PATH, help="YAML file of stored objects.")
@JSON
@quiet_option("Show no progress.")
def recognise_command(
    run: Path, unit: str | None, objects: Path | None, as_json: bool, quiet: bool
) -> int:
    """Recognise the object of RUN among the stored objects, with its probability, or none of them.

    RUN is a run directory, or a PLY, STL, OBJ, OFF or GLB file with a closed surface, in any pose.
    Exits with 1 if it is none of the stored objects.
    """
    from palpate.tools.recognition.recognising import recognise, recognition_text

    say = progress_printer(not quiet, "{} ...")
    record = recognise(run, unit=unit, objects=objects, say=say)
    print_figures(record, recognition_text(record), as_json=as_json)
    return 0 if record["recognised"] else 1
