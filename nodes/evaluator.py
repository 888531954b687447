"""Evaluator: measures each model against the truth. Only a simulation has one.

Silent until it has heard the truth; then one score for each model, and the end of the graph
after the score of the final one.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from palpate.core.measure.distance import Prepared, compare, prepare
from palpate.core.measure.solidity import solidity
from palpate.messages.types import Score, ShapeModel, Truth
from palpate.nodes.node import Finished, Node, Outputs

NO_GENUS = -1
"""Genus of a surface that is not closed: it has none."""


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Nothing to set: distances are measured the same way everywhere."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The truth, ready to be compared with; None before it was heard."""

    surface: Prepared | None = None
    volume: float = 0.0
    """m3"""
    height: float = 0.0
    """m"""
    sampling_floor: float = 0.0
    """Chamfer distance between two tessellations of the truth, m."""


def hear_truth(params: Params, state: State, truth: Truth) -> tuple[State, Outputs]:
    """Prepare the truth, and measure the sampling floor once.

    Raises
    ------
    ValueError
        If the truth is no surface, or has no volume.
    """
    volume = solidity(truth.vertices, truth.faces).volume
    if not volume > 0.0:
        raise ValueError(f"the truth must have a positive volume, got {volume} m3")
    surface = prepare(truth.vertices, truth.faces)
    floor = prepare(truth.floor_vertices, truth.floor_faces)
    return State(
        surface=surface,
        volume=volume,
        height=truth.height,
        sampling_floor=compare(surface, floor).chamfer,
    ), []


def hear_model(params: Params, state: State, model: ShapeModel) -> tuple[State, Outputs]:
    """Measure one model; one without faces has no score.

    Raises
    ------
    ValueError
        If the truth has not been heard, or the model is no surface.
    """
    if state.surface is None:
        raise ValueError(f"model {model.number} came before the truth")
    if not len(model.faces):
        return state, [Finished("nothing could be rebuilt")] if model.final else []
    outputs: Outputs = [("/score", _score(state, state.surface, model))]
    if model.final:
        outputs.append(Finished("final model scored"))
    return state, outputs


def _score(state: State, truth: Prepared, model: ShapeModel) -> Score:
    distances = compare(truth, prepare(model.vertices, model.faces))
    solid = solidity(model.vertices, model.faces)
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
        volume_error=solid.volume / state.volume - 1.0,
        sampling_floor=state.sampling_floor,
        size=state.height,
        watertight=solid.watertight,
        genus=NO_GENUS if solid.genus is None else solid.genus,
        final=model.final,
    )


NODE = Node(
    params=Params,
    start=lambda params: (State(), []),
    longest=120.0,
    inputs={"/truth": (Truth, hear_truth), "/model/shape": (ShapeModel, hear_model)},
    outputs={"/score": Score},
    needs=("/truth",),
)
