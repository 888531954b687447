"""Commands on scenes and solids: scene, init, rebuild, score and export."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import click

from palpate.tools.cli.command_line import (
    JSON,
    PATH,
    RUN_PATH,
    SIZE,
    UNTRUSTED,
    NamedGroup,
    complete_scene,
    out_option,
    print_figures,
    progress_printer,
    quiet_option,
    unit_option,
)

REBUILD_HELP = """Rebuild a solid from the contours in POINTS.

\b
.csv .txt   columns x,y,z and, named by a header, contour, nx,ny,nz, touch;
            separated by commas, semicolons, tabs or blanks; # for comments
.npz        contour_0, contour_1, ..., each (n, 3), or contours with the array
            contour that numbers their points; optionally normals and tops
.ply .xyz   a cloud of points at repeated heights, in any order
.mcap       a recording of palpate, or the folder of a run

With --method general points can be in any order, without contours, if they have normals: columns
nx,ny,nz, properties nx, ny, nz of a .ply, or arrays points and normals in an .npz; a column touch,
if several belong to one touch. All taxels of a recording are used. Handles and hollows are
rebuilt. --bottom is the height on which the object stands, if it does.

Contours run around the z axis; each can start anywhere, in either direction, with any number of
points; unordered points are put in order where that is safe. Points are in m unless --unit states
another; lengths in options are in the same unit. Files are written in m, STL and 3MF in mm.
"""
LENGTH = click.FloatRange(min=0.0, min_open=True)


@click.command("rebuild", help=REBUILD_HELP)
@click.argument("points", **RUN_PATH)
@out_option(
    "File to write: .ply, .stl, .glb, .obj, .3mf, or .npz with everything. Repeatable.",
    multiple=True,
)
@unit_option("Unit of POINTS.")
@click.option(
    "--method", type=click.Choice(["lattice", "skin", "thesis", "coarse", "general"]),
    default="lattice", show_default=True, help="How to rebuild.",
)  # fmt: skip
@click.option("--tops", type=PATH, help="CSV file of points at which the ends were touched.")
@click.option("--bottom", type=float, help="Height of the lower end.")
@click.option("--top", type=float, help="Height of the upper end.")
@click.option("--noise", type=LENGTH, help="Standard deviation of a coordinate, if known.")
@click.option("--tolerance", type=LENGTH, help="Largest distance of triangles from the surface.")
@click.option("--lattice", type=PATH, help="Write the control lattice: .npz or .vtk.")
@JSON
@quiet_option("Show no progress.")
def rebuild_command(
    points: Path, out: tuple[Path, ...], as_json: bool, quiet: bool, **asked: Any
) -> None:
    """Rebuild a solid from a file; see `REBUILD_HELP`."""
    from palpate.tools import reconstruction

    lattice = asked.pop("lattice")
    wanted = reconstruction.RebuildOptions(**asked)
    reconstruction.check_outputs(points, out, lattice, wanted.method)
    say = progress_printer(sys.stderr.isatty() and not quiet, "{} ...")
    if wanted.method == "general":
        from palpate.tools.scattered import rebuild_scattered

        record = rebuild_scattered(points, wanted, out, say)
    else:
        rebuilt = reconstruction.rebuild(points, wanted, say)
        reconstruction.write_outputs(rebuilt, out, lattice)
        record = reconstruction.rebuild_record(rebuilt, points, out, lattice)
    print_figures(record, reconstruction.rebuild_text(record), as_json=as_json)


@click.command("score")
@click.argument("model", **RUN_PATH)
@click.argument("reference", **RUN_PATH)
@unit_option("Unit of MODEL.")
@unit_option("Unit of REFERENCE.", "--reference-unit")
@click.option("--align", "aligned", is_flag=True, help="Move MODEL onto REFERENCE first, rigidly.")
@JSON
def score_command(model: Path, reference: Path, as_json: bool, **how: Any) -> None:
    """Measure the solid MODEL against REFERENCE.

    MODEL is a run, a PLY, STL, OBJ, OFF or GLB file, or the .npz that palpate rebuild writes.
    REFERENCE is such a file, a CAD model's mesh say, or measured points: a CSV, TXT or XYZ file, or
    a PLY file without faces. Against points the distances are one-sided, from each point to the
    model.

    The unit of a surface, which its file does not state, is guessed as palpate run does; if several
    are likely, it is that in which palpate writes, mm for STL and m for others. Points are in m,
    and recognised by the names of their columns, as palpate rebuild does. GLB files have y up, and
    are turned.
    """
    from palpate.tools.scoring import score, score_text

    record = score(model, reference, **how)
    print_figures(record, score_text(record), as_json=as_json)


EXPORT_HELP = """Write the final solid of RUN in formats that other programs read.

RUN is a run directory or a recording.

\b
.ply   m; each vertex has its deviation from the truth, if that is known,
       and the uncertainty that the model states, both in m, and is
       coloured by the first of them
.stl   mm
.3mf   mm, which the file states
.glb   m, y up
.obj   m

Existing files are replaced. Either all files are written or none.
"""


@click.command("export", help=EXPORT_HELP)
@click.argument("run", **RUN_PATH)
@out_option("File: .ply, .stl, .glb, .obj or .3mf. Repeatable.", multiple=True, required=True)
@JSON
def export_command(run: Path, out: tuple[Path, ...], as_json: bool) -> None:
    """Write the solid of a run; see `EXPORT_HELP`."""
    from palpate.tools.exporting import export, export_text

    facts = export(run, out)
    print_figures(facts, export_text(facts), as_json=as_json)


scene_group = NamedGroup("scene", help="List and check scenes.")


@scene_group.command("list")
@JSON
def scene_list(as_json: bool) -> None:
    """List the scenes of palpate."""
    from palpate.launch.scene import scene_title, shipped_scenes

    titles = {name: scene_title(name) for name in shipped_scenes()}
    text = "\n".join(f"{name:<12} {title}" for name, title in titles.items())
    print_figures(titles, text, as_json=as_json)


@scene_group.command("check", short_help="Check whether a scene can be explored.")
@click.argument("scene", shell_complete=complete_scene)
@unit_option("Unit of a mesh.")
@SIZE
@UNTRUSTED
@JSON
def scene_check(scene: str, as_json: bool, **how: Any) -> None:
    """Check whether SCENE can be explored; prints the size of its object and what is simulated.

    SCENE is the name of a shipped scene, a YAML file or a mesh; repairs of a mesh are printed.
    """
    from palpate.tools.scene_text import check_scene, scene_figures, scene_text

    checked = check_scene(scene, **how)
    print_figures(scene_figures(checked), scene_text(checked), as_json=as_json)


@scene_group.command("effects", short_help="List the effects that a scene can have.")
@JSON
def scene_effects(as_json: bool) -> None:
    """List the effects that a scene can have, with parameters, defaults and ranges."""
    from palpate.tools.scene_text import effects_text, list_effects

    effects = list_effects()
    print_figures(effects, effects_text(effects), as_json=as_json)


init_group = NamedGroup("init", help="Create a module from a working example.")


@init_group.command("effect", short_help="Create an effect.")
@click.argument("name")
def init_effect_command(name: str) -> None:
    """Write NAME.py and test_NAME.py here: a working effect to start from."""
    from palpate.tools.init import begin

    (path, test), listed = begin("effect", name, Path())
    click.echo(f"{path}: written; to test it: python -m pytest {test}")
    click.echo("list it in a scene, and start palpate in this folder:")
    click.echo(f"effects:\n  - {listed}")


@init_group.command("planner", short_help="Create a planner.")
@click.argument("name")
@click.option("--touches", is_flag=True, help="A planner of single touches instead of slices.")
def init_planner_command(name: str, touches: bool) -> None:
    """Write NAME.py and test_NAME.py here: a working planner to start from."""
    from palpate.tools.init import begin

    template = "planner_touches" if touches else "planner"
    (path, test), named = begin("planner", name, Path(), template)
    click.echo(f"{path}: written; to test it: python -m pytest {test}")
    click.echo("name it in a scene, and start palpate in this folder:")
    click.echo(f"explore:\n  planner: {named}")


def _init_node(name: str, kind: Any, topic: str) -> None:
    from palpate.tools.init import begin

    (module, test, graph, *more), _ = begin(kind, name, Path())
    files = ", ".join(map(str, (module, *more, test, graph)))
    click.echo(f"{files}: written; in this folder")
    click.echo(f"  test it:    python -m pytest {test}")
    click.echo(f"  launch it:  palpate launch {graph}")
    click.echo(f"  look:       palpate topic echo {topic.format(name)}")


for kind, topic, short, contents in (
    ("node", "/{}", "Create a node.", "a working node to start from."),
    ("driver", "/touch/patch", "Create a driver for a sensor.", "a working driver to start from."),
    (
        "filter",
        "/touch/image",
        "Create a filter of frames.",
        "a copy of palpate's filter; its steps are in NAME_steps.py.",
    ),
):
    init_group.command(
        kind, short_help=short, help=f"Write NAME.py, test_NAME.py and NAME.yaml here: {contents}"
    )(click.argument("name")(partial(_init_node, kind=kind, topic=topic)))
