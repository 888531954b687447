"""Models in messages as values of the core, and the message at the end of an exploration."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import Lying
from palpate.core.explore.planners import (
    DEFAULT_SURFACE,
    Findings,
    Limits,
    ObservedSurface,
    OpenArea,
    Progress,
    SurfaceSettings,
    judge,
)
from palpate.core.poses import Pose
from palpate.core.shapes import Bend, FittedSuperquadric, Mesh
from palpate.core.touch import Pad
from palpate.messages.types import ModelGoal, PlanDone, ShapeModel, Superquadric, World


def fitted_superquadric(coarse: Superquadric) -> FittedSuperquadric:
    """The coarse model as a solid."""
    return FittedSuperquadric(
        size=coarse.size,
        exponents=coarse.exponents,
        pose=coarse.pose,
        taper=coarse.taper,
        bend=Bend(coarse.bend, coarse.bend_direction if coarse.bend else 0.0),
        residuals=coarse.residuals,
        rms=coarse.residual,
        warnings=coarse.warnings,
    )


def lying_of(model: ShapeModel, lying: Lying) -> Lying:
    """The pose of the object after the last turn, from a model; else the fault."""
    number = lying.placement
    if number == 0 or lying.is_turning:
        return lying
    if len(model.placements) < number:
        why = "; ".join(model.placement_faults[-1:]) or "no model states it"
        fault = f"the pose of the object is unknown since it was turned: {why}"
        return lying._replace(fault=fault)
    return lying._replace(pose=Pose.from_array(model.placements[number - 1]))


def observed_surface(
    model: ShapeModel,
    pad: Pad,  # of the finger
    world: World,
    unknown_distance: float,  # from all touches, beyond which surface is unknown [m]
    *,
    refused: Floats | None = None,  # targets of touches that failed, (n, 3) [m]
    aimed: Floats | None = None,  # targets of single touches, (n, 3) [m]
    earlier: tuple[Progress, ...] = (),  # progress with fewer touches
    pose: Pose | None = None,  # of the object in the world, if it was turned over
    settings: SurfaceSettings = DEFAULT_SURFACE,
) -> ObservedSurface | None:
    """The model for planners of single touches; None if it states no errors."""
    if not len(model.vertex_errors):
        return None
    vertices, openings = model.vertices, model.openings
    if pose is not None:
        vertices, openings = pose.to_outer(vertices), pose.to_outer(openings)
    return ObservedSurface(
        mesh=Mesh(vertices, model.faces),
        errors=model.vertex_errors,
        bounds=model.vertex_bounds,
        distances=model.vertex_distances,
        missing=model.missing,
        pad=pad,
        platform=None if world.held else world.platform,
        reach=world.reach,
        unknown_distance=unknown_distance,
        refused=np.zeros((0, 3)) if refused is None else refused,
        aimed=np.zeros((0, 3)) if aimed is None else aimed,
        openings=openings,
        touches=model.touches,
        earlier=earlier,
        pose=pose,
        settings=settings,
    )


def plan_done(
    goal: ModelGoal,  # with all touches
    reason: str,  # for the end
    findings: Findings,  # about the solid
    limits: Limits,  # on the solid
    unknown: OpenArea | None = None,  # untouched surface; None if unknown
) -> PlanDone:
    """The message at the end of an exploration."""
    width = None if unknown is None else unknown.width
    nowhere = np.zeros((0, 3))
    return PlanDone(
        number=goal.number,
        contours=goal.contours,
        probes=goal.probes,
        arcs=goal.arcs,
        failed=goal.failed,
        missed=goal.missed,
        general=goal.general,
        closings=goal.closings,
        touches=goal.touches,
        robot_time=goal.robot_time,
        reason=reason,
        reached=judge(findings, limits).reached,
        rms_bound_95=findings.error_bound,
        largest_untouched=width if findings.untouched_gap is None else findings.untouched_gap,
        uncovered=findings.untraced_height or 0.0,
        findings=findings.stated(),
        limits=limits.stated(),
        open_share=None if unknown is None else unknown.share,
        open_width=width,
        open_places=nowhere if unknown is None else unknown.places,
        open_normals=nowhere if unknown is None else unknown.normals,
        open_touches=None if unknown is None else unknown.touches,
        under_share=None if unknown is None else unknown.under,
    )
