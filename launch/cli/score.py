"""``palpate score``: how far a solid is from what it should be."""

from __future__ import annotations

from pathlib import Path

import click

UNITS = click.Choice(["m", "cm", "mm", "in"])
HELP = """Measure the solid MODEL against REFERENCE.

MODEL is a PLY, STL, OBJ, OFF or GLB file, or the model.npz of a run or of palpate rebuild.
REFERENCE is such a file, a CAD model's mesh say, or measured points: a CSV, TXT or XYZ file, or a
PLY file without faces. Against points the distances are one-sided, from each point to the model.

A file does not say its unit: it is taken for what palpate writes, mm for STL and m for all
others, unless told otherwise. GLB files have y up, and are turned.
"""


@click.command("score", help=HELP)
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("reference", type=click.Path(path_type=Path))
@click.option("--unit", type=UNITS, help="Unit of MODEL.")
@click.option("--reference-unit", type=UNITS, help="Unit of REFERENCE.")
@click.option("--align", "aligned", is_flag=True, help="Move MODEL onto REFERENCE first, rigidly.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON, in m.")
def command(
    model: Path,
    reference: Path,
    unit: str | None,
    reference_unit: str | None,
    aligned: bool,
    as_json: bool,
) -> int:
    """Measure one file against another; `HELP` says how."""
    import json

    from palpate.launch.score import score
    from palpate.launch.score_text import score_text

    found = score(model, reference, unit=unit, reference_unit=reference_unit, aligned=aligned)
    click.echo(json.dumps(found, indent=2, allow_nan=False) if as_json else score_text(found))
    return 0
