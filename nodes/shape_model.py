"""The message that tells of a rebuilt solid."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.core.archive_bytes import pack
from palpate.core.arrays import Floats
from palpate.core.frames import IDENTITY
from palpate.core.rebuild.lattice.lattice_grid import lattice_grid
from palpate.core.rebuild.solid import Solid
from palpate.core.rebuild.surface.surface_mesh import SurfaceMesh
from palpate.messages.types import ModelGoal, PlanDone, ShapeModel

FACES = 45_000
"""Of a mesh, about, if it takes as many."""
COARSE, FINE = 5e-4, 5e-5
"""Of the size: tolerance of the meshes on the way, and the least one of the final mesh."""
BANDS, BAND_TURNS = 25, 8
"""Heights at which the uncertainty is given, and turns over which it is averaged."""
NOTHING = np.zeros(0, np.uint8)
EMPTY: dict[str, Any] = {
    "control": np.zeros((0, 0, 0, 3)),
    "undeformed": np.zeros((0, 0, 0, 3)),
    "knots_columns": np.zeros(0),
    "knots_rows": np.zeros(0),
    "knots_layers": np.zeros(0),
    "vertices": np.zeros((0, 3)),
    "faces": np.zeros((0, 3), np.int32),
    "uncertainty_height": np.zeros(0),
    "uncertainty": np.zeros(0),
    "health": {},
}
"""Of a model of nothing."""


def shape_model(goal: ModelGoal | PlanDone, solid: Solid | None, why: str = "") -> ShapeModel:
    """The message for a solid.

    Parameters
    ----------
    goal : ModelGoal or PlanDone
        Who asked for it.
    solid : Solid or None
        None if there was nothing to rebuild: the model is empty.
    why : str
        Why nothing could be rebuilt of contours that are there.
    """
    dropped: dict[int, str] = {}
    if solid is not None:
        dropped = {one.which: one.why for one in solid.slices.dropped}
    elif why:
        dropped = dict.fromkeys(range(len(goal.contours)), why)
    final = isinstance(goal, PlanDone)
    parts = EMPTY if solid is None else _parts(solid, final)
    return ShapeModel(
        number=goal.number,
        contours=goal.contours,
        probes=goal.probes,
        dropped=tuple(goal.contours[which] for which in dropped),
        dropped_why=tuple(dropped.values()),
        frame=IDENTITY if solid is None or solid.frame is None else solid.frame,
        deviation=0.0 if solid is None else solid.whole_deviation() or 0.0,
        **parts,
        touches=goal.touches,
        robot_time=goal.robot_time,
        final=final,
        archive=pack(solid) if solid is not None and final else NOTHING,
    )


def _parts(solid: Solid, final: bool) -> dict[str, Any]:
    """Everything of a model that is the solid's."""
    lattice = solid.control_lattice
    assert lattice is not None
    grid, mesh = lattice_grid(lattice), _mesh(solid, final)
    heights, deviation = _band(solid)
    return {
        "control": grid.control,
        "undeformed": grid.undeformed,
        "knots_columns": grid.knots[0],
        "knots_rows": grid.knots[1],
        "knots_layers": grid.knots[2],
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "uncertainty_height": heights,
        "uncertainty": deviation,
        "health": {name: _stable(value) for name, value in solid.health().items()},
    }


def _mesh(solid: Solid, final: bool) -> SurfaceMesh:
    """At the end about as many triangles whatever the shape: a first mesh tells how fine."""
    coarse = COARSE * solid.surface.size
    first = solid.mesh(coarse)
    if not final or len(first.faces) >= FACES:
        return first
    return solid.mesh(max(coarse * len(first.faces) / FACES, FINE * solid.surface.size))


def _band(solid: Solid) -> tuple[Floats, Floats]:
    """Heights along the slicing axis, and the side's standard deviation there."""
    assert solid.closed is not None
    if solid.closed.felt is not None:
        return solid.closed.felt.band_heights, solid.closed.felt.band
    heights = np.linspace(*solid.closed.skin.surface.reach, BANDS)
    deviation = solid.closed.skin.deviation(heights, np.arange(BAND_TURNS) / BAND_TURNS)
    return heights, np.sqrt(np.mean(deviation**2, axis=1))


def _stable(value: float) -> float:
    """To digits that do not depend on the machine, so that bodies do not."""
    return float(f"{value:.2g}")
