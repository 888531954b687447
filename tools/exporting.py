"""The final solid of a run in the formats of other programs, with the scalars of its vertices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.rebuild import Solid
from palpate.launch.files.file_access import write_atomically
from palpate.launch.files.mesh_file import MESH_UNITS, read_surface, write_mesh
from palpate.launch.files.source_map import InputError
from palpate.launch.printing import counted, millimetres, titled
from palpate.launch.run_directory import RECORDING, find_run_mesh
from palpate.messages.types import ShapeModel, Truth
from palpate.tools.bag.decoding import open_decoded
from palpate.tools.drawables import model_mesh
from palpate.tools.reconstruction import check_places, check_suffixes, written_files
from palpate.tools.surfaces import TruthSurface, vertex_colours


def export(run: Path, outs: Sequence[Path]) -> dict[str, Any]:
    """Write the final solid of a run into files, in the formats of their suffixes.

    `run` is the directory of a run or a recording. All files are written or none. Returns facts of
    what was written, by stable names with their units. Raises InputError if a suffix is unknown, a
    file cannot be written, or there is no solid.
    """
    check_suffixes(outs, tuple(MESH_UNITS))
    check_places(run, outs)
    solid = read_final(run)
    coloured = vertex_colours(solid.scalars)
    columns: dict[str, NDArray[np.generic]] = dict(solid.scalars)
    if coloured is not None:
        columns |= zip(("red", "green", "blue"), coloured.colours.T, strict=True)
    write_atomically(
        {
            path: lambda part: write_mesh(part, solid.vertices, solid.faces, **columns)
            for path in outs
        }
    )
    return {
        "run": str(run),
        "final": solid.final,
        "vertices": len(solid.vertices),
        "faces": len(solid.faces),
        "rms_m": {name: float(np.sqrt(np.mean(v**2))) for name, v in solid.scalars.items()},
        "coloured_by": coloured and coloured.name,
        "colours_end_m": coloured and coloured.top,
        "written": written_files(outs),
    }


def export_solid(solid: Solid, path: Path) -> None:
    """Write the final mesh of a solid, in the format and unit of the suffix: `Solid.export`.

    Raises InputError if the suffix is unknown or the file cannot be written.
    """
    check_suffixes([path], tuple(MESH_UNITS), option="")
    mesh = solid.final_mesh
    write_atomically({path: lambda part: write_mesh(part, mesh.vertices, mesh.faces)})


class FinalSolid(NamedTuple):
    """The last solid of a run in the world frame."""

    vertices: Floats  # (n, 3) [m]
    faces: NDArray[np.int32]  # (m, 3)
    scalars: Mapping[str, Floats]  # (n,) each [m], by the names of `Mesh.scalars`
    final: bool | None  # whether the run had ended; None if unknown


def read_final(run: Path) -> FinalSolid:
    """The last model of a recording, or the mesh without scalars of a run without a recording.

    Raises InputError if there is neither, or nothing could be rebuilt.
    """
    if run.is_dir() and not (run / RECORDING).is_file():
        vertices, faces, _ = read_surface(find_run_mesh(run), "m")
        return FinalSolid(vertices, faces, {}, None)
    source = open_decoded(run)
    kinds = {topic: kind for topic, (kind, _) in source.recording.types.items()}
    wanted = [topic for topic in source.topics if kinds[topic] in ("ShapeModel", "Truth")]
    last = {type(decoded.message): decoded.message for decoded in source.published(wanted)}
    model, truth = last.get(ShapeModel), last.get(Truth)
    if model is None or not len(model.faces):
        raise InputError(f"{run}: holds no rebuilt solid: no model in it has a surface")
    scalars = model_mesh(model, truth and TruthSurface(truth)).scalars()
    return FinalSolid(model.vertices, model.faces, scalars, model.final)


def export_text(facts: Mapping[str, Any]) -> str:
    """Lines about what `export` wrote, with lengths in mm."""
    late = "; the run had not come to its end" if facts["final"] is False else ""
    size = f"{counted(facts['faces'], 'triangle')}, {facts['vertices']} vertices{late}"
    lines = titled("solid", size)
    parts = [f"{name} {millimetres(value)}" for name, value in facts["rms_m"].items()]
    if parts:
        lines += titled("rms", *parts)
        end = millimetres(facts["colours_end_m"])
        lines += titled("colours", f"of PLY: {facts['coloured_by']} from 0 to {end}")
    for written in facts["written"]:
        lines += titled("wrote", f"{written['file']} ({written['holds']})")
    return "\n".join(lines)
