"""Planner node: finds the top, asks for slices from the middle up and down, then for the cap."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.arrays import Floats
from palpate.core.explore.phases import Cap, Slices, Summit, Top
from palpate.core.explore.uniform import (
    CLEARANCE,
    approach,
    cap_places,
    from_above,
    retry_height,
    search_places,
    slice_heights,
    uncovered_height,
)
from palpate.core.frames import IDENTITY
from palpate.core.plane.area_centroid import area_centroid
from palpate.messages.types import (
    Contour,
    ContourGoal,
    ModelGoal,
    PlanDone,
    Probe,
    ProbeGoal,
    SensorInfo,
    World,
)
from palpate.nodes.node import Node, Outputs

SAME_PLACE = 4.0e-3
"""A touch from above this near to a contour's middle has felt the top, m."""
USABLE = ("closed", "occluded")
"""Endings after which a contour with points is of use."""
HIGHER = 0.01
"""A top higher by more than this share of the height has the slices planned anew."""
SPACING = 12.0e-3
"""Distance of the places at which the object is looked for from above, m: less than a pad."""


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    contours: Annotated[int, Meta(ge=1, le=200)] = 9
    """Slices to trace."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What the planner knows."""

    world: World | None = None
    """Where the object stands."""
    pad_width: float = 0.0
    """Of the finger, m."""
    phase: Top | Slices | Summit | Cap | None = None
    """What is under way."""
    top: float = 0.0
    """Highest point felt, m."""
    contours: tuple[Contour, ...] = ()
    """Usable contours in the order in which they came."""
    probes: tuple[Probe, ...] = ()
    """Touches from above that hit."""
    goals: int = 0
    """Contours and probes asked for."""
    models: int = 0
    """Models asked for."""
    touches: int = 0
    """Touches spent."""
    clock: float = 0.0
    """Robot time spent, s."""


def start(params: Params) -> tuple[State, Outputs]:
    """Wait for the world."""
    return State(), []


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember how wide the finger is."""
    return replace(state, pad_width=info.pitch * max(info.rows, info.cols)), []


def know_world(params: Params, state: State, world: World) -> tuple[State, Outputs]:
    """Begin: look for the object from above."""
    state = replace(state, world=world, phase=Top(tuple(search_places(world.reach, SPACING))))
    return _look_for_top(params, state)


def take_probe(params: Params, state: State, probe: Probe) -> tuple[State, Outputs]:
    """Go on after a touch from above."""
    hit = probe.outcome in ("hit", "bottomed")
    state = replace(
        state,
        touches=state.touches + probe.touches,
        clock=probe.robot_time,
        probes=(*state.probes, probe) if hit else state.probes,
        top=max(state.top, float(probe.point[2])) if hit else state.top,
    )
    if isinstance(state.phase, Top):
        return _begin_slices(params, state, probe) if hit else _look_for_top(params, state)
    if isinstance(state.phase, Summit):
        return _after_summit(params, state, state.phase)
    assert isinstance(state.phase, Cap)
    return _touch_cap(params, replace(state, phase=Cap(state.phase.places[1:])))


def take_contour(params: Params, state: State, contour: Contour) -> tuple[State, Outputs]:
    """Go on after a contour: ask for a model with it, and for the next slice."""
    assert isinstance(state.phase, Slices) and state.world is not None
    slices, platform = state.phase, state.world.platform
    state = replace(state, touches=state.touches + contour.touches, clock=contour.robot_time)
    outputs: Outputs = []
    following = Slices(slices.heights[1:], top_is_sure=slices.top_is_sure)
    if contour.status in USABLE and len(contour.points):
        state = replace(state, contours=(*state.contours, contour), models=state.models + 1)
        outputs = [("/model/goal", _model_goal(state))]
    elif not slices.retried:
        again = retry_height(slices.heights[0], platform, state.top, params.contours)
        following = Slices((again, *slices.heights[1:]), True, slices.top_is_sure)
    state = replace(state, phase=following)
    if len(state.contours) == 1 and not slices.top_is_sure:
        state, more = _feel_summit(params, state, following.heights)
    else:
        state, more = _trace_next(params, state)
    return state, outputs + more


def _look_for_top(params: Params, state: State) -> tuple[State, Outputs]:
    assert isinstance(state.phase, Top) and state.world is not None
    if not state.phase.places:
        return _done(params, state, "nothing was felt from above")
    place, *rest = state.phase.places
    height = state.world.platform + state.world.reach
    return _probe(replace(state, phase=Top(tuple(rest))), place, height, state.world.reach)


def _begin_slices(params: Params, state: State, probe: Probe) -> tuple[State, Outputs]:
    assert state.world is not None
    top = float(probe.point[2])
    heights = slice_heights(state.world.platform, top, params.contours)
    return _trace_next(params, replace(state, top=top, phase=Slices(tuple(heights))))


def _feel_summit(params: Params, state: State, heights: tuple[float, ...]) -> tuple[State, Outputs]:
    """Touch the top over the middle of the first contour, unless that has been done."""
    assert state.world is not None
    middle = area_centroid(state.contours[0].points)
    if np.linalg.norm(middle - state.probes[0].point[:2]) < SAME_PLACE:
        return _trace_next(params, replace(state, phase=Slices(heights, top_is_sure=True)))
    height = state.world.platform + state.world.reach
    return _probe(replace(state, phase=Summit(heights)), middle, height, state.world.reach)


def _after_summit(params: Params, state: State, summit: Summit) -> tuple[State, Outputs]:
    """Go on with the slices, planned anew if the top is higher than was thought."""
    assert state.world is not None
    heights = summit.heights
    first = float(state.probes[0].point[2])
    if state.top - first > HIGHER * (first - state.world.platform):
        heights = tuple(slice_heights(state.world.platform, state.top, params.contours))
    return _trace_next(params, replace(state, phase=Slices(heights, top_is_sure=True)))


def _trace_next(params: Params, state: State) -> tuple[State, Outputs]:
    assert isinstance(state.phase, Slices) and state.world is not None
    if not state.phase.heights:
        return _begin_cap(params, state)
    height = state.phase.heights[0]
    centre, radius = _expected(state, height)
    goal = ContourGoal(
        id=state.goals,
        finger=1,
        frame=IDENTITY,
        height=height,
        centre=centre,
        radius=radius,
        not_before=state.clock,
    )
    return replace(state, goals=state.goals + 1), [("/contour/goal", goal)]


def _expected(state: State, height: float) -> tuple[Floats, float]:
    """Middle of a slice, and how far outside to begin."""
    assert state.world is not None
    if not state.contours:
        return state.probes[0].point[:2], state.world.reach
    return approach(
        height,
        [contour.height for contour in state.contours],
        [contour.points for contour in state.contours],
    )


def _begin_cap(params: Params, state: State) -> tuple[State, Outputs]:
    if not state.contours:
        return _done(params, state, "no contour could be closed")
    highest = max(state.contours, key=lambda contour: contour.height)
    places = cap_places(highest.points, state.pad_width)
    return _touch_cap(params, replace(state, phase=Cap(tuple(places))))


def _touch_cap(params: Params, state: State) -> tuple[State, Outputs]:
    assert isinstance(state.phase, Cap) and state.world is not None
    if not state.phase.places:
        return _done(params, state, _reason(params, state))
    reach = state.top - state.world.platform
    return _probe(state, state.phase.places[0], state.top, reach)


def _probe(state: State, place: Floats, height: float, reach: float) -> tuple[State, Outputs]:
    goal = ProbeGoal(
        id=state.goals,
        finger=1,
        pose=from_above(place, height),
        reach=reach + 2.0 * CLEARANCE,
        not_before=state.clock,
    )
    return replace(state, goals=state.goals + 1), [("/probe/goal", goal)]


def _model_goal(state: State) -> ModelGoal:
    return ModelGoal(
        number=state.models,
        contours=tuple(contour.id for contour in state.contours),
        probes=tuple(probe.id for probe in state.probes),
        closings=0,
        touches=state.touches,
        robot_time=state.clock,
    )


def _done(params: Params, state: State, reason: str) -> tuple[State, Outputs]:
    state = replace(state, models=state.models + 1, phase=None)
    done = PlanDone(
        number=state.models,
        contours=tuple(contour.id for contour in state.contours),
        probes=tuple(probe.id for probe in state.probes),
        touches=state.touches,
        robot_time=state.clock,
        reason=reason,
        within=None,
        bound=None,
        unfelt=None,
        uncovered=uncovered_height(
            state.world.platform if state.world else 0.0,
            state.top,
            params.contours,
            [contour.height for contour in state.contours],
        ),
    )
    return state, [("/plan/done", done)]


def _reason(params: Params, state: State) -> str:
    if len(state.contours) >= params.contours:
        return f"all {len(state.contours)} slices are traced"
    return f"{len(state.contours)} of {params.contours} slices are traced, the others failed"


NODE = Node(
    params=Params,
    start=start,
    inputs={
        "/world": (World, know_world),
        "/touch/info": (SensorInfo, know_sensor),
        "/contour/traced": (Contour, take_contour),
        "/probe/traced": (Probe, take_probe),
    },
    outputs={
        "/contour/goal": ContourGoal,
        "/probe/goal": ProbeGoal,
        "/model/goal": ModelGoal,
        "/plan/done": PlanDone,
    },
    needs=("/world", "/touch/info"),
)
