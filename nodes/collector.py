"""Collector node: requests a solid of touches that others chose, in place of the planner.

It sends no touch goals. After the last frame of a driver it requests a solid of all frames, states
its error and where touches are missing, and ends the graph. If the object was turned over, it
requests a solid of each earlier placement, from which the next placement's pose is found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.arrays import Floats
from palpate.core.explore import DEFAULT_SURVEY
from palpate.core.explore.planners import Findings, Limits
from palpate.core.poses import Pose
from palpate.core.touch import HITS
from palpate.messages.types import (
    ModelGoal,
    PlanDone,
    Probe,
    SensorInfo,
    SequenceEnd,
    ShapeModel,
    SurfacePatch,
    World,
)
from palpate.nodes.planning.knowledge import observed_surface, plan_done
from palpate.nodes.runtime.node import Finished, Node, Outputs
from palpate.nodes.specs.frames import FRAMES_PER_GOAL
from palpate.nodes.specs.primitives import Length
from palpate.nodes.specs.sensors import pad_of_info

if TYPE_CHECKING:
    from palpate.core.explore.planners import ObservedSurface
    from palpate.core.touch import Pad


@dataclass(frozen=True, slots=True, kw_only=True)
class CollectorSettings:
    """Assumptions on touches that others chose."""

    max_reach: float = 0.6  # of contacts from their middle; the run fails beyond it [m]
    # Distance from all touches beyond which surface is unknown, if no feature is requested [m].
    unknown_distance: float = 5e-3
    margin: float = 0.02  # of the mapped space around the box of all contacts [m]


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Height of the platform under the object, in the frame of the poses [m]; null: it is held.
    platform: Annotated[float, Meta(ge=-10, le=10, description="m")] | None = None
    # Requested root mean square error [m]; null: none.
    tolerance: Length | None = None
    # Largest allowed untouched gap [m]; null: 100 times the tolerance.
    feature: Length | None = None

    @property
    def limits(self) -> Limits:
        """The limits on the solid."""
        if self.tolerance is None:
            return Limits(feature=self.feature)
        return Limits(
            tolerance=self.tolerance,
            feature=self.feature or DEFAULT_SURVEY.feature_ratio * self.tolerance,
        )


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Messages that have been received."""

    pad: Pad | None = None
    world: World | None = None  # known with all touches
    # Box of the pads with contact [m].
    low: Floats = field(default_factory=lambda: np.full(3, np.inf))
    high: Floats = field(default_factory=lambda: np.full(3, -np.inf))
    # By goal: number of frames, number of frames with contact, and the last frame with contact, or
    # the last frame if there is none.
    goals: Mapping[int, tuple[int, int, SurfacePatch]] = field(default_factory=dict)
    over: bool = False  # whether the run has ended without a solid
    end: SequenceEnd | None = None  # known after the last frame
    settings: CollectorSettings = CollectorSettings()

    @property
    def touches(self) -> tuple[int, int]:
        """Numbers of frames, and of frames with contact."""
        entries = self.goals.values()
        return sum(entry[0] for entry in entries), sum(entry[1] for entry in entries)

    @property
    def turns(self) -> int:
        """Number of times that the object was turned over."""
        return max((entry[2].placement for entry in self.goals.values()), default=0)


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return replace(state, pad=pad_of_info(info)), []


def take_patch(params: Params, state: State, patch: SurfacePatch) -> tuple[State, Outputs]:
    """Count a frame, and report its goal when it has all frames."""
    count, n_contacts, last = state.goals.get(patch.goal, (0, 0, patch))
    is_hit = patch.outcome in HITS
    entry = (count + 1, n_contacts + is_hit, patch if is_hit or not n_contacts else last)
    state = replace(state, goals={**state.goals, patch.goal: entry})
    if is_hit:
        point = patch.pose[:3]
        state = replace(state, low=np.minimum(state.low, point), high=np.maximum(state.high, point))
    full: Outputs = [_probe(patch.goal, entry)] if entry[0] == FRAMES_PER_GOAL else []
    return _when_complete(params, state, full)


def take_end(params: Params, state: State, end: SequenceEnd) -> tuple[State, Outputs]:
    """Remember the number of frames."""
    return _when_complete(params, replace(state, end=end), [])


def _when_complete(params: Params, state: State, outputs: Outputs) -> tuple[State, Outputs]:
    """After the last frame, the world around the contacts, and requests for models."""
    frames, n_contacts = state.touches
    if state.end is None or frames < state.end.frames:
        return state, outputs
    partial = [item for item in state.goals.items() if item[1][0] < FRAMES_PER_GOAL]
    outputs = [*outputs, *(_probe(goal, entry) for goal, entry in partial)]
    world = _world(params, state)
    why = "" if n_contacts else f"none of the {frames} frames shows a contact"
    max_reach = state.settings.max_reach
    if world.reach > max_reach:
        why = (
            f"the touches reach {world.reach:.3g} m from their middle, more than "
            f"{max_reach:g} m: are the poses in m, and the platform?"
        )
        world = replace(world, reach=max_reach)
    if state.turns and params.platform is None:
        why = (
            "the object was turned over, but the height of its platform is unknown: give it, as "
            "platform:=0"
        )
    state = replace(state, world=world, over=bool(why))
    outputs.append(("/world", world))
    if why:
        return _ended(state, outputs, _done(params, replace(_goal(state), probes=()), why))
    earlier = [_goal(state, placement) for placement in range(1, state.turns + 1)]
    return state, [*outputs, *(("/model/goal", goal) for goal in (*earlier, _goal(state)))]


def _probe(goal: int, entry: tuple[int, int, SurfacePatch]) -> tuple[str, Probe]:
    count, _, last = entry
    probe = Probe(
        id=goal,
        finger=last.finger,
        placement=last.placement,
        outcome=last.outcome,
        point=last.pose[:3],
        normal=last.normal,
        touches=count,
        fault=last.fault,
        robot_time=last.robot_time,
    )
    return "/probe/traced", probe


def _world(params: Params, state: State) -> World:
    """The world around the contacts, on the platform, or on the lowest contact if it is unknown."""
    margin = state.settings.margin
    low, high = state.low - margin, state.high + margin
    if not np.isfinite(low).all():
        low, high = np.zeros(3), np.full(3, margin)
    platform = float(low[2]) if params.platform is None else params.platform
    sides = 0.5 * np.linalg.norm(high[:2] - low[:2]), high[2] - platform
    return World(
        platform=platform,
        held=params.platform is None,
        reach=max(*map(float, sides), margin),
        centre=0.5 * (low[:2] + high[:2]),
        fingers=1,
        seed=0,
    )


def _goal(state: State, placement: int | None = None) -> ModelGoal:
    """A model of all touches, or of those up to a placement, to find the pose of the next one."""
    assert state.end is not None
    last = state.turns if placement is None else placement
    goals = {goal: e for goal, e in sorted(state.goals.items()) if e[2].placement <= last}
    return ModelGoal(
        number=state.turns + 1 if placement is None else placement,
        contours=(),
        probes=tuple(goal for goal, entry in goals.items() if entry[1]),
        missed=tuple(goal for goal, entry in goals.items() if not entry[1]),
        general=True,
        closings=0,
        final=placement is None,
        touches=sum(entry[0] for entry in goals.values()),
        robot_time=state.end.robot_time,
    )


def take_model(params: Params, state: State, model: ShapeModel) -> tuple[State, Outputs]:
    """Judge the final model and end the graph, unless it has ended without a solid."""
    if state.over or not model.final:
        return state, []
    assert state.pad is not None and state.world is not None
    frames, n_contacts = state.touches
    limits = params.limits
    distance = limits.unknown_distance
    if limits.feature is None:
        distance = state.settings.unknown_distance
    pose = Pose.from_array(model.placements[-1]) if len(model.placements) else None
    surface = observed_surface(model, state.pad, state.world, distance, pose=pose)
    if surface is None:
        why = (
            f"all contacts, of {n_contacts} of {frames} frames, lie in one plane: touch other sides"
        )
        reason = "; ".join(model.rejected) or why
        return _ended(state, [], _done(params, _goal(state), reason))
    reason = f"all {frames} frames were used, {n_contacts} of which show a contact"
    underside = surface.findings.underside_share
    if params.platform is not None and underside and not state.turns:
        reason += (
            f"; the underside, {underside:.0%} of the surface, is taken for flat: turn the object "
            "over, touch it there, and add these frames with placement 1"
        )
    if len(model.placements) < state.turns:
        fault = "; ".join(model.placement_faults[-1:])
        turn = f"those since it was turned over {_times(len(model.placements) + 1)} are left out"
        reason = f"{turn}: {fault or 'its pose is unknown without a solid of earlier touches'}"
    return _ended(state, [], _done(params, _goal(state), reason, surface))


def _times(count: int) -> str:
    """A number of times, in words."""
    return "once" if count == 1 else f"{count} times"


def _done(
    params: Params, goal: ModelGoal, reason: str, surface: ObservedSurface | None = None
) -> PlanDone:
    if surface is None:
        return plan_done(goal, reason, Findings(), params.limits)
    return plan_done(goal, reason, surface.findings, params.limits, surface.open_area)


def _ended(state: State, outputs: Outputs, done: PlanDone) -> tuple[State, Outputs]:
    return state, [*outputs, ("/plan/done", done), Finished("all frames were used")]


NODE = Node(
    params=Params,
    step="planning",
    start=lambda params: (State(), []),
    handler_timeout=20.0,
    inputs={
        "/touch/info": (SensorInfo, know_sensor),
        "/touch/patch": (SurfacePatch, take_patch),
        "/touch/end": (SequenceEnd, take_end),
        "/model/shape": (ShapeModel, take_model),
    },
    outputs={
        "/world": World,
        "/probe/traced": Probe,
        "/model/goal": ModelGoal,
        "/plan/done": PlanDone,
    },
    needs=("/touch/info",),
)
