"""The messages of models: of a solid by slices, a general one, or the coarse superquadric."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.core import IDENTITY_POSE, Floats, Steps, no_steps, tree_to_bytes
from palpate.core.rebuild import Solid, fit_coarse
from palpate.core.rebuild import lattice as lattices
from palpate.core.rebuild.general import touch_distances
from palpate.core.shapes import Mesh
from palpate.messages import derive, types
from palpate.nodes.rebuilding.candidates import Candidates, MeshVolume, Quality
from palpate.nodes.specs import CONTACT_ERROR

if TYPE_CHECKING:
    from palpate.core.rebuild import GeneralSolid
    from palpate.nodes.rebuilding.candidates import AnySolid

Goal = types.ModelGoal | types.PlanDone

BANDS, BAND_TURNS = 25, 8  # Heights of the uncertainty, and turns over which it is averaged
HOLLOW = 0.4e-3  # Depth in a solid at which a pad that touches nothing shows that it is hollow, m
NO_ARCHIVE = np.zeros(0, np.uint8)


def shape_model(
    goal: Goal,  # Who asked for it
    candidates: Candidates,  # What was fitted; neither if there was nothing to rebuild
    solid: AnySolid | None,  # The one of these that is published
    predicted: Mapping[str, Floats],  # Mean square distances of new touches, by method, m^2
    spanned: Floats,  # Places that pads spanned, and that nothing touched, (k, 3), m
    quality: Quality | None = None,  # Of the mesh, if it is the final one
    step: Steps = no_steps,  # Told which step begins
) -> types.ShapeModel:
    """The message for the solid that predicts better."""
    dropped: dict[int, str] = {}
    if candidates.sliced is not None:
        dropped = {one.which: one.why for one in candidates.sliced.slices.dropped}
    elif candidates.why:
        dropped = dict.fromkeys(range(len(goal.contours)), candidates.why)
    final = isinstance(goal, types.PlanDone)
    parts: dict[str, Any] = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}
    frame = IDENTITY_POSE
    deviation = None
    if isinstance(solid, Solid):
        parts = _parts(solid, candidates, quality, step)
        frame = IDENTITY_POSE if solid.frame is None else solid.frame
        with step("bound"):
            deviation = solid.whole_deviation()
    elif solid is not None:
        parts = _general_parts(solid, quality, step)
    return derive(
        types.ShapeModel,
        goal,
        method="lattice" if solid is candidates.sliced else "general",
        predicted={name: float(np.sqrt(found.mean())) for name, found in predicted.items()},
        dropped=tuple(goal.contours[which] for which in dropped),
        dropped_reasons=tuple(dropped.values()),
        openings=openings(spanned, _volume(parts, candidates)),
        frame=frame,
        deviation=0.0 if deviation is None else deviation.whole,
        ends_deviation=0.0 if deviation is None else deviation.ends,
        **parts,
        **_errors(parts["vertices"], candidates, step),
        final=final,
        archive=tree_to_bytes(solid) if solid is not None and final else NO_ARCHIVE,
    )


def _volume(parts: Mapping[str, Any], candidates: Candidates) -> MeshVolume:
    """What a model's mesh encloses: the candidates' own if it is theirs."""
    if candidates.sliced is not None and parts["faces"] is candidates.volume.mesh.faces:
        return candidates.volume
    return MeshVolume(Mesh(parts["vertices"], parts["faces"]))


def openings(spanned: Floats, volume: MeshVolume) -> Floats:
    """Places (k, 3) of those that pads spanned where a solid would have been touched, m.

    It is hollow there: else it would be, for the pad has been where the solid is said to be.
    """
    if not len(spanned) or not len(volume.mesh.faces):
        return np.zeros((0, 3))
    return spanned[volume.depths(spanned) > HOLLOW]


def _errors(vertices: Floats, candidates: Candidates, step: Steps) -> dict[str, Any]:
    """Distance from touch at each vertex, and the error that it lets expect, if that is known."""
    if not len(candidates.touched.points) or not len(vertices):
        return {}
    with step("bound"):
        distances = touch_distances(candidates.touched, vertices)
        errors = bounds = np.zeros_like(distances)  # slices tell of theirs by height
        if candidates.general is not None:
            errors, bounds = candidates.general.expected_errors(vertices)
        return {"vertex_distances": distances, "vertex_errors": errors, "vertex_bounds": bounds}


def _general_parts(solid: GeneralSolid, quality: Quality | None, step: Steps) -> dict[str, Any]:
    with step("mesh"):
        mesh = solid.mesh(1 if quality is None else quality.parts)
    health = _rounded(solid.health())
    return {"vertices": mesh.vertices, "faces": mesh.faces, "health": health}


def _rounded(health: Mapping[str, float]) -> dict[str, float]:
    """To digits that do not depend on the machine, so that bodies do not."""
    return {name: float(f"{value:.2g}") for name, value in health.items()}


def _parts(
    solid: Solid, candidates: Candidates, quality: Quality | None, step: Steps
) -> dict[str, Any]:
    """Everything of a model that is the solid's; without a quality its mesh is coarse."""
    lattice: dict[str, Floats] = {}
    with step("mesh"):
        mesh = candidates.volume.mesh if quality is None else candidates.final_mesh(quality)
        if solid.control_lattice is not None:
            grid = lattices.lattice_grid(solid.control_lattice)
            names = "knots_columns", "knots_rows", "knots_layers"
            lattice = {"control": grid.control, "undeformed": grid.undeformed}
            lattice |= dict(zip(names, grid.knots, strict=True))
    with step("bound"):
        heights, deviation = _band(solid)
        told = {"uncertainty_height": heights, "uncertainty": deviation}
    shape = {"vertices": mesh.vertices, "faces": mesh.faces, "health": _rounded(solid.health())}
    return lattice | told | shape


def _band(solid: Solid) -> tuple[Floats, Floats]:
    """Heights along the slicing axis, and the side's standard deviation there."""
    assert solid.closed is not None
    if solid.closed.radial is not None:
        return solid.closed.radial.band_heights, solid.closed.radial.band
    heights = np.linspace(*solid.closed.loft.surface.reach, BANDS)
    deviation = solid.closed.loft.deviation(heights, np.arange(BAND_TURNS) / BAND_TURNS)
    return heights, np.sqrt(np.mean(deviation**2, axis=1))


def coarse_model(number: int, contacts: Floats) -> types.Superquadric:
    """The message for the superquadric through contacts (n, 3), m."""
    found = fit_coarse(contacts, CONTACT_ERROR)
    return derive(
        types.Superquadric,
        found,
        number=number,
        bend=found.bend.curvature,
        bend_direction=found.bend.direction,
        residual=found.rms,
    )
