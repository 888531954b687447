"""The message that tells of a rebuilt solid."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.prism import PrismFit, fit_prism
from palpate.core.rebuild.solid import Solid
from palpate.core.rebuild.surface.surface_mesh import SurfaceMesh
from palpate.messages.types import ModelGoal, PlanDone, ShapeModel

FACES = 45_000
"""Of a mesh, about, if it takes as many."""
COARSE, FINE = 4e-4, 5e-5
"""Of the size: tolerance of the mesh that tells how many faces it takes, and the least one."""
LATTICE_ROWS, LATTICE_COLUMNS = 97, 160
"""Places of the side for which the control lattice is solved."""
LEAST_SIDE = 0.02
"""Of the side: contours that lie closer together leave the lattice all of it."""
BANDS, BAND_TURNS = 25, 8
"""Heights at which the uncertainty is given, and turns over which it is averaged."""
EMPTY: dict[str, Any] = {
    "control": np.zeros((0, 0, 0, 3)),
    "half_extent": np.zeros(2),
    "bottom": 0.0,
    "top": 0.0,
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
    parts = EMPTY if solid is None else _parts(solid)
    return ShapeModel(
        number=goal.number,
        contours=goal.contours,
        probes=goal.probes,
        dropped=tuple(goal.contours[which] for which in dropped),
        dropped_why=tuple(dropped.values()),
        **parts,
        touches=goal.touches,
        robot_time=goal.robot_time,
        final=isinstance(goal, PlanDone),
    )


def _parts(solid: Solid) -> dict[str, Any]:
    """Everything of a model that is the solid's."""
    prism, mesh = _lattice(solid), _mesh(solid)
    heights, deviation = _band(solid)
    corner, edges = prism.frame.corner, prism.frame.edges
    fit = {
        "lattice_rms": prism.rms,
        "lattice_condition": prism.condition,
        "lattice_folded": prism.folded_share(),
    }
    return {
        "control": prism.lattice.control,
        "half_extent": prism.half_extent,
        "bottom": float(corner[2]),
        "top": float(corner[2] + edges[2, 2]),
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "uncertainty_height": heights,
        "uncertainty": deviation,
        "health": {name: _stable(value) for name, value in (solid.health() | fit).items()},
    }


def _mesh(solid: Solid) -> SurfaceMesh:
    """About as many triangles whatever the shape: the first mesh tells how fine they may be."""
    coarse = COARSE * solid.surface.size
    first = solid.mesh(coarse)
    return solid.mesh(max(coarse * min(len(first.faces) / FACES, 1.0), FINE * solid.surface.size))


def _lattice(solid: Solid) -> PrismFit:
    """Control lattice that takes the shape of the side between the outermost contours."""
    assert solid.closed is not None
    surface, levels = solid.closed.skin.surface, solid.slices.heights
    reach = surface.reach
    if levels[-1] - levels[0] > LEAST_SIDE * (reach[1] - reach[0]):
        reach = float(levels[0]), float(levels[-1])
    heights = np.linspace(*reach, LATTICE_ROWS)
    turns = np.arange(LATTICE_COLUMNS) / LATTICE_COLUMNS
    return fit_prism(heights, turns, surface.at(heights[:, None], turns[None]))


def _band(solid: Solid) -> tuple[Floats, Floats]:
    """Heights, and the side's standard deviation there."""
    assert solid.closed is not None
    if solid.closed.felt is not None:
        return solid.closed.felt.band_heights, solid.closed.felt.band
    heights = np.linspace(*solid.closed.skin.surface.reach, BANDS)
    deviation = solid.closed.skin.deviation(heights, np.arange(BAND_TURNS) / BAND_TURNS)
    return heights, np.sqrt(np.mean(deviation**2, axis=1))


def _stable(value: float) -> float:
    """To digits that do not depend on the machine, so that bodies do not."""
    return float(f"{value:.2g}")
