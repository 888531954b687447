"""Evaluator node: measures each model against the truth, which only a simulation has.

Silent until it has the truth; then a score for each model, and the end after the final one.
"""

from __future__ import annotations

import math
from functools import partial

import msgspec

from palpate.core import geometry
from palpate.core.explore.planners import STANDING_HEIGHT
from palpate.core.steps import Steps
from palpate.messages.types import Score, ShapeModel, Truth
from palpate.nodes.runtime.node import Deferred, Finished, Node, Outputs

EVERY = 20  # A model on the way is measured by one sample in so many, the final one by all
NO_GENUS = -1  # Genus of a surface that is not closed: it has none


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Nothing to set: distances are measured the same way everywhere."""


class TrueSurface:
    """The truth, made ready to be compared with, by all its samples and by a few of them.

    Raises ValueError if it is no surface, or has no volume.
    """

    def __init__(self, truth: Truth) -> None:
        self.height = truth.height
        self.exposed = -math.inf if truth.platform is None else truth.platform + STANDING_HEIGHT
        solid = geometry.solidity(truth.vertices, truth.faces)
        self.volume = solid.volume  # m3
        self.genus = NO_GENUS if solid.genus is None else solid.genus
        if not self.volume > 0.0:
            raise ValueError(f"the truth must have a positive volume, got {self.volume} m3")
        whole = geometry.prepare_surface(truth.vertices, truth.faces)
        other = geometry.prepare_surface(truth.floor_vertices, truth.floor_faces)
        # By how many times fewer samples: the surface, and the Chamfer distance between two
        # tessellations of it, m.
        self.prepared = {every: whole.thinned(every) for every in (1, EVERY)}
        self.floors = {
            every: geometry.compare_surfaces(one, other.thinned(every)).chamfer
            for every, one in self.prepared.items()
        }


State = TrueSurface | None  # The truth; None before it was received


def take_truth(params: Params, state: State, truth: Truth) -> tuple[State, Outputs]:
    """Keep the truth. Raises ValueError if the truth is no surface, or has no volume."""
    return TrueSurface(truth), []


def take_model(params: Params, state: State, model: ShapeModel) -> tuple[State, Outputs]:
    """Measure one model; one without faces has no score.

    Raises ValueError if the truth has not been received, or the model is no surface.
    """
    if state is None:
        raise ValueError(f"model {model.number} came before the truth")
    if not len(model.faces):
        return state, [Finished("nothing could be rebuilt")] if model.final else []
    outputs: Outputs = [("/score", Deferred(Score, partial(_score, state, model)))]
    if model.final:
        outputs.append(Finished("the final solid was compared with the true one"))
    return state, outputs


def _score(truth: TrueSurface, model: ShapeModel, _: Steps) -> Score:
    every = 1 if model.final else EVERY
    samples = geometry.DEFAULT_SAMPLING.n_samples // every
    rebuilt = geometry.prepare_surface(model.vertices, model.faces, samples)
    distances = geometry.compare_surfaces(truth.prepared[every], rebuilt, truth.exposed)
    solid = geometry.solidity(model.vertices, model.faces)
    return Score(
        number=model.number,
        contours=len(model.contours),
        touches=model.touches,
        robot_time=model.robot_time,
        chamfer=distances.chamfer,
        rms=distances.rms,
        p95=distances.p95,
        hausdorff=distances.hausdorff,
        normal=distances.normal_deg,
        volume_error=solid.volume / truth.volume - 1.0,
        size=truth.height,
        sampling_floor=truth.floors[every],
        watertight=solid.watertight,
        genus=NO_GENUS if solid.genus is None else solid.genus,
        true_genus=truth.genus,
        exposed_rms=distances.rms_above,
        final=model.final,
    )


NODE = Node(
    params=Params,
    step="scoring",
    start=lambda params: (None, []),
    handler_timeout=120.0,
    inputs={"/truth": (Truth, take_truth), "/model/shape": (ShapeModel, take_model)},
    outputs={"/score": Score},
    needs=("/truth",),
)
