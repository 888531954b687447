"""Verbs on solids: rebuild one from measured points, and score one against what it should be."""

from __future__ import annotations

from pathlib import Path

import click

REBUILD_HELP = """Rebuild a solid from the contours in POINTS.

\b
.csv .txt   columns x,y,z and, named by a header, contour, nx,ny,nz, touch; parted by
            commas, semicolons, tabs or blanks; # begins a comment
.npz        contour_0, contour_1, ..., each (n, 3), or contours with the array contour
            that numbers their points; normals and tops if there are any
.ply .xyz   a cloud of points at repeated heights, in no order
.mcap       a recording of palpate, or the folder of a run

Contours run around the z axis; each may begin anywhere, in either direction, with any number of
points. Files of points are taken to be in m unless told otherwise; lengths among the options are
in the same unit. What is written is in m, STL in mm.
"""
PATH = click.Path(path_type=Path)
LENGTH = click.FloatRange(min=0.0, min_open=True)
UNIT_CHOICE = click.Choice(["m", "cm", "mm", "in"])
SCORE_HELP = """Measure the solid MODEL against REFERENCE.

MODEL is a PLY, STL, OBJ, OFF or GLB file, or the model.npz of a run or of palpate rebuild.
REFERENCE is such a file, a CAD model's mesh say, or measured points: a CSV, TXT or XYZ file, or a
PLY file without faces. Against points the distances are one-sided, from each point to the model.

A file does not say its unit: it is taken for what palpate writes, mm for STL and m for all
others, unless told otherwise. GLB files have y up, and are turned.
"""


@click.command("rebuild", help=REBUILD_HELP)
@click.argument("points", type=PATH)
@click.option(
    "-o", "--out", "outs", type=PATH, multiple=True,
    help="File to write: .ply, .stl, .glb, .obj, or .npz with everything. Repeatable.",
)  # fmt: skip
@click.option("--unit", type=click.Choice(["m", "cm", "mm", "in"]), help="Unit of POINTS.")
@click.option(
    "--method", type=click.Choice(["lattice", "skin", "thesis", "coarse"]), default="lattice",
    show_default=True, help="How to rebuild.",
)  # fmt: skip
@click.option("--tops", type=PATH, help="CSV file of points at which the ends were touched.")
@click.option("--bottom", type=float, help="Height of the lower end.")
@click.option("--top", type=float, help="Height of the upper end.")
@click.option("--noise", type=LENGTH, help="Standard deviation of a coordinate, if known.")
@click.option("--tolerance", type=LENGTH, help="How far triangles may leave the surface.")
@click.option("--lattice", type=PATH, help="Write the control lattice: .npz or .vtk.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
@click.option("--quiet", is_flag=True, help="Show no progress.")
def rebuild_command(
    points: Path,
    outs: tuple[Path, ...],
    unit: str | None,
    method: str,
    tops: Path | None,
    bottom: float | None,
    top: float | None,
    noise: float | None,
    tolerance: float | None,
    lattice: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Rebuild a solid from a file; `REBUILD_HELP` says how."""
    import json
    import sys
    from typing import cast

    from palpate.core.rebuild import Method
    from palpate.tools.reconstruction import (
        RebuildOptions,
        check_outputs,
        rebuild,
        rebuild_record,
        rebuild_text,
        write_outputs,
    )

    way = cast(Method, method)
    check_outputs(points, outs, lattice, way)
    shown = sys.stderr.isatty() and not quiet

    def say(text: str) -> None:
        if shown:
            click.echo(f"{text} ...", err=True)

    wanted = RebuildOptions(unit, way, tops, bottom, top, noise, tolerance)
    rebuilt = rebuild(points, wanted, say)
    write_outputs(rebuilt, outs, lattice)
    record = rebuild_record(rebuilt, points, outs, lattice)
    click.echo(json.dumps(record, indent=2, allow_nan=False) if as_json else rebuild_text(record))
    return 0


@click.command("score", help=SCORE_HELP)
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("reference", type=click.Path(path_type=Path))
@click.option("--unit", type=UNIT_CHOICE, help="Unit of MODEL.")
@click.option("--reference-unit", type=UNIT_CHOICE, help="Unit of REFERENCE.")
@click.option("--align", "aligned", is_flag=True, help="Move MODEL onto REFERENCE first, rigidly.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON, in m.")
def score_command(
    model: Path,
    reference: Path,
    unit: str | None,
    reference_unit: str | None,
    aligned: bool,
    as_json: bool,
) -> int:
    """Measure one file against another; `SCORE_HELP` says how."""
    import json

    from palpate.tools.scoring import score, score_text

    found = score(model, reference, unit=unit, reference_unit=reference_unit, aligned=aligned)
    click.echo(json.dumps(found, indent=2, allow_nan=False) if as_json else score_text(found))
    return 0
