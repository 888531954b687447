"""What a model says of itself and of what was not touched, to planners and in messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners import (
    Findings,
    Limits,
    ObservedSurface,
    OpenArea,
    Progress,
    judge,
)
from palpate.core.shapes import Mesh
from palpate.core.touch import Pad
from palpate.messages import derive
from palpate.messages.types import ModelGoal, PlanDone, ShapeModel, World


def observed_surface(
    model: ShapeModel,
    pad: Pad,  # Of the finger
    world: World,
    unknown_distance: float,  # From every touch, beyond which a place is unknown, m
    refused: Floats | None = None,  # What touches were aimed at in vain, (n, 3), m
    earlier: tuple[Progress, ...] = (),  # What was known with fewer touches
) -> ObservedSurface | None:
    """The model as planners of single touches are told of it; None if nothing tells of errors."""
    if not len(model.vertex_errors):
        return None
    return ObservedSurface(
        mesh=Mesh(model.vertices, model.faces),
        errors=model.vertex_errors,
        bounds=model.vertex_bounds,
        distances=model.vertex_distances,
        missing=model.missing,
        pad=pad,
        platform=None if world.held else world.platform,
        reach=world.reach,
        unknown_distance=unknown_distance,
        refused=np.zeros((0, 3)) if refused is None else refused,
        openings=model.openings,
        touches=model.touches,
        earlier=earlier,
    )


def plan_done(
    goal: ModelGoal,  # All that was touched
    reason: str,  # Why it is over
    found: Findings,  # What is known of the solid
    limits: Limits,  # What was asked of it
    unknown: OpenArea | None = None,  # Where nothing was touched; None if nobody looked
) -> PlanDone:
    """The message at the end of an exploration."""
    places = {} if unknown is None else _describe_open(unknown)
    gap = places.get("open_width") if found.untouched_gap is None else found.untouched_gap
    return derive(
        PlanDone,
        goal,
        reason=reason,
        reached=judge(found, limits).reached,
        rms_bound_95=found.error_bound,
        largest_untouched=gap,
        uncovered=found.untraced_height or 0.0,
        findings=found.stated(),
        limits=limits.stated(),
        **places,
    )


def _describe_open(unknown: OpenArea) -> dict[str, Any]:
    """What was not touched, by the names of a message's fields."""
    return {
        "open_share": unknown.share,
        "open_width": unknown.width,
        "open_places": unknown.places,
        "open_normals": unknown.normals,
        "open_touches": unknown.touches,
        "under_share": unknown.under,
    }
