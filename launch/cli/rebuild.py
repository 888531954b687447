"""``palpate rebuild``: a solid from points that anybody measured."""

from __future__ import annotations

from pathlib import Path

import click

HELP = """Rebuild a solid from the contours in POINTS.

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


@click.command("rebuild", help=HELP)
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
def command(
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
    """Rebuild a solid from a file; `HELP` says how."""
    import json
    import sys
    from typing import cast

    from palpate.core.rebuild.solid import Method
    from palpate.launch.rebuild import Wanted, check_outputs, rebuild, write_outputs
    from palpate.launch.rebuild_text import rebuild_record, rebuild_text

    way = cast(Method, method)
    check_outputs(points, outs, lattice, way)
    shown = sys.stderr.isatty() and not quiet

    def say(text: str) -> None:
        if shown:
            click.echo(f"{text} ...", err=True)

    wanted = Wanted(unit, way, tops, bottom, top, noise, tolerance)
    rebuilt = rebuild(points, wanted, say)
    write_outputs(rebuilt, outs, lattice)
    record = rebuild_record(rebuilt, points, outs, lattice)
    click.echo(json.dumps(record, indent=2, allow_nan=False) if as_json else rebuild_text(record))
    return 0
