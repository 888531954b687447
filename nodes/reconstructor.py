"""Reconstructor node: rebuilds exactly the sets that it is asked for.

A set of contours and probes gives a solid; closings of the hand alone give a superquadric. It
is fitted once all of it has been received, whichever input brings the last of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeGuard

import numpy as np
from msgspec import Struct

from palpate.core import IDENTITY_POSE, Floats, Steps, no_steps, rebuild, split_pose, tree_to_bytes
from palpate.core.rebuild import lattice as lattices
from palpate.core.rebuild import surface
from palpate.core.rebuild.contours import ContactPoints, contact_points_of, stack_points
from palpate.core.touch import Jet, Pad
from palpate.messages import derive, types
from palpate.nodes.runtime import Deferred, Node, Outputs
from palpate.nodes.specs import CONTACT_ERROR, pad_of_info

TouchesByGoal = Mapping[int, Mapping[int, ContactPoints]]  # Goal to touch to what it touched
UPRIGHT_TOLERANCE = 1e-12  # By how much the cosine of an upright frame's lean may be less than 1
TOUCHED_OUTCOMES = ("hit", "bottomed")  # How a probe ended that met the object
COARSE_TOLERANCE = 5e-4  # Of the meshes on the way, of the size
BANDS, BAND_TURNS = 25, 8  # Heights of the uncertainty, and turns over which it is averaged
NO_ARCHIVE = np.zeros(0, np.uint8)
_NONE = np.zeros(0)
# Of a model of nothing.
EMPTY_MODEL: dict[str, Any] = {
    **dict.fromkeys(("control", "undeformed"), np.zeros((0, 0, 0, 3))),
    **dict.fromkeys(("knots_columns", "knots_rows", "knots_layers"), _NONE),
    **dict.fromkeys(("uncertainty_height", "uncertainty"), _NONE),
    "vertices": np.zeros((0, 3)),
    "faces": np.zeros((0, 3), np.int32),
    "health": {},
}


class Quality(NamedTuple):
    """How finely the final model is meshed."""

    faces: int  # Triangles, about, if it takes as many
    tolerance: float  # Of the size: distance of the mesh from the surface, at least


# Faces cost computing here, in scoring and in files; they do not change the surface.
QUALITIES: Mapping[str, Quality] = {
    "draft": Quality(6_000, 5e-4),
    "normal": Quality(45_000, 5e-5),
    "fine": Quality(180_000, 1e-5),
}


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    quality: Literal["draft", "normal", "fine"] = "normal"  # Of the final model's mesh


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What has been received."""

    quality: Quality = QUALITIES["normal"]  # Of the final mesh
    platform: float = 0.0  # Height on which the object stands, m
    pad: Pad | None = None  # The sensor's array
    # Every touch; goals are numbered for all fingers together.
    touches: TouchesByGoal = field(default_factory=lambda: MappingProxyType({}))
    # Where the hand met the object, by the number of the closing.
    contacts: Mapping[int, Floats] = field(default_factory=lambda: MappingProxyType({}))
    # By number.
    contours: Mapping[int, types.Contour] = field(default_factory=lambda: MappingProxyType({}))
    probes: Mapping[int, types.Probe] = field(
        default_factory=lambda: MappingProxyType({})
    )  # By number
    asked: tuple[types.ModelGoal | types.PlanDone, ...] = ()  # Models still to be fitted, in order


def common_frame(contours: Sequence[types.Contour]) -> Floats:
    """Pose (7,) of the frame in which all contours were traced.

    Raises ValueError if they were not all traced in the same.
    """
    first = contours[0]
    for other in contours[1:]:
        if not np.array_equal(other.frame, first.frame):
            raise ValueError(
                f"contours must be traced in one slicing frame, but that of contour {other.id} "
                f"is not that of contour {first.id}"
            )
    return first.frame


def is_upright(frame: Floats) -> bool:
    """Whether heights in a frame are the world's, so that an object stands on its lower end."""
    return bool(split_pose(frame)[1][2, 2] >= 1.0 - UPRIGHT_TOLERANCE)


def touched_ends(
    contours: Sequence[types.Contour],
    probes: Sequence[types.Probe],
    touched: Mapping[int, Sequence[ContactPoints]],
    platform: float | None,
) -> Floats | None:
    """Where the ends of an object were touched, (k, 3), m; None if they were not.

    Arguments are as for `rebuild_set`; of probes of which nothing else is known, their own point
    counts. A known height on which the object stands is a touch of its lower end if it is upright.

    Raises ValueError if the contours were not traced in one frame.
    """
    frame = common_frame(contours)
    tops = list(_probed(contours, probes, touched, frame))
    if platform is not None and is_upright(frame):
        tops.append(np.array([*frame[:2], platform]))
    return np.array(tops) if tops else None


def _probed(
    contours: Sequence[types.Contour],
    probes: Sequence[types.Probe],
    touched: Mapping[int, Sequence[ContactPoints]],
    frame: Floats,
) -> Iterator[Floats]:
    """Farthest point (3,) of each probe that touched an end: beyond the contours."""
    position, axes = split_pose(frame)
    levels = [contour.height for contour in contours]
    low, high = min(levels), max(levels)
    for probe in probes:
        if probe.outcome not in TOUCHED_OUTCOMES:
            continue
        way = 1.0 if (probe.point - position) @ axes[:, 2] > 0.5 * (low + high) else -1.0
        found = [one.points for one in touched.get(probe.id, ()) if len(one.points)]
        points = np.concatenate(found) if found else probe.point[None]
        reached = way * (points - position) @ axes[:, 2]
        if reached.max() > max(way * low, way * high):
            yield points[int(reached.argmax())]


def know_world(params: Params, state: State, world: types.World) -> tuple[State, Outputs]:
    """Remember the platform."""
    return replace(state, platform=world.platform), []


def know_sensor(params: Params, state: State, info: types.SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return replace(state, pad=pad_of_info(info)), []


def take_patch(params: Params, state: State, patch: types.SurfacePatch) -> tuple[State, Outputs]:
    """Keep what a touch measured."""
    assert state.pad is not None
    jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
    points = contact_points_of(state.pad, patch.pose, patch.height, patch.mask, jet)
    of_goal = {**state.touches.get(patch.goal, {}), patch.touch: points}
    return _fit_ready(replace(state, touches={**state.touches, patch.goal: of_goal}))


def take_contacts(
    params: Params, state: State, received: types.GraspContacts
) -> tuple[State, Outputs]:
    """Keep what the hand met."""
    contacts = {**state.contacts, received.number: received.points}
    return _fit_ready(replace(state, contacts=contacts))


def take_contour(params: Params, state: State, contour: types.Contour) -> tuple[State, Outputs]:
    """Keep a contour."""
    return _fit_ready(replace(state, contours={**state.contours, contour.id: contour}))


def take_probe(params: Params, state: State, probe: types.Probe) -> tuple[State, Outputs]:
    """Keep a probe."""
    return _fit_ready(replace(state, probes={**state.probes, probe.id: probe}))


def take_goal(
    params: Params, state: State, goal: types.ModelGoal | types.PlanDone
) -> tuple[State, Outputs]:
    """Fit a set, at once or when all of it has been received."""
    return _fit_ready(replace(state, asked=(*state.asked, goal)))


def _fit_ready(state: State) -> tuple[State, Outputs]:
    """Fit the models whose turn has come, in the order of their numbers."""
    outputs: Outputs = []
    asked = sorted(state.asked, key=lambda goal: goal.number)
    while asked and _is_complete(state, asked[0]):
        goal = asked.pop(0)
        if _is_coarse(goal):
            outputs.append(
                ("/model/coarse", Deferred(types.Superquadric, partial(_coarse, state, goal)))
            )
        else:
            outputs.append(("/model/shape", Deferred(types.ShapeModel, partial(_fit, state, goal))))
    return replace(state, asked=tuple(asked)), outputs


def _is_complete(state: State, goal: types.ModelGoal | types.PlanDone) -> bool:
    """Whether all of a set is there."""
    if _is_coarse(goal):
        return all(number in state.contacts for number in range(goal.closings))
    contours = (*goal.contours, *goal.arcs)
    wanted: list[types.Contour | types.Probe | None] = [state.contours.get(id_) for id_ in contours]
    wanted += [state.probes.get(id_) for id_ in goal.probes]
    return all(
        one is not None and len(state.touches.get(one.id, {})) == one.touches for one in wanted
    )


def _is_coarse(goal: types.ModelGoal | types.PlanDone) -> TypeGuard[types.ModelGoal]:
    """Whether a superquadric is asked for."""
    return isinstance(goal, types.ModelGoal) and not (goal.contours or goal.probes)


def _coarse(state: State, goal: types.ModelGoal, step: Steps) -> types.Superquadric:
    contacts = [state.contacts[number] for number in range(goal.closings)]
    with step("superquadric"):
        return coarse_model(goal.number, np.concatenate([np.zeros((0, 3)), *contacts]))


def coarse_model(number: int, contacts: Floats) -> types.Superquadric:
    """The message for the superquadric through contacts (n, 3), m."""
    found = rebuild.fit_coarse(contacts, CONTACT_ERROR)
    return derive(
        types.Superquadric,
        found,
        number=number,
        bend=found.bend.curvature,
        bend_direction=found.bend.direction,
        residual=found.rms,
    )


def _fit(state: State, goal: types.ModelGoal | types.PlanDone, step: Steps) -> types.ShapeModel:
    if not goal.contours:
        return shape_model(goal, None)
    try:
        return shape_model(goal, _rebuild(state, goal, step), quality=state.quality, step=step)
    except ValueError as why:  # what was touched is no solid: a result to be told, not a fault
        return shape_model(goal, None, str(why))


def shape_model(
    goal: types.ModelGoal | types.PlanDone,  # Who asked for it
    solid: rebuild.Solid | None,  # None if there was nothing to rebuild: the model is empty
    why: str = "",  # Why nothing could be rebuilt of contours that are there
    quality: Quality = QUALITIES["normal"],  # Of the mesh, if it is the final one
    step: Steps = no_steps,  # Told which step begins
) -> types.ShapeModel:
    """The message for a solid."""
    if solid is not None:
        dropped: dict[int, str] = {one.which: one.why for one in solid.slices.dropped}
    else:
        dropped = dict.fromkeys(range(len(goal.contours)) if why else (), why)
    final = isinstance(goal, types.PlanDone)
    parts = EMPTY_MODEL if solid is None else _parts(solid, quality if final else None, step)
    with step("bound"):
        deviation = None if solid is None else solid.whole_deviation()
    return derive(
        types.ShapeModel,
        goal,
        dropped=tuple(goal.contours[which] for which in dropped),
        dropped_reasons=tuple(dropped.values()),
        frame=IDENTITY_POSE if solid is None or solid.frame is None else solid.frame,
        deviation=0.0 if deviation is None else deviation.whole,
        ends_deviation=0.0 if deviation is None else deviation.ends,
        **parts,
        final=final,
        archive=tree_to_bytes(solid) if solid is not None and final else NO_ARCHIVE,
    )


def _parts(solid: rebuild.Solid, quality: Quality | None, step: Steps) -> dict[str, Any]:
    """Everything of a model that is the solid's; without a quality its mesh is coarse."""
    lattice = solid.control_lattice
    assert lattice is not None
    with step("mesh"):
        grid, mesh = lattices.lattice_grid(lattice), _mesh(solid, quality)
    with step("bound"):
        heights, deviation = _band(solid)
    return {
        "control": grid.control,
        "undeformed": grid.undeformed,
        **dict(zip(("knots_columns", "knots_rows", "knots_layers"), grid.knots, strict=True)),
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "uncertainty_height": heights,
        "uncertainty": deviation,
        # To digits that do not depend on the machine, so that bodies do not
        "health": {name: float(f"{value:.2g}") for name, value in solid.health().items()},
    }


def _mesh(solid: rebuild.Solid, quality: Quality | None) -> surface.SurfaceMesh:
    """At the end about as many triangles whatever the shape: a first mesh tells how fine."""
    coarse = COARSE_TOLERANCE * solid.surface.size
    first = solid.mesh(coarse)
    if quality is None or len(first.faces) >= quality.faces:
        return first
    finer = coarse * len(first.faces) / quality.faces
    return solid.mesh(max(finer, quality.tolerance * solid.surface.size))


def _band(solid: rebuild.Solid) -> tuple[Floats, Floats]:
    """Heights along the slicing axis, and the side's standard deviation there."""
    assert solid.closed is not None
    if solid.closed.radial is not None:
        return solid.closed.radial.band_heights, solid.closed.radial.band
    heights = np.linspace(*solid.closed.loft.surface.reach, BANDS)
    deviation = solid.closed.loft.deviation(heights, np.arange(BAND_TURNS) / BAND_TURNS)
    return heights, np.sqrt(np.mean(deviation**2, axis=1))


def _rebuild(state: State, goal: types.ModelGoal | types.PlanDone, step: Steps) -> rebuild.Solid:
    touched = {
        id_: [state.touches[id_][touch] for touch in sorted(state.touches.get(id_, {}))]
        for id_ in (*goal.contours, *goal.probes, *goal.arcs)
    }
    return rebuild_set(
        [state.contours[id_] for id_ in goal.contours],
        [state.probes[id_] for id_ in goal.probes],
        touched,
        state.platform,
        step,
    )


def rebuild_set(
    contours: Sequence[types.Contour],  # At least one
    probes: Sequence[types.Probe],  # Single touches beside them
    # What each touch of these measured, and of unfinished contours, by the goal's number
    touched: Mapping[int, Sequence[ContactPoints]],
    platform: float,  # Height on which the object stands, m
    step: Steps = no_steps,  # Told which step begins
) -> rebuild.Solid:
    """The solid of a set.

    Raises ValueError if the contours were not traced in one frame, or as `reconstruct` does.
    """
    frame = common_frame(contours)
    points = [each for of_goal in touched.values() for each in of_goal]
    return rebuild.reconstruct(
        [contour.points for contour in contours],
        patches=stack_points(points),
        tops=touched_ends(contours, probes, touched, platform),
        frame=frame,
        step=step,
    )


NODE = Node(
    params=Params,
    step="contacts",
    start=lambda params: (State(quality=QUALITIES[params.quality]), []),
    handler_timeout=120.0,
    inputs={
        "/world": (types.World, know_world),
        "/touch/info": (types.SensorInfo, know_sensor),
        "/hand/contacts": (types.GraspContacts, take_contacts),
        "/touch/patch": (types.SurfacePatch, take_patch),
        "/contour/traced": (types.Contour, take_contour),
        "/probe/traced": (types.Probe, take_probe),
        "/model/goal": (types.ModelGoal, take_goal),
        "/plan/done": (types.PlanDone, take_goal),
    },
    outputs={"/model/coarse": types.Superquadric, "/model/shape": types.ShapeModel},
    needs=("/world", "/touch/info"),
    fan_in=("/touch/patch", "/contour/traced", "/probe/traced"),
)
