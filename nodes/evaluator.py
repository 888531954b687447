"""Evaluator node: measures each model against the truth, which only a simulation has.

It publishes a score for each model, and ends after the final one.
"""

from __future__ import annotations

import math
from functools import partial

import msgspec

from palpate.core import geometry
from palpate.core.explore.planners import DEFAULT_SURFACE
from palpate.core.steps import Steps
from palpate.messages.types import Score, ShapeModel, Truth
from palpate.nodes.runtime.node import Deferred, Finished, Node, Outputs

NO_GENUS = -1  # genus of a surface that is not closed


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """No parameters."""


class TrueSurface:
    """The true surface, sampled for comparisons.

    Models before the final one are compared by one in `thinning` samples. Raises ValueError if the
    truth is no surface, or has no volume.
    """

    def __init__(self, truth: Truth, thinning: int = 20) -> None:
        self.height = truth.height
        standing = DEFAULT_SURFACE.places.standing_height
        self.exposed = (  # minimum height of the surface that fingers can touch [m]
            -math.inf if truth.platform is None else truth.platform + standing
        )
        solid = geometry.solidity(truth.vertices, truth.faces)
        self.volume = solid.volume  # [m^3]
        self.genus = NO_GENUS if solid.genus is None else solid.genus
        if not self.volume > 0.0:
            raise ValueError(f"the truth must have a positive volume, got {self.volume} m3")
        surface = geometry.prepare_surface(truth.vertices, truth.faces)
        second = geometry.prepare_surface(truth.floor_vertices, truth.floor_faces)
        # The surface, and the Chamfer distance of its two tessellations [m], each with all samples
        # and with one in `thinning`.
        self.thinning = thinning
        self.prepared = {n: surface.thinned(n) for n in (1, thinning)}
        self.floors = {
            n: geometry.compare_surfaces(thinned, second.thinned(n)).chamfer
            for n, thinned in self.prepared.items()
        }


State = TrueSurface | None  # None before the truth is received


def take_truth(params: Params, state: State, truth: Truth) -> tuple[State, Outputs]:
    """Remember the truth; ValueError if it is no surface, or has no volume."""
    return TrueSurface(truth), []


def take_model(params: Params, state: State, model: ShapeModel) -> tuple[State, Outputs]:
    """Measure one model; a model without faces has no score.

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
    thinning = 1 if model.final else truth.thinning
    samples = geometry.DEFAULT_SAMPLING.n_samples // thinning
    rebuilt = geometry.prepare_surface(model.vertices, model.faces, samples)
    distances = geometry.compare_surfaces(truth.prepared[thinning], rebuilt, truth.exposed)
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
        sampling_floor=truth.floors[thinning],
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
