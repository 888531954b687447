"""What may still be spent: limits of touches and of robot time that no goal can overrun.

Every goal carries what it may take: so many touches, and a robot time by which the last of them has
ended even if it meets nothing on its way. The tracer makes no touch beyond that, and a goal that
comes back without a touch says that nothing more can be done. Where a whole contour no longer fits,
ends that are due come first, then as much of one as fits: its touches count.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.core.explore import Demand
from palpate.core.poses import Pose
from palpate.core.robot_time import RobotPreset, longest_seconds, move_between

if TYPE_CHECKING:
    from palpate.messages.types import GraspGoal
    from palpate.nodes.planning.phases import State

# Of the robot time that may pass, what the hand may take once it has touched enough for a fit.
GRASP_SHARE = 0.5
FEW_CONTACTS, LEAST_CLOSINGS = 12, 2  # That are enough for one
OPENING_SHARE = 0.8  # Of the reach: how far the hand's fingers open
# Touches of a contour, where none has been traced, and times as many as are expected that one of
# several fingers may take.
FIRST_CONTOUR, AMPLE = 30, 2.0


class Allowance(NamedTuple):
    """What a goal may take."""

    most_touches: int | None  # None: as many as it takes
    not_after: float | None  # Robot time, s; None: as long as it takes

    @property
    def touches(self) -> float:
        """Touches at most."""
        return math.inf if self.most_touches is None else self.most_touches


def allowance(demand: Demand, state: State) -> Allowance | None:
    """What a goal of an idle finger may take; None if others at work may take all that is left."""
    assert state.world is not None
    not_after = None if math.isinf(demand.most_seconds) else demand.most_seconds
    if math.isinf(demand.most_touches):
        return Allowance(None, not_after)
    promised = sum(task.allowed.touches for task in state.tasks.values())
    left = int(demand.most_touches) - state.touches - int(promised)
    if state.world.fingers > 1:
        left = min(left, math.ceil(AMPLE * _contour_touches(state)))
    return Allowance(left, not_after) if left > 0 else None


def fits_contour(demand: Demand, state: State) -> bool:
    """Whether a whole contour is expected to fit into what is left."""
    assert state.survey is not None
    allowed = allowance(demand, state)
    seconds = [one.seconds for one in state.survey.traced]
    ends = state.clock + (float(np.mean(seconds)) if seconds else 0.0)
    return (
        allowed is not None
        and _contour_touches(state) <= allowed.touches
        and ends <= demand.most_seconds
    )


def shortest_grasp(robot: RobotPreset, reach: float) -> float:
    """Robot time, s, of the fewest closings that may tell enough, by the world's `reach`, m."""
    return LEAST_CLOSINGS * longest_seconds(robot, 0.0, 0.0, OPENING_SHARE * reach)


def _contour_touches(state: State) -> float:
    traced = () if state.survey is None else state.survey.traced
    return float(np.mean([one.touches for one in traced])) if traced else FIRST_CONTOUR


def fits_closing(demand: Demand, state: State, goal: GraspGoal) -> bool:
    """Whether one closing of the hand more fits into the robot time that may pass."""
    assert state.world is not None
    known = len(state.grasped.points) >= FEW_CONTACTS
    limit = demand.most_seconds * (GRASP_SHARE if known else 1.0)
    if math.isinf(limit) or not len(state.world.robot):
        return state.clock < limit
    travel, turn = move_between(state.grasped.resting, Pose.from_array(goal.pose))
    travel += state.grasped.advanced + float(goal.advanced.max(initial=0.0))
    reach = goal.reach - (float(goal.advanced.min()) if len(goal.advanced) else 0.0)
    robot = RobotPreset.of_array(state.world.robot)
    return state.clock + longest_seconds(robot, travel, turn, reach) <= limit
