"""Procedure node: an exploratory procedure in place of planner and tracer.

Procedures are defined in `palpate.core.procedures`. The node turns their moves into goals of
fingers and hand, and their findings into messages. Moves of several fingers begin together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from palpate.core.explore import spanned_places
from palpate.core.poses import IDENTITY_POSE, Pose
from palpate.core.procedures import (
    Contact,
    Findings,
    FingerMove,
    HandContacts,
    Session,
    TouchSetup,
    begin_procedure,
    procedure_of,
)
from palpate.core.touch import HITS
from palpate.messages import types
from palpate.nodes.runtime.node import MAX_FINGERS, Finished, Node, Outputs
from palpate.nodes.specs.sensors import pad_of_info

if TYPE_CHECKING:
    from palpate.core.procedures import (
        BoundaryModel,
        ConeFit,
        ConePoseFit,
        FoundOpenings,
        HandMove,
        MoveResult,
    )
    from palpate.core.rebuild.recovery import Recovery

Metres = Annotated[float, Meta(ge=0, le=0.01, description="m")]
Radians = Annotated[float, Meta(ge=0, le=0.1, description="rad")]


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # containment, planar, follower, fearing, openings, or a user's own, ``module:function``.
    procedure: str
    settings: dict[str, Any] = {}  # of the procedure
    most_touches: Annotated[int, Meta(ge=1, le=100_000)] = 1000  # maximum number of touches
    # Standard deviation of fingertip positions along each axis [m]: a model is refuted by a contact
    # that is farther off than three times this.
    point_error: Metres = 0.1e-3
    angle_error: Radians = math.radians(0.1)  # standard deviation of fingertip angles [rad]

    def __post_init__(self) -> None:
        try:
            procedure_of(self.procedure, self.settings)
        except LookupError as error:
            raise ValueError(error.args[0]) from None


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The procedure and its results so far."""

    world: types.World | None = None
    info: types.SensorInfo | None = None
    session: Session | None = None  # of the procedure; None until world and sensor are known
    results: tuple[MoveResult, ...] = ()  # of its moves
    # Results by finger while other fingers are still moving.
    pending: Mapping[int, types.SurfacePatch] = field(default_factory=dict)
    under_way: int = 0  # number of moving fingers
    moves: int = 0  # number of requested moves of fingers
    closings: int = 0  # of the hand
    touches: int = 0  # of all fingers
    contacts: int = 0  # of the hand
    clock: float = 0.0  # robot time [s]


def know_sensor(params: Params, state: State, info: types.SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor, and begin when the world is known."""
    return _begin(params, replace(state, info=info))


def know_world(params: Params, state: State, world: types.World) -> tuple[State, Outputs]:
    """Remember the world, and begin when the sensor is known."""
    return _begin(params, replace(state, world=world))


def _begin(params: Params, state: State) -> tuple[State, Outputs]:
    if state.world is None or state.info is None or state.session is not None:
        return state, []
    setup = TouchSetup(
        pad=pad_of_info(state.info),
        noise=state.info.noise,
        platform=state.world.platform,
        reach=state.world.reach,
        fingers=state.world.fingers,
        point_error=params.point_error,
        angle_error=params.angle_error,
    )
    session = begin_procedure(params.procedure, params.settings, setup)
    return _next_move(params, replace(state, session=session))


def take_patch(params: Params, state: State, patch: types.SurfacePatch) -> tuple[State, Outputs]:
    """Keep the result of a finger; continue when all moving fingers have one."""
    if patch.goal != state.moves - 1 or patch.finger > state.under_way:
        raise ValueError(
            f"unexpected touch {patch.touch} of goal {patch.goal}: no such touch was requested"
        )
    pending = {**state.pending, patch.finger: patch}
    clock = max(state.clock, patch.robot_time)
    state = replace(state, pending=pending, clock=clock, touches=state.touches + 1)
    if len(pending) < state.under_way:
        return state, []
    assert state.info is not None
    patches = [pending[number + 1] for number in range(state.under_way)]
    contacts = tuple(_contact(state.info, item) for item in patches)
    probes: Outputs = [
        ("/probe/traced", _probe(state, item, contact))
        for item, contact in zip(patches, contacts, strict=True)
    ]
    state = replace(state, results=(*state.results, contacts), pending={}, under_way=0)
    state, outputs = _next_move(params, state)
    return state, [*probes, *outputs]


def _probe(state: State, patch: types.SurfacePatch, contact: Contact) -> types.Probe:
    """The contact of a finger as a probe, for displays."""
    point = contact.middle if contact.is_hit else patch.pose[:3]
    number = MAX_FINGERS * patch.goal + patch.finger
    return types.Probe(
        id=number,
        finger=patch.finger,
        outcome=patch.outcome,
        point=point,
        normal=patch.normal,
        touches=1,
        fault=patch.fault,
        robot_time=patch.robot_time,
    )


def _contact(info: types.SensorInfo, patch: types.SurfacePatch) -> Contact:
    """The contact of a finger in the world."""
    pad = pad_of_info(info)
    points = hollow = np.zeros((0, 3))
    pose = Pose.from_array(patch.pose)
    if patch.outcome in HITS:
        points = patch.points
        hollow = spanned_places(pad, pose, patch.mask)
    return Contact(
        outcome=patch.outcome,
        kind=patch.kind,
        pose=pose,
        points=points,
        normal=patch.normal,
        normal_error=patch.normal_error,
        hollow=hollow,
        curvatures=(patch.k1, patch.k2),
        curvature_errors=(patch.k1_error, patch.k2_error),
        direction=patch.principal_direction,
        robot_time=patch.robot_time,
    )


def take_contacts(
    params: Params, state: State, contacts: types.GraspContacts
) -> tuple[State, Outputs]:
    """Continue with the contacts of the hand."""
    if contacts.number != state.closings - 1:
        raise ValueError(f"unexpected closing {contacts.number}: it was not requested")
    hand = HandContacts(contacts.points, contacts.normals, contacts.fingers, contacts.robot_time)
    state = replace(
        state,
        results=(*state.results, hand),
        contacts=state.contacts + len(contacts.points),
        clock=max(state.clock, contacts.robot_time),
    )
    return _next_move(params, state)


def _next_move(params: Params, state: State) -> tuple[State, Outputs]:
    """Request the next move, or publish the findings."""
    assert state.session is not None and state.world is not None
    step = state.session.after(state.results)
    if isinstance(step, Findings):
        return state, _findings_outputs(params, state, step)
    if not isinstance(step, tuple) or not isinstance(step[0], FingerMove):
        return _close(state, step)
    if len(step) > state.world.fingers:
        why = f"it needs {len(step)} fingers at once, and there are {state.world.fingers}"
        return state, _findings_outputs(params, state, Findings(status="unsuited", reason=why))
    if state.touches + len(step) > params.most_touches:
        why = f"{params.most_touches} touches were not enough"
        return state, _findings_outputs(params, state, Findings(status="incomplete", reason=why))
    goals: Outputs = [
        ("/finger/goal", _touch_goal(state, number, move))
        for number, move in enumerate(step, start=1)
    ]
    return replace(state, moves=state.moves + 1, under_way=len(step)), goals


def _touch_goal(state: State, finger: int, move: FingerMove) -> types.TouchGoal:
    return types.TouchGoal(
        goal=state.moves,
        touch=0,
        finger=finger,
        pose=move.pose.array,
        reach=move.reach,
        depth=move.depth,
        direction=move.pose.axes[:, 1],
        not_before=state.clock,
    )


def _close(state: State, move: HandMove) -> tuple[State, Outputs]:
    hand = move.hand
    goal = types.GraspGoal(
        number=state.closings,
        pose=move.pose.array,
        fingers=hand.fingers,
        opening=hand.opening,
        reach=hand.reach,
        advanced=np.array(hand.advanced),
        not_before=state.clock,
    )
    return replace(state, closings=state.closings + 1), [("/hand/goal", goal)]


def _findings_outputs(params: Params, state: State, findings: Findings) -> Outputs:
    """The findings, their model and its surface, and the end of graphs without evaluator."""
    spent: dict[str, Any] = {"touches": state.touches, "robot_time": state.clock}
    result = types.ProcedureResult(
        procedure=params.procedure,
        status=findings.status,
        reason=findings.reason,
        figures=dict(findings.figures),
        contacts=state.contacts,
        **spent,
    )
    outputs: Outputs = []
    if findings.shape is not None:
        topic, convert = MODELS.get(type(findings.shape).__name__, ("", None))
        # A user's own model has no message.
        outputs += [] if convert is None else [(topic, convert(findings.shape))]
    mesh: dict[str, Any] = {} if findings.mesh is None else findings.mesh._asdict()
    shape = types.ShapeModel(
        number=0,
        method="procedure",
        contours=(),
        probes=(),
        dropped=(),
        dropped_reasons=(),
        frame=IDENTITY_POSE,
        final=True,
        **spent,
        **mesh,
    )
    done = Finished(f"{params.procedure}: {findings.status}")
    return [*outputs, ("/procedure/result", result), ("/model/shape", shape), done]


def _superquadric(recovery: Recovery) -> types.Superquadric:
    return types.Superquadric(
        number=0,
        size=recovery.size,
        exponents=recovery.exponents,
        pose=recovery.pose,
        taper=recovery.taper,
        warnings=recovery.warnings,
        residuals=recovery.residuals,
        rank=recovery.rank,
        bend=recovery.bend.curvature,
        bend_direction=recovery.bend.direction,
        residual=recovery.rms,
    )


def _boundary(model: BoundaryModel) -> types.BoundaryRepresentation:
    edges = model.polyhedron.edges
    return types.BoundaryRepresentation(
        vertices=model.vertices,
        edge_vertices=edges.ends,
        edge_faces=edges.faces,
        edge_before=edges.before,
        edge_after=edges.after,
        face_begins=edges.begins,
        face_corners=edges.corners,
        face_normals=np.array([plane.normal for plane in model.planes]),
        face_offsets=np.array([plane.offset for plane in model.planes]),
        face_touches=np.array(model.touches, np.int32),
        residual=model.rms,
    )


def _cone(fit: ConeFit, n_heights: int = 100, n_azimuths: int = 144) -> types.GeneralisedCone:
    """The cone by radii at even heights, and a section at even azimuths."""
    heights = np.linspace(fit.low, fit.high, n_heights)
    azimuths = 2.0 * np.pi * np.arange(n_azimuths) / n_azimuths
    around = fit.radius(np.full(n_azimuths, heights[0]), azimuths)
    zero = fit.radius(heights, np.zeros(n_heights))
    section = around / around.mean()
    return types.GeneralisedCone(
        kind=fit.kind,
        point=fit.point,
        axis=fit.axis,
        axis_error=fit.axis_error,
        azimuth_zero=fit.across[:, 0],
        heights=heights,
        radii=zero / section[0],
        section=section,
        residual=fit.rms,
    )


def _cone_pose(fit: ConePoseFit) -> types.ConePose:
    return types.ConePose(
        axis=fit.orientation.axis,
        phi=fit.orientation.phi,
        psi=fit.orientation.psi,
        axis_error=float(np.sqrt(np.linalg.eigvalsh(fit.orientation.covariance)[-1])),
        apex=fit.origin.point,
        apex_covariance=fit.origin.covariance,
        half_angles=np.array(fit.half_angles),
        features=tuple(feature.name for feature in fit.features),
        interpretations=fit.interpretations,
        residual_sigma=fit.residual_sigma,
    )


def _openings(result: FoundOpenings) -> types.Openings:
    return types.Openings(
        kinds=tuple(opening.kind for opening in result.openings),
        places=np.array([opening.place for opening in result.openings]).reshape(-1, 3),
        axes=np.array([opening.axis for opening in result.openings]).reshape(-1, 3),
        widths=np.array([opening.width for opening in result.openings]),
        depths=np.array([opening.depth for opening in result.openings]),
    )


# Topic of a recovered model by its class, and the function that makes the message.
MODELS: Mapping[str, tuple[str, Callable[[Any], object] | None]] = {
    "Recovery": ("/model/coarse", _superquadric),
    "BoundaryModel": ("/model/boundary", _boundary),
    "ConeFit": ("/model/cone", _cone),
    "ConePoseFit": ("/model/cone_pose", _cone_pose),
    "FoundOpenings": ("/model/openings", _openings),
}


NODE = Node(
    params=Params,
    start=lambda params: (State(), []),
    handler_timeout=120.0,
    step="procedure",
    inputs={
        "/world": (types.World, know_world),
        "/touch/info": (types.SensorInfo, know_sensor),
        "/hand/contacts": (types.GraspContacts, take_contacts),
        "/touch/patch": (types.SurfacePatch, take_patch),
    },
    outputs={
        "/hand/goal": types.GraspGoal,
        "/finger/goal": types.TouchGoal,
        "/probe/traced": types.Probe,
        "/procedure/result": types.ProcedureResult,
        "/model/coarse": types.Superquadric,
        "/model/boundary": types.BoundaryRepresentation,
        "/model/cone": types.GeneralisedCone,
        "/model/cone_pose": types.ConePose,
        "/model/openings": types.Openings,
        "/model/shape": types.ShapeModel,
    },
    needs=("/world", "/touch/info"),
    fan_in=("/touch/patch",),
)
