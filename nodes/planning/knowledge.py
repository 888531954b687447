"""What a model says of itself and of what was not touched, to planners and in messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.core import Floats
from palpate.core.explore.planners import ObservedSurface, OpenArea, Progress
from palpate.core.shapes import Mesh
from palpate.core.touch import Pad
from palpate.messages.types import ShapeModel, World


def observed_surface(
    model: ShapeModel,
    pad: Pad,  # Of the finger
    world: World,
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
        pad=pad,
        platform=None if world.held else world.platform,
        reach=world.reach,
        refused=np.zeros((0, 3)) if refused is None else refused,
        openings=model.openings,
        touches=model.touches,
        earlier=earlier,
    )


def describe_open(found: OpenArea) -> dict[str, Any]:
    """What was not touched, by the names of a message's fields."""
    return {
        "open_share": found.share,
        "open_width": found.width,
        "open_places": found.places,
        "open_normals": found.normals,
        "open_touches": found.touches,
        "under_share": found.under,
    }
