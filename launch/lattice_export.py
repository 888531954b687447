"""A control lattice as a file: arrays, or a grid that ParaView shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.lattice_grid import LatticeGrid, lattice_grid
from palpate.core.splines.lattice import Lattice

SUFFIXES = (".npz", ".vtk")
AXES = "stu"


def write_lattice(path: Path, lattice: Lattice) -> None:
    """Write a lattice; the suffix is one of `SUFFIXES`."""
    parts = lattice_grid(lattice)
    if path.suffix.lower() == ".vtk":
        path.write_text(_vtk(parts), encoding="ascii")
        return
    arrays: dict[str, NDArray[np.generic]] = {
        "control": parts.control,
        "undeformed": parts.undeformed,
        "weights": parts.weights,
    }
    for axis, knots, degree in zip(AXES, parts.knots, parts.degrees, strict=True):
        arrays[f"knots_{axis}"] = knots
        arrays[f"degree_{axis}"] = np.array(degree)
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _vtk(parts: LatticeGrid) -> str:
    """A structured grid of the deformed points, which know their weights and where they were."""
    l, m, n = parts.weights.shape  # noqa: E741 (the letters of the text)
    count = l * m * n
    lines = [
        "# vtk DataFile Version 3.0",
        "palpate control lattice, lengths in m",
        "ASCII",
        "DATASET STRUCTURED_GRID",
        f"DIMENSIONS {l} {m} {n}",
        f"POINTS {count} double",
        *_rows(parts.control),
        f"POINT_DATA {count}",
        "SCALARS weight double 1",
        "LOOKUP_TABLE default",
        *(repr(float(weight)) for weight in parts.weights.ravel(order="F")),
        "VECTORS undeformed double",
        *_rows(parts.undeformed),
        "VECTORS displacement double",
        *_rows(parts.control - parts.undeformed),
    ]
    return "\n".join(lines) + "\n"


def _rows(points: Floats) -> list[str]:
    """Points with the first axis fastest, as the format has it, to the last bit."""
    flat = points.transpose(2, 1, 0, 3).reshape(-1, 3)
    return [" ".join(map(repr, row)) for row in flat.tolist()]
