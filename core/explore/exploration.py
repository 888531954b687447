"""What is known while an object is explored, as values, and what each result adds to it.

An `Exploration` holds what never changes (`Setup`), what the hand met (`HandContacts`), contours
and ends in the slicing frame (`Survey`), what each `Finger` does, and what the last model said
(`ModelStatus`). Nothing is decided here: `decision.goals` says what follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import grasp, planners, probing
from palpate.core.explore.survey import (
    SURVEYING,
    Demand,
    ModelUncertainty,
    Survey,
    TracedContour,
    next_finished,
    widened,
)
from palpate.core.explore.tasks import (
    CloseHand,
    Done,
    Goal,
    MakeModel,
    SingleTouch,
    Task,
    TouchEnd,
    TurnObject,
)
from palpate.core.poses import IDENTITY_POSE, Pose
from palpate.core.robot_time import RobotPreset, longest_seconds
from palpate.core.shapes import FittedSuperquadric
from palpate.core.touch import FAULTS, HITS, FrameFault, TouchOutcome


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspSettings:
    """How often the hand closes, and where it looks for the object."""

    enough_contacts: int = 60  # the hand has touched enough
    # The same of an object that was turned over, whose shape is known; and if these fit nowhere.
    turned_contacts: int = 48
    lost_contacts: int = 96
    max_grips: int = 30  # closings on the object
    search_spacing: float = 12e-3  # of places where the object is looked for [m]; below a pad
    opening: float = 0.8  # of the fingers, fraction of the reach
    fit_contacts: int = 12  # enough for a fit; from there on the hand has less time
    fit_closings: int = 2  # enough for a fit, at least
    time_share: float = 0.5  # of the robot time that may pass, once there is enough for a fit

    def least_seconds(self, robot: RobotPreset, reach: float) -> float:
        """Robot time of the fewest closings that may tell enough, by a pad's reach [m]; [s]."""
        return self.fit_closings * longest_seconds(robot, 0.0, 0.0, self.opening * reach)


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalSettings:
    """When tasks and models are due, and what a task may take."""

    # A contour is given up after `min_contour_touches` and as many as take it `contour_turns` times
    # around the expected perimeter, each `touch_advance` farther [pad widths].
    min_contour_touches: int = 20
    contour_turns: float = 1.6
    touch_advance: float = 0.5
    # Between two touches of a contour up to `max_gap` [pad widths] may stay untouched: with more
    # the pad misses the contour. Nothing may where a feature is below `dense_feature` [pad widths]:
    # touches that overlap tell how far their poses are off, which finer work needs.
    max_gap: float = 0.3
    dense_feature: float = 0.7
    first_contour_touches: int = 30  # expected of a contour while none was traced
    max_contour_share: float = 2.0  # of its expected touches, for one of several fingers
    touch_ends: bool = True  # single touches look for the ends; else slices and grasp alone do
    # An end is touched all over once a contour is so near to it, fraction of the object's extent.
    end_nearness: float = 0.07
    # A model is due after `single_batch` single touches, or `single_share` of all touches if that
    # is more; after contours, when they have at least `contour_share` of all touches. So the work
    # of long runs, too, grows with the first power of their touches.
    single_batch: int = 10
    single_share: float = 0.12
    contour_share: float = 0.05
    # An object of less than `small_extent` [m] is given up after `small_touches` unless more, or
    # fewer, are asked for: what they have not told the next ones will not either.
    small_extent: float = 0.15
    small_touches: int = 800
    max_goals: int = 4000  # a message lists no more than `messages.fields.MAX_ITEMS` results


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultSettings:
    """When a single touch is begun anew, and when a sensor is given up."""

    retreat: float = 15e-3  # a touch that began inside begins anew from so much farther off [m]
    max_retries: int = 2
    max_target_distance: float = 6e-3  # [m]; a contact farther from its target was in vain
    max_faults: int = 3  # touches in succession that no working sensor can have felt


class Setup(NamedTuple):
    """What does not change during an exploration."""

    platform: float  # height on which the object stands [m]
    reach: float  # how far from the middle of the platform a pad gets [m]
    robot: RobotPreset | None  # how fast the arms are; None if that is not known
    pad_width: float  # [m]
    resolution: float  # smallest difference that the sensor tells [m]
    contact_error: float  # standard deviation of a contact of the hand [m]
    grasp: GraspSettings = GraspSettings()
    goals: GoalSettings = GoalSettings()
    results: ResultSettings = ResultSettings()

    @property
    def finger_spacing(self) -> float:
        """Height that two fingers keep between them [m]."""
        return SURVEYING.finger_spacing * self.pad_width


UNTURNED = Pose.from_array(IDENTITY_POSE)


class ProbedPoint(NamedTuple):
    """What one touch measured."""

    outcome: TouchOutcome
    point: Floats  # deepest point touched, world frame, (3,) [m]
    normal: Floats  # outward normal there, world frame, (3,)


class Result(NamedTuple):
    """What a finger has finished."""

    robot_time: float  # of its last touch [s]
    touches: int  # 0: what is left of the budget is too little for one
    fault: FrameFault  # of the sensor, if it ended the work
    measured: TracedContour | ProbedPoint


class Finger(NamedTuple):
    """What one finger does."""

    clock: float = 0.0  # robot time that it is known to have reached [s]
    task: Task | None = None
    result: Result | None = None  # of that task, not yet taken up
    resting: Floats | None = None  # where its last single touch began, (3,) [m]


@dataclass(frozen=True, slots=True, eq=False)
class HandContacts:
    """What the hand met."""

    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) [m]
    normals: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # outward, (n, 3)
    closings: int = 0  # times that it has closed
    earlier: int = 0  # of these, before the object was turned over last: contacts are those since
    grips: int = 0  # of these, since it first met something
    last: CloseHand | None = None  # how it was closed last
    fit: FittedSuperquadric | None = None  # the coarse model of all contacts


class Lying(NamedTuple):
    """How the object lies."""

    placement: int = 0  # how often it has been turned over
    # In the world, from how it lay at first; None: since it was turned over nobody knows yet.
    pose: Pose | None = UNTURNED
    is_turning: bool = False  # whether the hand is still at it
    fault: str = ""  # why the contacts of the hand have not told
    contacts: int = 0  # that the hand had made by then


class SingleResult(NamedTuple):
    """A single touch that was made."""

    number: int
    target: Floats  # as the object lay at first, (3,) [m]
    outcome: TouchOutcome
    in_vain: bool  # whether it touched nothing near to its target


class ModelStatus(NamedTuple):
    """What was asked for, and what the last model said."""

    number: int = 0  # of the last that was asked for
    is_pending: bool = False  # whether that is still in the making
    slices: int = 0  # slices that were traced when it was asked for
    end_touches: int = 0  # touches of ends that had hit by then
    touches: int = 0  # touches that were made by then
    singles: int = 0  # single touches that the last finished model knows
    surface: planners.ObservedSurface | None = None  # of the last finished model
    general: bool = False  # whether that is a general solid


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Exploration:
    """All that the next goals depend on, beside the demand and the rule."""

    setup: Setup
    fingers: Mapping[int, Finger]  # by their numbers from 1
    hand: HandContacts = field(default_factory=HandContacts)
    survey: Survey | None = None  # None until the slicing frame is known
    probes: tuple[int, ...] = ()  # numbers of touches of ends and single touches that hit
    singles: tuple[SingleResult, ...] = ()
    retry: SingleTouch | None = None  # single touch that is to be begun anew from farther off
    model: ModelStatus = field(default_factory=ModelStatus)
    lying: Lying = field(default_factory=Lying)
    goals: int = 0  # contours and touches that were asked for
    touches: int = 0  # touches made
    seconds: float = 0.0  # robot time that has passed [s]
    is_cut: bool = False  # whether what is left of the budget is too little for a touch
    faults: int = 0  # results in succession that a fault of the sensor ended
    broken: str = ""  # why a sensor is not used any more

    @property
    def surveyed(self) -> Survey:
        """The survey, once there is one."""
        assert self.survey is not None
        return self.survey

    @property
    def tasks(self) -> tuple[Task, ...]:
        """What fingers are at."""
        return tuple(one.task for one in self.fingers.values() if one.task is not None)

    @property
    def end_touches(self) -> int:
        """Touches of ends that hit."""
        return len(self.probes) - sum(one.outcome in HITS for one in self.singles)

    @property
    def targets(self) -> tuple[Floats, ...]:
        """What single touches were aimed at since the last model, (3,) each [m]."""
        return tuple(self._in_world(self.singles[self.model.singles :]))

    @property
    def refused(self) -> Floats:
        """What single touches were aimed at in vain, (n, 3) [m]."""
        return self._in_world([one for one in self.singles if one.in_vain])

    @property
    def aimed(self) -> Floats:
        """What single touches were aimed at, (n, 3) [m]."""
        return self._in_world(self.singles)

    def _in_world(self, singles: Sequence[SingleResult]) -> Floats:
        """Where the targets of single touches lie now, (n, 3) [m]."""
        targets = np.reshape([one.target for one in singles], (-1, 3))
        pose = self.lying.pose
        return targets if self.lying.placement == 0 or pose is None else pose.to_outer(targets)

    @property
    def next_finger(self) -> int | None:
        """The finger whose result is taken up next; None if one must be waited for."""
        if self.model.is_pending:
            return None
        results = {finger: one.result for finger, one in self.fingers.items()}
        times = {finger: one.robot_time for finger, one in results.items() if one is not None}
        clocks = {finger: one.clock for finger, one in self.fingers.items()}
        return next_finished(times, [task.finger for task in self.tasks], clocks)

    def observation(self, demand: Demand, finger: int = 1) -> planners.Observation:
        """What a rule is told when a finger is idle."""
        survey, setup = self.surveyed, self.setup
        return planners.Observation(
            low=survey.low,
            high=survey.high,
            low_deviation=survey.low_deviation,
            high_deviation=survey.high_deviation,
            tolerance=demand.tolerance,
            resolution=setup.resolution,
            underside_share=demand.limits.underside_share,
            feature=max(demand.feature, planners.MIN_FEATURE * (survey.high - survey.low)),
            budget=planners.Budget(
                most_touches=min(demand.most_touches, self.usual_touches(demand)),
                most_seconds=demand.most_seconds,
                touches=self.touches,
                seconds=self.seconds,
                cut=self.is_cut,
            ),
            slices=survey.slices,
            busy_heights=tuple(task.height for task in self.tasks),
            finger_spacing=setup.finger_spacing,
            all_taxels=True,
            deviation=survey.uncertainty.whole,
            ends_deviation=survey.uncertainty.ends,
            pose_deviation=survey.uncertainty.pose,
            bounded=survey.uncertainty.bounded,
            surface=self.model.surface,
            general=self.model.general,
            tried=np.reshape(self.targets, (-1, 3)),
            resting=self.fingers[finger].resting,
        )

    def usual_touches(self, demand: Demand) -> float:
        """The most touches where nobody asked for a number: of a small object, and else as many."""
        settings, points = self.setup.goals, self.hand.points
        if math.isfinite(demand.most_touches) or not len(points):
            return math.inf
        small = float(np.ptp(points, axis=0).max()) < settings.small_extent
        return settings.small_touches if small else math.inf

    def with_finger(self, number: int, finger: Finger) -> Exploration:
        """With a finger that does something else."""
        return replace(self, fingers={**self.fingers, number: finger})

    def after(self, goal: Goal) -> Exploration:
        """With a goal that was given out."""
        match goal:
            case CloseHand():
                return replace(self, hand=replace(self.hand, last=goal))
            case TurnObject():
                closings, fit = self.hand.closings, self.hand.fit
                return replace(
                    self,
                    hand=HandContacts(closings=closings, earlier=closings, fit=fit),
                    lying=Lying(self.lying.placement + 1, None, is_turning=True),
                    model=self.model._replace(general=True),
                )
            case Task():
                finger = self.fingers[goal.finger]._replace(task=goal)
                retry = None if isinstance(goal.work, SingleTouch) else self.retry
                after = self.with_finger(goal.finger, finger)
                return replace(after, goals=self.goals + 1, retry=retry)
            case MakeModel() | Done():
                model = self.model._replace(
                    number=self.model.number + 1,
                    is_pending=True,
                    slices=0 if self.survey is None else len(self.survey.traced),
                    end_touches=self.end_touches,
                    touches=self.touches,
                )
                return replace(self, model=model)


def with_contacts(
    known: Exploration, points: Floats, normals: Floats, seconds: float
) -> Exploration:
    """With what one closing of the hand met (n, 3), and the robot time after it [s]."""
    before = known.hand
    hand = replace(
        before,
        points=np.concatenate([before.points, points]),
        normals=np.concatenate([before.normals, normals]),
        closings=before.closings + 1,
        grips=before.grips + bool(len(before.points) or len(points)),
    )
    return replace(known, hand=hand, seconds=seconds)


def with_turned(known: Exploration, seconds: float) -> Exploration:
    """With the object set down on another side, and the robot time after it [s]."""
    lying = known.lying._replace(is_turning=False)
    return replace(known, lying=lying, seconds=seconds)


def with_coarse(known: Exploration, fit: FittedSuperquadric, axis: Floats | None) -> Exploration:
    """With the slicing frame that the coarse model lets choose, or with a given axis (3,)."""
    hand, model = replace(known.hand, fit=fit), known.model._replace(is_pending=False)
    return _with_axis(replace(known, hand=hand, model=model), axis)


def _with_axis(known: Exploration, axis: Floats | None) -> Exploration:
    """At the beginning of the slices, along a given axis or along one that is probed."""
    hand, setup = known.hand, known.setup
    assert hand.fit is not None
    frame = grasp.fit_object_frame(
        hand.fit, hand.points, hand.normals, setup.platform, setup.contact_error, axis
    )
    # Where heights are the world's, the object stands on its lower end.
    upright = float(frame.pose.axes[2, 2]) == 1.0
    heights = frame.pose.to_local(hand.points)[:, 2]
    survey = Survey(
        frame=frame,
        low=setup.platform if upright else frame.low,
        high=frame.high,
        low_deviation=0.0 if upright else frame.extent_error,
        high_deviation=frame.extent_error,
        standing=upright,
        # never beyond the expected ends
        reached=(max(float(heights.min()), frame.low), min(float(heights.max()), frame.high)),
    )
    return replace(known, survey=survey)


def with_model(
    known: Exploration,
    dropped: frozenset[int],  # numbers of contours that it had no use for
    uncertainty: ModelUncertainty,
    surface: planners.ObservedSurface | None,
    *,
    general: bool,  # whether it is a general solid
    lying: Lying | None = None,  # how the object lies, as far as the model tells; None: as before
) -> Exploration:
    """With what a model says of itself."""
    if lying is not None:
        known = replace(known, lying=lying._replace(contacts=len(known.hand.points)))
    survey = known.surveyed.with_dropped(dropped)
    model = known.model._replace(
        is_pending=False, singles=len(known.singles), surface=surface, general=general
    )
    return replace(known, survey=replace(survey, uncertainty=uncertainty), model=model)


def with_result(known: Exploration, finger: int, feature: float) -> Exploration:
    """With a finger's result taken up; `feature` is the largest untouched height asked for [m]."""
    busy = known.fingers[finger]
    task, result = busy.task, busy.result
    assert task is not None and result is not None
    faults = 0 if result.fault == "none" else known.faults + 1
    gives_up = (
        isinstance(result.measured, TracedContour) or faults >= known.setup.results.max_faults
    )
    broken = known.broken
    if faults and gives_up and not broken:
        broken = f"the sensor of finger {finger} failed: {FAULTS[result.fault]}"
    known = replace(
        known.with_finger(finger, Finger(clock=result.robot_time, resting=busy.resting)),
        touches=known.touches + result.touches,
        seconds=max(known.seconds, result.robot_time),
        is_cut=known.is_cut or not result.touches,
        faults=faults,
        broken=broken,
    )
    if not result.touches:
        return known
    if isinstance(result.measured, TracedContour):
        return replace(known, survey=known.surveyed.with_slice(widened(result.measured, feature)))
    if isinstance(task.work, TouchEnd):
        return _with_end_touch(known, task.number, task.work, result.measured)
    return _with_single(known, task, result.measured)


def _with_end_touch(
    known: Exploration, number: int, work: TouchEnd, probed: ProbedPoint
) -> Exploration:
    survey = known.surveyed
    if probed.outcome in HITS:
        known = replace(known, probes=(*known.probes, number))
        axis = _end_axis(known, work.end, probed.normal)
        if axis is not None:
            return _with_axis(known, axis)
    pose = survey.frame.pose
    point, normal = pose.to_local(probed.point), probed.normal @ pose.axes
    touch = probing.ProbeResult(work.command, probed.outcome, point, normal)
    return replace(known, survey=survey.with_end_touch(work.end, touch))


def _end_axis(known: Exploration, end: probing.End, face: Floats) -> Floats | None:
    """A better slicing axis, (3,), if the normal of the upper end, in the world, tells one.

    None while there is a contour, or if an axis was given: by the user, or by an earlier touch.
    """
    survey = known.surveyed
    if end != "upper" or survey.traced or survey.frame.axis == "given":
        return None
    return grasp.end_face_axis(survey.frame.pose.axes[:, 2], face, known.hand.normals)


def _with_single(known: Exploration, task: Task, probed: ProbedPoint) -> Exploration:
    assert isinstance(task.work, SingleTouch)
    settings, touch = known.setup.results, task.work.touch
    finger = known.fingers[task.finger]._replace(resting=touch.pose.position)
    known = known.with_finger(task.finger, finger)
    if probed.outcome == "inside" and task.work.retries < settings.max_retries:
        pose, reach = touch.pose.advanced(-settings.retreat), touch.reach + settings.retreat
        farther = SingleTouch(touch._replace(pose=pose, reach=reach), task.work.retries + 1)
        return replace(known, retry=farther)
    hit = probed.outcome in HITS
    distance = float(np.linalg.norm(probed.point - touch.target))
    in_vain = not hit or distance > settings.max_target_distance
    target = touch.target
    if known.lying.placement and known.lying.pose is not None:
        target = known.lying.pose.to_local(target)
    result = SingleResult(task.number, target, probed.outcome, in_vain)
    probes = (*known.probes, task.number) if hit else known.probes
    return replace(known, singles=(*known.singles, result), probes=probes, retry=None)
