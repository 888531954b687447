"""What messages say of models, as values of the core; and the last word of an exploration."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import Lying
from palpate.core.explore.planners import (
    Findings,
    Limits,
    ObservedSurface,
    OpenArea,
    Progress,
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
    """How the object lies, as far as a model tells: no other tells of the last placement."""
    number = lying.placement
    if number == 0 or lying.is_turning:
        return lying
    if len(model.placements) < number:
        why = "; ".join(model.placement_faults[-1:]) or "no model tells of it"
        return lying._replace(fault=f"nobody knows how the object lies since it was turned: {why}")
    return lying._replace(pose=Pose.from_array(model.placements[number - 1]))


def observed_surface(
    model: ShapeModel,
    pad: Pad,  # Of the finger
    world: World,
    unknown_distance: float,  # From every touch, beyond which a place is unknown, m
    *,
    refused: Floats | None = None,  # What touches were aimed at in vain, (n, 3), m
    aimed: Floats | None = None,  # What single touches were aimed at, (n, 3), m
    earlier: tuple[Progress, ...] = (),  # What was known with fewer touches
    pose: Pose | None = None,  # Of the object in the world, if it was turned over
) -> ObservedSurface | None:
    """The model as planners of single touches are told of it; None if nothing tells of errors."""
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
    )


def plan_done(
    goal: ModelGoal,  # All that was touched
    reason: str,  # Why it is over
    found: Findings,  # What is known of the solid
    limits: Limits,  # What was asked of it
    unknown: OpenArea | None = None,  # Where nothing was touched; None if nobody looked
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
        reached=judge(found, limits).reached,
        rms_bound_95=found.error_bound,
        largest_untouched=width if found.untouched_gap is None else found.untouched_gap,
        uncovered=found.untraced_height or 0.0,
        findings=found.stated(),
        limits=limits.stated(),
        open_share=None if unknown is None else unknown.share,
        open_width=width,
        open_places=nowhere if unknown is None else unknown.places,
        open_normals=nowhere if unknown is None else unknown.normals,
        open_touches=None if unknown is None else unknown.touches,
        under_share=None if unknown is None else unknown.under,
    )
