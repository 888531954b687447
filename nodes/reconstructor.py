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

from palpate.core import (
    IDENTITY_POSE,
    Floats,
    Steps,
    advanced_pose,
    no_steps,
    rebuild,
    split_pose,
    tree_to_bytes,
)
from palpate.core.explore import Longs, SpaceMap, empty_map, swept_places
from palpate.core.geometry import nearest_points, nearest_search
from palpate.core.rebuild import lattice as lattices
from palpate.core.rebuild import surface
from palpate.core.rebuild.contours import ContactPoints, contact_points_of, stack_points
from palpate.core.rebuild.general import (
    COARSE,
    FEW_FOLDS,
    FINE,
    FOLDS,
    touch_distances,
    touch_squares,
)
from palpate.core.touch import Jet, Pad
from palpate.messages import derive, types
from palpate.nodes.runtime import Deferred, Node, Outputs
from palpate.nodes.specs import CONTACT_ERROR, pad_of_info

Goal = types.ModelGoal | types.PlanDone
AnySolid = rebuild.Solid | rebuild.GeneralSolid
TouchesByGoal = Mapping[int, Mapping[int, ContactPoints]]  # Goal to touch to what it touched
UPRIGHT_TOLERANCE = 1e-12  # By how much the cosine of an upright frame's lean may be less than 1
TOUCHED_OUTCOMES = ("hit", "bottomed")  # How a probe ended that met the object
COARSE_TOLERANCE = 5e-4  # Of the meshes on the way, of the size
BANDS, BAND_TURNS = 25, 8  # Heights of the uncertainty, and turns over which it is averaged
SETS = 3  # By how the last so many were predicted a method is chosen
SURE = 1.64  # Standard errors by which a general solid must predict better: 95 of 100
MUCH = 0.5  # Of the slices' error: what a general solid's must be below
KEPT = 4  # Fitted solids that are kept: the last ones
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
    parts: int  # Pieces of a general solid's cell along each of its edges


# Faces cost computing here, in scoring and in files; they do not change the surface.
QUALITIES: Mapping[str, Quality] = {
    "draft": Quality(6_000, 5e-4, 1),
    "normal": Quality(45_000, 5e-5, 2),
    "fine": Quality(180_000, 1e-5, 4),
}


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    quality: Literal["draft", "normal", "fine"] = "normal"  # Of the final model's mesh


class Candidates(NamedTuple):
    """The solids of one set, one of each method."""

    sliced: rebuild.Solid | None  # With its control lattice; None where slices make no solid
    general: rebuild.GeneralSolid | None  # None where nothing was touched, or slices do
    touched: ContactPoints  # Of what they are made
    why: str = ""  # Why slices make no solid, if they should

    def predicted(self, touched: ContactPoints) -> dict[str, Floats]:
        """Mean square distance of each touch from the solids, by method, m^2."""
        found = {}
        if self.sliced is not None:
            mesh = _mesh(self.sliced, None)
            search = nearest_search(mesh.vertices[mesh.faces])
            off = nearest_points(search, touched.points).distances
            found["lattice"] = touch_squares(touched, off)
        if self.general is not None:
            found["general"] = touch_squares(touched, self.general.residuals(touched.points))
        return found

    def better(self, predicted: Mapping[str, Floats]) -> AnySolid | None:
        """The general solid if it surely predicted the same touches better, else slices."""
        if self.sliced is None or self.general is None:
            return self.sliced or self.general
        sliced, general = (predicted.get(name, _NONE) for name in ("lattice", "general"))
        if not len(general) or len(sliced) != len(general):
            return self.sliced
        gain = sliced - general
        sure = gain.mean() > SURE * gain.std() / np.sqrt(len(gain))
        much = general.mean() < MUCH**2 * sliced.mean()
        return self.general if sure and much else self.sliced


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What has been received."""

    quality: Quality = QUALITIES["normal"]  # Of the final mesh
    platform: float = 0.0  # Height on which the object stands, m
    pad: Pad | None = None  # The sensor's array
    # Every touch; goals are numbered for all fingers together.
    touches: TouchesByGoal = field(default_factory=lambda: MappingProxyType({}))
    # Where the hand met the object, by the number of the closing; each contact is a touch.
    contacts: Mapping[int, ContactPoints] = field(default_factory=lambda: MappingProxyType({}))
    space: SpaceMap | None = None  # Of all that a finger reaches, empty
    # Voxels that the touches of a goal have swept.
    swept: Mapping[int, tuple[Longs, ...]] = field(default_factory=lambda: MappingProxyType({}))
    # By number.
    contours: Mapping[int, types.Contour] = field(default_factory=lambda: MappingProxyType({}))
    probes: Mapping[int, types.Probe] = field(
        default_factory=lambda: MappingProxyType({})
    )  # By number
    asked: tuple[Goal, ...] = ()  # Models still to be fitted, in order
    history: tuple[Goal, ...] = ()  # Those that were fitted, in order
    # What was fitted last, by number, lest it is fitted twice: no model differs for it.
    fitted: dict[int, Candidates] = field(default_factory=dict)


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
    space = empty_map(world.reach, world.platform)
    return replace(state, platform=world.platform, space=space), []


def know_sensor(params: Params, state: State, info: types.SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return replace(state, pad=pad_of_info(info)), []


def take_patch(params: Params, state: State, patch: types.SurfacePatch) -> tuple[State, Outputs]:
    """Keep what a touch measured."""
    assert state.pad is not None and state.space is not None
    jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
    points = contact_points_of(state.pad, patch.pose, patch.height, patch.mask, jet)
    of_goal = {**state.touches.get(patch.goal, {}), patch.touch: points}
    swept = state.swept
    if patch.outcome != "inside":
        start = advanced_pose(patch.pose, -patch.advance)
        met = patch.outcome in TOUCHED_OUTCOMES
        places = swept_places(state.pad, start, patch.pose, state.space.step, touched=met)
        freed = (*swept.get(patch.goal, ()), state.space.numbers(places))
        swept = {**swept, patch.goal: freed}
    touches = {**state.touches, patch.goal: of_goal}
    return _fit_ready(replace(state, touches=touches, swept=swept))


def take_contacts(
    params: Params, state: State, received: types.GraspContacts
) -> tuple[State, Outputs]:
    """Keep what the hand met."""
    each = np.arange(len(received.points), dtype=np.int32)
    met = ContactPoints(received.points, received.normals, each)
    contacts = {**state.contacts, received.number: met}
    return _fit_ready(replace(state, contacts=contacts))


def take_contour(params: Params, state: State, contour: types.Contour) -> tuple[State, Outputs]:
    """Keep a contour."""
    return _fit_ready(replace(state, contours={**state.contours, contour.id: contour}))


def take_probe(params: Params, state: State, probe: types.Probe) -> tuple[State, Outputs]:
    """Keep a probe."""
    return _fit_ready(replace(state, probes={**state.probes, probe.id: probe}))


def take_goal(params: Params, state: State, goal: Goal) -> tuple[State, Outputs]:
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
            if state.space is not None:
                space = Deferred(types.SpaceMap, partial(_space, state, goal))
                outputs.append(("/model/space", space))
            shape = Deferred(types.ShapeModel, partial(_fit, state, goal))
            outputs.append(("/model/shape", shape))
            state = replace(state, history=(*state.history, goal))
    return replace(state, asked=tuple(asked)), outputs


def _is_complete(state: State, goal: Goal) -> bool:
    """Whether all of a set is there."""
    if _is_coarse(goal):
        return all(number in state.contacts for number in range(goal.closings))
    contours = (*goal.contours, *goal.arcs)
    wanted: list[types.Contour | types.Probe | None] = [state.contours.get(id_) for id_ in contours]
    wanted += [state.probes.get(id_) for id_ in (*goal.probes, *goal.missed)]
    return all(number in state.contacts for number in range(goal.closings)) and all(
        one is not None and len(state.touches.get(one.id, {})) == one.touches for one in wanted
    )


def _is_coarse(goal: Goal) -> TypeGuard[types.ModelGoal]:
    """Whether a superquadric is asked for."""
    return isinstance(goal, types.ModelGoal) and not touched_goals(goal)


def touched_goals(goal: Goal) -> tuple[int, ...]:
    """Numbers of all goals whose touches count for a model."""
    return (*goal.contours, *goal.probes, *goal.arcs)


def _coarse(state: State, goal: types.ModelGoal, step: Steps) -> types.Superquadric:
    contacts = [state.contacts[number].points for number in range(goal.closings)]
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


def _space(state: State, goal: Goal, step: Steps) -> types.SpaceMap:
    """The map that goes with a model."""
    assert state.space is not None
    with step("space"):
        space = _marked(state, goal)
    return derive(types.SpaceMap, space, number=goal.number)


def _marked(state: State, goal: Goal) -> SpaceMap:
    assert state.space is not None
    none = np.zeros(0, np.int64)
    ids = (*touched_goals(goal), *goal.missed)
    free = [voxels for id_ in ids for voxels in state.swept.get(id_, ())]
    points = [one.points for one in _touched(state, goal)]
    touched = state.space.numbers(np.concatenate([np.zeros((0, 3)), *points]))
    return state.space.marked(np.concatenate([none, *free]), touched)


def _touched(state: State, goal: Goal) -> list[ContactPoints]:
    ids = touched_goals(goal)
    return [state.touches[id_][n] for id_ in ids for n in sorted(state.touches.get(id_, {}))]


def _fit(state: State, goal: Goal, step: Steps) -> types.ShapeModel:
    final = isinstance(goal, types.PlanDone)
    candidates = _candidates(state, goal, step, final=final)
    with step("prediction"):
        predicted, enough = _predicted(state, goal, step)
    state.fitted[goal.number] = candidates
    for number in sorted(state.fitted)[:-KEPT]:
        del state.fitted[number]
    quality = state.quality if final else None
    solid = candidates.better(predicted if enough else {})
    return shape_model(goal, candidates, solid, predicted, quality, step)


def _predicted(state: State, goal: Goal, step: Steps) -> tuple[dict[str, Floats], bool]:
    """Mean square distance of each of the last touches from the solids before it, by method, m^2.

    Those of the last `SETS` different sets, each by the solids of the one before it; and whether
    the better one is to be published: where a slice could not be traced, or slices make no solid.
    """
    squares: dict[str, list[Floats]] = {"lattice": [], "general": []}
    later, sets, enough = goal, 0, False
    for before in reversed(state.history):
        touched = _since(state, before, later)
        if not len(touched.points):
            continue
        fitted = state.fitted.get(before.number) or _candidates(state, before, step, final=False)
        known = fitted.sliced is None or bool(goal.arcs)
        if enough and not known:
            break
        for method, found in fitted.predicted(touched).items():
            squares[method].append(found)
        later, sets, enough = before, sets + 1, known
        if sets == SETS:
            break
    return {method: np.concatenate(found) for method, found in squares.items() if found}, enough


def _since(state: State, before: Goal, goal: Goal) -> ContactPoints:
    """What was touched between two goals."""
    known = set(touched_goals(before))
    ids = [id_ for id_ in touched_goals(goal) if id_ not in known]
    found = [state.touches[id_][n] for id_ in ids for n in sorted(state.touches.get(id_, {}))]
    return stack_points([one for one in found if len(one.points)])


def _candidates(state: State, goal: Goal, step: Steps, *, final: bool) -> Candidates:
    sliced, why = None, ""
    if goal.contours and not goal.general:
        try:
            sliced = _rebuild(state, goal, step)
        except ValueError as error:  # what was touched is no solid: a result, not a fault
            why = str(error)
    touched = [one for one in _touched(state, goal) if len(one.points)]
    grasped = [state.contacts[number] for number in range(goal.closings)]
    general = None
    if touched and (sliced is None or goal.arcs):
        general = rebuild.rebuild_general(
            stack_points([one for one in grasped if len(one.points)] + touched),
            free=_marked(state, goal).free_places(),
            platform=state.platform,
            cell=FINE if final else COARSE,
            folds=FOLDS if final else FEW_FOLDS,
            step=step,
        )
    return Candidates(sliced, general, stack_points(touched), why)


def shape_model(
    goal: Goal,  # Who asked for it
    candidates: Candidates,  # What was fitted; neither if there was nothing to rebuild
    solid: AnySolid | None,  # The one of these that is published
    predicted: Mapping[str, Floats],  # Mean square distances of new touches, by method, m^2
    quality: Quality | None = None,  # Of the mesh, if it is the final one
    step: Steps = no_steps,  # Told which step begins
) -> types.ShapeModel:
    """The message for the solid that predicts better."""
    dropped: dict[int, str] = {}
    if candidates.sliced is not None:
        dropped = {one.which: one.why for one in candidates.sliced.slices.dropped}
    elif candidates.why:
        dropped = dict.fromkeys(range(len(goal.contours)), candidates.why)
    final = isinstance(goal, types.PlanDone)
    parts, frame = EMPTY_MODEL, IDENTITY_POSE
    deviation = None
    if isinstance(solid, rebuild.Solid):
        parts = _parts(solid, quality, step)
        frame = IDENTITY_POSE if solid.frame is None else solid.frame
        with step("bound"):
            deviation = solid.whole_deviation()
    elif solid is not None:
        parts = _general_parts(solid, quality, step)
    return derive(
        types.ShapeModel,
        goal,
        method="lattice" if solid is candidates.sliced else "general",
        predicted={name: float(np.sqrt(found.mean())) for name, found in predicted.items()},
        dropped=tuple(goal.contours[which] for which in dropped),
        dropped_reasons=tuple(dropped.values()),
        frame=frame,
        deviation=0.0 if deviation is None else deviation.whole,
        ends_deviation=0.0 if deviation is None else deviation.ends,
        **parts,
        **_errors(parts["vertices"], candidates, step),
        final=final,
        archive=tree_to_bytes(solid) if solid is not None and final else NO_ARCHIVE,
    )


def _errors(vertices: Floats, candidates: Candidates, step: Steps) -> dict[str, Any]:
    """Distance from touch at each vertex, and the error that it lets expect, if that is known."""
    if not len(candidates.touched.points) or not len(vertices):
        return {}
    with step("bound"):
        distances = touch_distances(candidates.touched, vertices)
        errors = bounds = np.zeros_like(distances)  # slices tell of theirs by height
        if candidates.general is not None:
            errors = candidates.general.predicted.at(distances)
            bounds = candidates.general.predicted.at(distances, upper=True)
        told = {"vertex_errors": errors, "vertex_bounds": bounds}
        return {"vertex_distances": distances, **told}


def _general_parts(
    solid: rebuild.GeneralSolid, quality: Quality | None, step: Steps
) -> dict[str, Any]:
    with step("mesh"):
        mesh = solid.mesh(1 if quality is None else quality.parts)
    told = {"vertices": mesh.vertices, "faces": mesh.faces}
    return EMPTY_MODEL | told | {"health": _rounded(solid.health())}


def _rounded(health: Mapping[str, float]) -> dict[str, float]:
    """To digits that do not depend on the machine, so that bodies do not."""
    return {name: float(f"{value:.2g}") for name, value in health.items()}


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
        "health": _rounded(solid.health()),
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


def _rebuild(state: State, goal: Goal, step: Steps) -> rebuild.Solid:
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
    outputs={
        "/model/coarse": types.Superquadric,
        "/model/shape": types.ShapeModel,
        "/model/space": types.SpaceMap,
    },
    needs=("/world", "/touch/info"),
    fan_in=("/touch/patch", "/contour/traced", "/probe/traced"),
)
