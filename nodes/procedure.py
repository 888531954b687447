"""Procedure node: an exploratory procedure in the planner's and the tracer's place.

What a procedure does, and why, stands in `palpate.core.procedures`; here its moves become goals of
the fingers and the hand, and its findings messages. Moves of several fingers begin together.
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

HEIGHTS, AZIMUTHS = 100, 144  # At which a generalised cone is told

Metres = Annotated[float, Meta(ge=0, le=0.01, description="m")]
Radians = Annotated[float, Meta(ge=0, le=0.1, description="rad")]


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # containment, planar, follower, fearing, openings, or one's own, ``module:function``.
    procedure: str
    settings: dict[str, Any] = {}  # Its numbers
    most_touches: Annotated[int, Meta(ge=1, le=100_000)] = 1000  # Touches that may be made
    # Standard deviation of a finger's place along each axis, m: what is three times as far off a
    # model refutes it.
    point_error: Metres = 0.1e-3
    angle_error: Radians = math.radians(0.1)  # Standard deviation of how a finger is turned, rad

    def __post_init__(self) -> None:
        try:
            procedure_of(self.procedure, self.settings)
        except LookupError as error:
            raise ValueError(error.args[0]) from None


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What the node remembers between two messages."""

    world: types.World | None = None
    info: types.SensorInfo | None = None
    session: Session | None = None  # The procedure; None until world and sensor are known
    results: tuple[MoveResult, ...] = ()  # What its moves met
    # Finger to what its move has met, while others are still under way.
    pending: Mapping[int, types.SurfacePatch] = field(default_factory=dict)
    under_way: int = 0  # Fingers that move
    moves: int = 0  # Moves of fingers asked for
    closings: int = 0  # Of the hand
    touches: int = 0  # Of all fingers
    contacts: int = 0  # Of the hand
    clock: float = 0.0  # Robot time spent, s


def know_sensor(params: Params, state: State, info: types.SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor, and begin when the world is known, too."""
    return _begin(params, replace(state, info=info))


def know_world(params: Params, state: State, world: types.World) -> tuple[State, Outputs]:
    """Remember the world, and begin when the sensor is known, too."""
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
    return _go_on(params, replace(state, session=session))


def take_patch(params: Params, state: State, patch: types.SurfacePatch) -> tuple[State, Outputs]:
    """Keep what a finger met; go on once all have met something, or nothing."""
    if patch.goal != state.moves - 1 or patch.finger > state.under_way:
        raise ValueError(f"nobody asked for touch {patch.touch} of goal {patch.goal}")
    pending = {**state.pending, patch.finger: patch}
    clock = max(state.clock, patch.robot_time)
    state = replace(state, pending=pending, clock=clock, touches=state.touches + 1)
    if len(pending) < state.under_way:
        return state, []
    assert state.info is not None
    patches = [pending[number + 1] for number in range(state.under_way)]
    met = tuple(_contact(state.info, one) for one in patches)
    probes: Outputs = [
        ("/probe/traced", _probe(state, one, contact))
        for one, contact in zip(patches, met, strict=True)
    ]
    state = replace(state, results=(*state.results, met), pending={}, under_way=0)
    state, outputs = _go_on(params, state)
    return state, [*probes, *outputs]


def _probe(state: State, patch: types.SurfacePatch, contact: Contact) -> types.Probe:
    """What a finger met, for whoever follows the exploration."""
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
    """What a finger met, world frame."""
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
    """Go on with what the hand met."""
    if contacts.number != state.closings - 1:
        raise ValueError(f"nobody asked for closing {contacts.number}")
    met = HandContacts(contacts.points, contacts.normals, contacts.fingers, contacts.robot_time)
    state = replace(
        state,
        results=(*state.results, met),
        contacts=state.contacts + len(contacts.points),
        clock=max(state.clock, contacts.robot_time),
    )
    return _go_on(params, state)


def _go_on(params: Params, state: State) -> tuple[State, Outputs]:
    """Ask for the next move, or tell what was found."""
    assert state.session is not None and state.world is not None
    step = state.session.after(state.results)
    if isinstance(step, Findings):
        return state, _told(params, state, step)
    if not isinstance(step, tuple) or not isinstance(step[0], FingerMove):
        return _close(state, step)
    if len(step) > state.world.fingers:
        why = f"it needs {len(step)} fingers at once, and there are {state.world.fingers}"
        return state, _told(params, state, Findings(status="unsuited", reason=why))
    if state.touches + len(step) > params.most_touches:
        why = f"{params.most_touches} touches were not enough"
        return state, _told(params, state, Findings(status="incomplete", reason=why))
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


def _told(params: Params, state: State, findings: Findings) -> Outputs:
    """The findings, their model and its surface, and the end where nobody measures it."""
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
        topic, told = MODELS.get(type(findings.shape).__name__, ("", None))
        outputs += [] if told is None else [(topic, told(findings.shape))]  # one's own has none
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


def _superquadric(found: Recovery) -> types.Superquadric:
    return types.Superquadric(
        number=0,
        size=found.size,
        exponents=found.exponents,
        pose=found.pose,
        taper=found.taper,
        warnings=found.warnings,
        residuals=found.residuals,
        rank=found.rank,
        bend=found.bend.curvature,
        bend_direction=found.bend.direction,
        residual=found.rms,
    )


def _boundary(found: BoundaryModel) -> types.BoundaryRepresentation:
    edges = found.polyhedron.edges
    return types.BoundaryRepresentation(
        vertices=found.vertices,
        edge_vertices=edges.ends,
        edge_faces=edges.faces,
        edge_before=edges.before,
        edge_after=edges.after,
        face_begins=edges.begins,
        face_corners=edges.corners,
        face_normals=np.array([plane.normal for plane in found.planes]),
        face_offsets=np.array([plane.offset for plane in found.planes]),
        face_touches=np.array(found.touches, np.int32),
        residual=found.rms,
    )


def _cone(found: ConeFit) -> types.GeneralisedCone:
    heights = np.linspace(found.low, found.high, HEIGHTS)
    azimuths = 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    around = found.radius(np.full(AZIMUTHS, heights[0]), azimuths)
    zero = found.radius(heights, np.zeros(HEIGHTS))
    section = around / around.mean()
    return types.GeneralisedCone(
        kind=found.kind,
        point=found.point,
        axis=found.axis,
        axis_error=found.axis_error,
        azimuth_zero=found.across[:, 0],
        heights=heights,
        radii=zero / section[0],
        section=section,
        residual=found.rms,
    )


def _cone_pose(found: ConePoseFit) -> types.ConePose:
    return types.ConePose(
        axis=found.orientation.axis,
        phi=found.orientation.phi,
        psi=found.orientation.psi,
        axis_error=float(np.sqrt(np.linalg.eigvalsh(found.orientation.covariance)[-1])),
        apex=found.origin.point,
        apex_covariance=found.origin.covariance,
        half_angles=np.array(found.half_angles),
        features=tuple(one.name for one in found.features),
        interpretations=found.interpretations,
        residual_sigma=found.residual_sigma,
    )


def _openings(found: FoundOpenings) -> types.Openings:
    return types.Openings(
        kinds=tuple(one.kind for one in found.openings),
        places=np.array([one.place for one in found.openings]).reshape(-1, 3),
        axes=np.array([one.axis for one in found.openings]).reshape(-1, 3),
        widths=np.array([one.width for one in found.openings]),
        depths=np.array([one.depth for one in found.openings]),
    )


# Of what a procedure recovers, by its class: the topic and what makes the message.
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
