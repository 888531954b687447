"""Tracer node: traces the contours and makes the single touches that the planner requests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.arrays import Floats
from palpate.core.explore import tracing
from palpate.core.poses import Pose
from palpate.core.robot_time import RobotPreset, longest_seconds, move_between
from palpate.core.touch import HITS, Jet, Pad
from palpate.messages import types
from palpate.nodes.runtime.node import Finger, Node, Outputs
from palpate.nodes.specs.sensors import pad_of_info


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Maximum number of touches of a contour.
    most_touches: Annotated[int, Meta(ge=10, le=10_000)] = 150
    # Number of successive invalid frames after which a contour is given up.
    most_faults: Annotated[int, Meta(ge=1, le=1000)] = 3
    finger: Finger = 1  # whose goals it takes


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A contour or a probe that is being made; a probe has only the goal and touches."""

    goal: types.ContourGoal | types.ProbeGoal
    touches: int = 0  # number of requested touches, repeated ones included
    frame: Pose | None = None  # slicing frame
    trace: tracing.Trace | None = None  # of the contour so far
    aim: tracing.TouchCommand | None = None  # command of the last touch
    faults: int = 0  # number of successive invalid frames


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The finger, its current job and further goals."""

    fingers: int = 1  # number of fingers
    robot: RobotPreset | None = None  # with its speeds, if they are known
    resting: Pose | None = None  # start pose of the last touch
    pad: Pad | None = None
    job: Job | None = None
    waiting: tuple[types.ContourGoal | types.ProbeGoal, ...] = ()  # later goals


def know_world(params: Params, state: State, world: types.World) -> tuple[State, Outputs]:
    """Remember the number of fingers and the speeds of the robot."""
    robot = RobotPreset.of_array(world.robot) if len(world.robot) else None
    return replace(state, fingers=world.fingers, robot=robot), []


def know_sensor(params: Params, state: State, info: types.SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return replace(state, pad=pad_of_info(info)), []


def take_goal(
    params: Params, state: State, goal: types.ContourGoal | types.ProbeGoal
) -> tuple[State, Outputs]:
    """Begin a goal of this finger, or queue it after the current one."""
    if not 1 <= goal.finger <= state.fingers:
        raise ValueError(
            f"goal {goal.id} is for finger {goal.finger}; the fingers are 1 to {state.fingers}"
        )
    if goal.finger != params.finger:
        return state, []
    if state.job is not None:
        return replace(state, waiting=(*state.waiting, goal)), []
    return _begin(params, state, goal, 0.0)


def take_patch(params: Params, state: State, patch: types.SurfacePatch) -> tuple[State, Outputs]:
    """Continue the current goal; of several fingers, publish the robot time."""
    state, outputs = _after_touch(params, state, patch)
    if state.fingers > 1:
        clock = types.FingerClock(finger=params.finger, robot_time=patch.robot_time)
        outputs = [*outputs, ("/finger/clock", clock)]
    return state, outputs


def _after_touch(params: Params, state: State, patch: types.SurfacePatch) -> tuple[State, Outputs]:
    """Use the result of the last touch."""
    job = state.job
    if job is None or (patch.goal, patch.touch) != (job.goal.id, job.touches - 1):
        raise ValueError(
            f"unexpected touch {patch.touch} of goal {patch.goal}: no such touch was requested"
        )
    assert state.pad is not None
    if isinstance(job.goal, types.ProbeGoal):
        probe = _probe(state.pad, job.goal, patch)
        return _finish(params, state, ("/probe/traced", probe), patch.robot_time)
    return _continue_contour(params, state, job, job.goal, patch)


def _probe(pad: Pad, goal: types.ProbeGoal, patch: types.SurfacePatch) -> types.Probe:
    """The result of a single touch; an invalid frame is a miss."""
    pose, is_invalid = Pose.from_array(patch.pose), patch.kind == "invalid"
    return types.Probe(
        id=goal.id,
        finger=patch.finger,
        placement=patch.placement,
        outcome="miss" if is_invalid else patch.outcome,
        point=_deepest(pad, pose, patch),
        normal=-pose.axes[:, 2] if is_invalid else patch.normal,
        touches=1,
        fault=patch.fault if is_invalid else "none",
        robot_time=patch.robot_time,
    )


def _continue_contour(
    params: Params,
    state: State,
    job: Job,
    goal: types.ContourGoal,
    patch: types.SurfacePatch,
    back_off_ratio: float = 14.0 / 15.0,
) -> tuple[State, Outputs]:
    """Request the next touch of a contour, or report the contour.

    A touch that started inside the object is repeated from farther away, by `back_off_ratio` times
    the width of the pad.
    """
    assert job.trace is not None and job.aim is not None and state.pad is not None
    assert job.frame is not None
    back_off = back_off_ratio * tracing.SliceSpec(state.pad, goal.height).width
    if patch.outcome == "inside" and job.aim.standoff < back_off:
        farther = job.aim._replace(standoff=job.aim.standoff + back_off)
        return _send(params, state, replace(job, aim=farther), goal, patch.robot_time)
    faults = job.faults + 1 if patch.kind == "invalid" else 0
    if faults >= params.most_faults:
        contour = _contour(job, goal, job.trace, "stuck", patch.robot_time)
        broken = replace(contour, fault=patch.fault)
        return _finish(params, state, ("/contour/traced", broken), patch.robot_time)
    arc = _slice_arc(state.pad, job.frame, goal.height, patch)
    after = replace(job, faults=faults)
    return _trace(params, state, after, tracing.after_touch(job.trace, arc), patch.robot_time)


def _begin(
    params: Params, state: State, goal: types.ContourGoal | types.ProbeGoal, now: float
) -> tuple[State, Outputs]:
    if isinstance(goal, types.ProbeGoal):
        pose = Pose.from_array(goal.pose)
        touch = types.TouchGoal(
            goal=goal.id,
            touch=0,
            finger=goal.finger,
            placement=goal.placement,
            pose=goal.pose,
            reach=goal.reach,
            depth=tracing.TOUCH_DEPTH,
            direction=pose.axes[:, 1],
            not_before=max(now, goal.not_before),
        )
        if not _in_time(state, touch, pose, goal):
            probe = types.Probe(
                id=goal.id,
                finger=goal.finger,
                placement=goal.placement,
                outcome="miss",
                point=goal.pose[:3],
                normal=-pose.axes[:, 2],
                touches=0,
                robot_time=now,
            )
            return _finish(params, state, ("/probe/traced", probe), now)
        state = replace(state, job=Job(goal, touches=1), resting=pose)
        return state, [("/finger/goal", touch)]
    max_touches = params.most_touches
    if goal.most_touches is not None:
        max_touches = min(max_touches, goal.most_touches)
    job = Job(goal, frame=Pose.from_array(goal.frame))
    target = tracing.TraceGoal(goal.height, goal.centre, goal.radius, max_touches, goal.gap)
    return _trace(params, state, job, tracing.Trace(target), max(now, goal.not_before))


def _trace(
    params: Params, state: State, job: Job, trace: tracing.Trace, now: float
) -> tuple[State, Outputs]:
    """Request the next touch of a contour, or report the contour."""
    assert isinstance(job.goal, types.ContourGoal) and state.pad is not None
    trace, command = tracing.next_command(state.pad, trace)
    if isinstance(command, tracing.TouchCommand):
        return _send(params, state, replace(job, trace=trace, aim=command), job.goal, now)
    contour = _contour(job, job.goal, trace, command, now)
    return _finish(params, state, ("/contour/traced", contour), now)


def _send(
    params: Params, state: State, job: Job, goal: types.ContourGoal, now: float
) -> tuple[State, Outputs]:
    """Request a touch, or report the incomplete contour if the touch may exceed the budget."""
    assert job.aim is not None and job.trace is not None and job.frame is not None
    pose = job.frame @ job.aim.start(goal.height)
    touch = types.TouchGoal(
        goal=goal.id,
        touch=job.touches,
        finger=goal.finger,
        pose=pose.array,
        reach=job.aim.travel,
        depth=job.aim.posture.depth,
        direction=job.frame.axes[:, 2],
        not_before=now,
    )
    is_spent = goal.most_touches is not None and job.touches >= goal.most_touches
    if is_spent or not _in_time(state, touch, pose, goal):
        contour = _contour(job, goal, job.trace, "budget", now)
        return _finish(params, state, ("/contour/traced", contour), now)
    job = replace(job, touches=job.touches + 1)
    return replace(state, job=job, resting=pose), [("/finger/goal", touch)]


def _in_time(
    state: State,
    touch: types.TouchGoal,
    pose: Pose,
    goal: types.ContourGoal | types.ProbeGoal,
) -> bool:
    """Whether a touch ends before the deadline of its goal, even without contact."""
    if goal.not_after is None:
        return True
    if state.robot is None:
        return touch.not_before < goal.not_after
    duration = longest_seconds(state.robot, *move_between(state.resting, pose), touch.reach)
    return touch.not_before + duration < goal.not_after


def _finish(
    params: Params, state: State, published: tuple[str, object], now: float
) -> tuple[State, Outputs]:
    """Report a goal, and begin the next one."""
    state = replace(state, job=None)
    if not state.waiting:
        return state, [published]
    following, *rest = state.waiting
    state, outputs = _begin(params, replace(state, waiting=tuple(rest)), following, now)
    return state, [published, *outputs]


def _slice_arc(
    pad: Pad, frame: Pose, height: float, patch: types.SurfacePatch
) -> tracing.SliceArc | None:
    if patch.outcome not in HITS or patch.kind == "invalid":
        return None
    pose = frame.inverse() @ Pose.from_array(patch.pose)
    jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
    smooth = patch.kind == "smooth"
    return tracing.arc_in_slice(pad, pose, patch.height, patch.mask, jet, height, smooth)


def _contour(
    job: Job, goal: types.ContourGoal, trace: tracing.Trace, status: tracing.TraceStatus, now: float
) -> types.Contour:
    empty, path, frame = np.zeros((0, 3)), trace.path, job.frame
    assert frame is not None
    return types.Contour(
        id=goal.id,
        finger=goal.finger,
        frame=goal.frame,
        height=goal.height,
        points=empty if path is None else frame.to_outer(path.points),
        normals=empty if path is None else path.normals @ frame.axes.T,
        curvature=np.zeros(0) if path is None else path.curvatures,
        contact_low=np.zeros(0) if path is None else path.low,
        contact_high=np.zeros(0) if path is None else path.high,
        status=status,
        gap_starts=_placed(frame, [gap.start for gap in trace.gaps]),
        gap_ends=_placed(frame, [gap.end for gap in trace.gaps]),
        gap_reasons=tuple(gap.reason for gap in trace.gaps),
        touches=job.touches,
        robot_time=now,
    )


def _placed(frame: Pose, points: Sequence[Floats]) -> Floats:
    """Points (n, 3) of the slicing frame in the world [m]."""
    return frame.to_outer(np.reshape(points, (-1, 3)))


def _deepest(pad: Pad, pose: Pose, patch: types.SurfacePatch) -> Floats:
    """The point of deepest compression in the world; without contact the middle of the pad."""
    if not patch.mask.any():
        return pose.position
    local = tracing.deepest_point(pad, patch.height, patch.mask)
    return np.asarray(pose.to_outer(local[None])[0])


NODE = Node(
    params=Params,
    step="tracing",
    start=lambda params: (State(), []),
    inputs={
        "/world": (types.World, know_world),
        "/touch/info": (types.SensorInfo, know_sensor),
        "/contour/goal": (types.ContourGoal, take_goal),
        "/probe/goal": (types.ProbeGoal, take_goal),
        "/touch/patch": (types.SurfacePatch, take_patch),
    },
    outputs={
        "/finger/goal": types.TouchGoal,
        "/finger/clock": types.FingerClock,
        "/contour/traced": types.Contour,
        "/probe/traced": types.Probe,
    },
    needs=("/world", "/touch/info"),
)
