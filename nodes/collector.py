"""Collector node: makes a solid of touches that somebody else has chosen, in the planner's place.

It gives out no goals. When a driver says that no more frames will come, it asks the reconstructor
for a solid of all of them, says how good that is and where touches are missing, and ends the graph.
Where somebody turned the object over, it asks for a solid of each placement before: where the next
one's touches fit it tells how the object lay then.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.arrays import Floats
from palpate.core.explore import SURVEYING
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
from palpate.nodes.specs.frames import FRAMES_A_GOAL
from palpate.nodes.specs.primitives import Length
from palpate.nodes.specs.sensors import pad_of_info

if TYPE_CHECKING:
    from palpate.core.explore.planners import ObservedSurface
    from palpate.core.touch import Pad


@dataclass(frozen=True, slots=True, kw_only=True)
class CollectorSettings:
    """What is taken for granted of touches that somebody else has chosen."""

    max_reach: float = 0.6  # of all touches about their middle [m]: space is mapped no farther
    named_distance: float = (
        5e-3  # from every touch; what lies farther is named if none is asked [m]
    )
    margin: float = 0.02  # nothing of the object lies farther from all that was touched [m]


COLLECTING = CollectorSettings()


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Height on which the object stands, in the frame of the poses, m; null: it is held.
    platform: Annotated[float, Meta(ge=-10, le=10, description="m")] | None = None
    # Root mean square error that is asked for, m; null: whatever the touches give.
    tolerance: Length | None = None
    # Largest gap that may stay untouched, m; null: 100 times the tolerance.
    feature: Length | None = None

    @property
    def limits(self) -> Limits:
        """What is asked of the solid."""
        if self.tolerance is None:
            return Limits(feature=self.feature)
        return Limits(
            tolerance=self.tolerance,
            feature=self.feature or SURVEYING.feature_ratio * self.tolerance,
        )


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What has been received."""

    pad: Pad | None = None
    world: World | None = None  # Once all touches are there
    low: Floats = field(default_factory=lambda: np.full(3, np.inf))  # Of the pads that touched, m
    high: Floats = field(default_factory=lambda: np.full(3, -np.inf))
    # By goal, the frames received, those of them that touched, and the last of these, or the last
    # if none did.
    goals: Mapping[int, tuple[int, int, SurfacePatch]] = field(default_factory=dict)
    over: bool = False  # Whether it has ended without a solid
    end: SequenceEnd | None = None  # Once it is known how many there are

    @property
    def touches(self) -> tuple[int, int]:
        """Frames received, and those of them that touched."""
        counts = [one[:2] for one in self.goals.values()]
        return sum(one[0] for one in counts), sum(one[1] for one in counts)

    @property
    def turns(self) -> int:
        """How often the object was turned over."""
        return max((one[2].placement for one in self.goals.values()), default=0)


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return replace(state, pad=pad_of_info(info)), []


def take_patch(params: Params, state: State, patch: SurfacePatch) -> tuple[State, Outputs]:
    """Count a touch, and report its goal when that is full."""
    count, met, last = state.goals.get(patch.goal, (0, 0, patch))
    hit = patch.outcome in HITS
    entry = (count + 1, met + hit, patch if hit or not met else last)
    state = replace(state, goals={**state.goals, patch.goal: entry})
    if hit:
        place = patch.pose[:3]
        state = replace(state, low=np.minimum(state.low, place), high=np.maximum(state.high, place))
    full: Outputs = [_probe(patch.goal, entry)] if entry[0] == FRAMES_A_GOAL else []
    return _when_complete(params, state, full)


def take_end(params: Params, state: State, end: SequenceEnd) -> tuple[State, Outputs]:
    """Remember how many there are."""
    return _when_complete(params, replace(state, end=end), [])


def _when_complete(params: Params, state: State, outputs: Outputs) -> tuple[State, Outputs]:
    """With all frames received: the world as they tell of it, and a model to judge by."""
    frames, met = state.touches
    if state.end is None or frames < state.end.frames:
        return state, outputs
    rest = [(goal, one) for goal, one in state.goals.items() if one[0] < FRAMES_A_GOAL]
    outputs = [*outputs, *(_probe(goal, one) for goal, one in rest)]
    world = _world(params, state)
    why = "" if met else f"none of the {frames} frames shows a contact"
    if world.reach > COLLECTING.max_reach:
        why = (
            f"the touches reach {world.reach:.3g} m from their middle, more than "
            f"{COLLECTING.max_reach:g} m: are the poses in m, and the platform?"
        )
        world = replace(world, reach=COLLECTING.max_reach)
    if state.turns and params.platform is None:
        why = (
            "the object was turned over, but nobody knows on what it stood: say at which height "
            "the platform is, platform:=0 for instance"
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
    """The room about what was touched, upright on the platform, or lowest where that is unknown."""
    low, high = state.low - COLLECTING.margin, state.high + COLLECTING.margin
    if not np.isfinite(low).all():
        low, high = np.zeros(3), np.full(3, COLLECTING.margin)
    platform = float(low[2]) if params.platform is None else params.platform
    sides = 0.5 * np.linalg.norm(high[:2] - low[:2]), high[2] - platform
    return World(
        platform=platform,
        held=params.platform is None,
        reach=max(*map(float, sides), COLLECTING.margin),
        centre=0.5 * (low[:2] + high[:2]),
        fingers=1,
        seed=0,
    )


def _goal(state: State, placement: int | None = None) -> ModelGoal:
    """All touches; or those up to a placement, from which it is to be told how the object lay."""
    assert state.end is not None
    last = state.turns if placement is None else placement
    goals = {goal: one for goal, one in sorted(state.goals.items()) if one[2].placement <= last}
    return ModelGoal(
        number=state.turns + 1 if placement is None else placement,
        contours=(),
        probes=tuple(goal for goal, one in goals.items() if one[1]),
        missed=tuple(goal for goal, one in goals.items() if not one[1]),
        general=True,
        closings=0,
        final=placement is None,
        touches=sum(one[0] for one in goals.values()),
        robot_time=state.end.robot_time,
    )


def take_model(params: Params, state: State, model: ShapeModel) -> tuple[State, Outputs]:
    """Judge the last model, and end; that nothing was rebuilt of nothing is told already."""
    if state.over or not model.final:
        return state, []
    assert state.pad is not None and state.world is not None
    frames, met = state.touches
    asked = params.limits
    distance = COLLECTING.named_distance if asked.feature is None else asked.unknown_distance
    pose = Pose.from_array(model.placements[-1]) if len(model.placements) else None
    surface = observed_surface(model, state.pad, state.world, distance, pose=pose)
    if surface is None:
        why = f"what {met} of {frames} frames touched lies in one plane: touch other sides, too"
        reason = "; ".join(model.rejected) or why
        return _ended(state, [], _done(params, _goal(state), reason))
    reason = f"all {frames} frames were used, {met} of which show a contact"
    if len(model.placements) < state.turns:
        fault = "; ".join(model.placement_faults[-1:])
        turn = f"those since it was turned over {_times(len(model.placements) + 1)} are left out"
        reason = f"{turn}: {fault or 'no solid of those before tells how it lay'}"
    return _ended(state, [], _done(params, _goal(state), reason, surface))


def _times(count: int) -> str:
    """How often, in words."""
    return "once" if count == 1 else f"{count} times"


def _done(
    params: Params, goal: ModelGoal, reason: str, surface: ObservedSurface | None = None
) -> PlanDone:
    if surface is None:
        return plan_done(goal, reason, Findings(), params.limits)
    found, unknown = surface.findings, surface.open_area
    return plan_done(goal, reason, found, params.limits, unknown)


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
