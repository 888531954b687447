"""The state of an exploration, as a value, and how each result changes it.

An `Exploration` holds the constants (`Setup`), contacts of the hand (`HandContacts`), contours and
ends in the slicing frame (`Survey`), the task of each `Finger`, and figures of the last model
(`ModelStatus`). No decision is made here: `decision.goals` derives the next goals from it.
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
    DEFAULT_SURVEY,
    Demand,
    ModelUncertainty,
    Survey,
    SurveySettings,
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

    enough_contacts: int = 60  # contacts after which the hand stops
    turned_contacts: int = 48  # the same after the object, whose shape is known, was turned over
    lost_contacts: int = 96  # the same once its contacts since the turn have fitted no pose
    max_grips: int = 30  # closings since the first contact
    search_spacing: float = 12e-3  # [m] between places of the search; less than a pad's width
    opening: float = 0.8  # [reach of a pad] from the hand's middle to its open fingertips
    fit_contacts: int = 12  # enough for a fit; from then on `time_share` limits the hand
    fit_closings: int = 2  # fewest closings that may give enough for a fit
    time_share: float = 0.5  # fraction of the robot time in which the hand may close from then on

    def least_seconds(self, robot: RobotPreset, reach: float) -> float:
        """Robot time [s] of the fewest closings that may be enough; `reach` of a pad [m]."""
        return self.fit_closings * longest_seconds(robot, 0.0, 0.0, self.opening * reach)


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalSettings:
    """When tasks and models are due, and the limits of a task."""

    # A contour is given up after `min_contour_touches`, plus the touches that it takes to go
    # `contour_turns` times along the longest perimeter so far by `touch_advance` [pad widths] each.
    min_contour_touches: int = 20
    contour_turns: float = 1.6
    touch_advance: float = 0.5
    # Longest stretch [pad widths] between touches of a contour: over a longer one the pad misses
    # the contour. It shrinks with the feature, and is 0 for features below `dense_feature` [pad
    # widths]: only touches that overlap show the errors of their poses, which finer work needs.
    max_gap: float = 0.3
    dense_feature: float = 0.7
    first_contour_touches: int = 30  # expected of a contour before one was traced
    max_contour_share: float = 2.0  # touches of one of several fingers, per expected one
    touch_ends: bool = True  # single touches look for the ends; if not, slices and grasp find them
    # [extent of the object] between contour and end, below which the end is touched all over.
    end_nearness: float = 0.07
    # A model is due after `single_batch` single touches, or `single_share` of all touches if that
    # is more; after contours, once at least `contour_share` of all touches came since the last one.
    # With such shares the work of a run grows in proportion to its touches.
    single_batch: int = 10
    single_share: float = 0.12
    contour_share: float = 0.05
    # An object whose contacts extend over less than `small_extent` [m] gets `small_touches`, unless
    # the demand states a number: further touches hardly add anything.
    small_extent: float = 0.15
    small_touches: int = 800
    max_goals: int = 4000  # a message lists no more than `messages.fields.MAX_ITEMS` results


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultSettings:
    """When a single touch is repeated, and when a sensor is given up."""

    retreat: float = 15e-3  # [m] by which a touch that began inside is repeated from farther off
    max_retries: int = 2  # of such a touch
    max_target_distance: float = 6e-3  # [m] from its target, beyond which a contact is in vain
    max_faults: int = 3  # faulty readings in succession, after which the sensor is given up


class Setup(NamedTuple):
    """What does not change during an exploration."""

    platform: float  # [m] height on which the object stands
    reach: float  # [m] of a pad from the middle of the platform
    robot: RobotPreset | None  # speeds of the arms; None if they are not known
    pad_width: float  # [m]
    resolution: float  # [m] smallest difference that the sensor resolves
    contact_error: float  # [m] standard deviation of a contact of the hand
    grasp: GraspSettings = GraspSettings()
    goals: GoalSettings = GoalSettings()
    results: ResultSettings = ResultSettings()
    survey: SurveySettings = DEFAULT_SURVEY
    slicing: planners.SliceSettings = planners.SliceSettings()
    surface: planners.SurfaceSettings = planners.DEFAULT_SURFACE
    turning: planners.TurningSettings = planners.TurningSettings()

    @property
    def finger_spacing(self) -> float:
        """Height that two fingers keep between them [m]."""
        return self.survey.finger_spacing * self.pad_width


UNTURNED = Pose.from_array(IDENTITY_POSE)


class ProbedPoint(NamedTuple):
    """What one touch measured."""

    outcome: TouchOutcome
    point: Floats  # deepest point touched, world frame, (3,) [m]
    normal: Floats  # outward normal there, world frame, (3,)


class Result(NamedTuple):
    """What a finger has finished."""

    robot_time: float  # [s] at the end of its last touch
    touches: int  # made; 0 if the rest of the budget was too small for one
    fault: FrameFault  # of the sensor, if it ended the task
    measured: TracedContour | ProbedPoint


class Finger(NamedTuple):
    """The state of one finger."""

    clock: float = 0.0  # [s] robot time that it is known to have reached
    task: Task | None = None  # None while the finger is idle
    result: Result | None = None  # of that task, not yet taken up
    resting: Floats | None = None  # (3,) [m] where its last single touch began


@dataclass(frozen=True, slots=True, eq=False)
class HandContacts:
    """What the hand met."""

    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) [m]
    normals: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) outward
    closings: int = 0  # in all
    earlier: int = 0  # closings before it was last turned over; `points` are of later ones
    grips: int = 0  # closings from the first contact on
    last: CloseHand | None = None  # the last closing
    fit: FittedSuperquadric | None = None  # coarse model of all contacts


class Lying(NamedTuple):
    """How the object lies."""

    placement: int = 0  # how often it has been turned over
    # Motion from the first pose, world frame; None: not known yet since it was turned over.
    pose: Pose | None = UNTURNED
    is_turning: bool = False  # whether the hand is still turning it over
    fault: str = ""  # why the hand's contacts did not give the pose; empty if they did
    contacts: int = 0  # of the hand when the pose was last looked for


class SingleResult(NamedTuple):
    """A single touch that was made."""

    number: int
    target: Floats  # (3,) [m] as the object lay at first
    outcome: TouchOutcome
    in_vain: bool  # whether it touched nothing near its target


class ModelStatus(NamedTuple):
    """The last model that was requested, and the last finished one."""

    number: int = 0  # of the last requested model
    is_pending: bool = False  # whether it is not finished yet
    slices: int = 0  # traced when it was requested
    end_touches: int = 0  # touches of ends that had hit when it was requested
    touches: int = 0  # made when it was requested
    singles: int = 0  # single touches that the last finished model contains
    surface: planners.ObservedSurface | None = None  # of the last finished model
    general: bool = False  # whether the last finished model is a general solid


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Exploration:
    """All that the next goals depend on, besides the demand and the planner."""

    setup: Setup
    fingers: Mapping[int, Finger]  # by their numbers from 1
    hand: HandContacts = field(default_factory=HandContacts)
    survey: Survey | None = None  # None until the slicing frame is known
    probes: tuple[int, ...] = ()  # numbers of touches of ends and single touches that hit
    singles: tuple[SingleResult, ...] = ()
    retry: SingleTouch | None = None  # single touch to repeat from farther off
    model: ModelStatus = field(default_factory=ModelStatus)
    lying: Lying = field(default_factory=Lying)
    goals: int = 0  # requested contours and touches
    touches: int = 0  # made so far
    seconds: float = 0.0  # [s] robot time that has passed
    is_cut: bool = False  # whether the rest of the budget is too small for a touch
    faults: int = 0  # results in succession that ended with a fault of the sensor
    broken: str = ""  # why a sensor was given up; empty if none was

    @property
    def surveyed(self) -> Survey:
        """The survey, once there is one."""
        assert self.survey is not None
        return self.survey

    @property
    def tasks(self) -> tuple[Task, ...]:
        """Tasks of the fingers that are not idle."""
        return tuple(finger.task for finger in self.fingers.values() if finger.task is not None)

    @property
    def end_touches(self) -> int:
        """Number of touches of ends that hit."""
        return len(self.probes) - sum(single.outcome in HITS for single in self.singles)

    @property
    def targets(self) -> tuple[Floats, ...]:
        """Targets of single touches since the last model, (3,) each [m]."""
        return tuple(self._in_world(self.singles[self.model.singles :]))

    @property
    def refused(self) -> Floats:
        """Targets of single touches that met nothing near them, (n, 3) [m]."""
        return self._in_world([single for single in self.singles if single.in_vain])

    @property
    def aimed(self) -> Floats:
        """Targets of all single touches, (n, 3) [m]."""
        return self._in_world(self.singles)

    def _in_world(self, singles: Sequence[SingleResult]) -> Floats:
        """Where the targets of single touches lie now, (n, 3) [m]."""
        targets = np.reshape([single.target for single in singles], (-1, 3))
        pose = self.lying.pose
        return targets if self.lying.placement == 0 or pose is None else pose.to_outer(targets)

    @property
    def next_finger(self) -> int | None:
        """The finger whose result is taken up next; None if one must be waited for."""
        if self.model.is_pending:
            return None
        results = {number: finger.result for number, finger in self.fingers.items()}
        times = {number: made.robot_time for number, made in results.items() if made is not None}
        clocks = {number: finger.clock for number, finger in self.fingers.items()}
        return next_finished(times, [task.finger for task in self.tasks], clocks)

    def observation(self, demand: Demand, finger: int = 1) -> planners.Observation:
        """What the planner receives when a finger is idle."""
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
            slicing=setup.slicing,
        )

    def usual_touches(self, demand: Demand) -> float:
        """Default limit of touches: `small_touches` for a small object; no limit otherwise."""
        settings, points = self.setup.goals, self.hand.points
        if math.isfinite(demand.most_touches) or not len(points):
            return math.inf
        small = float(np.ptp(points, axis=0).max()) < settings.small_extent
        return settings.small_touches if small else math.inf

    def with_finger(self, number: int, finger: Finger) -> Exploration:
        """The exploration with another state of one finger."""
        return replace(self, fingers={**self.fingers, number: finger})

    def after(self, goal: Goal) -> Exploration:
        """The exploration after a goal was sent."""
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
    """Add the contacts (n, 3) of one closing of the hand; `seconds`: robot time after it [s]."""
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
    """After the object was set down on another side; `seconds`: robot time after it [s]."""
    lying = known.lying._replace(is_turning=False)
    return replace(known, lying=lying, seconds=seconds)


def with_coarse(known: Exploration, fit: FittedSuperquadric, axis: Floats | None) -> Exploration:
    """Add the coarse model and its slicing frame; `axis` (3,): given by the user, or None."""
    hand, model = replace(known.hand, fit=fit), known.model._replace(is_pending=False)
    return _with_axis(replace(known, hand=hand, model=model), axis)


def _with_axis(known: Exploration, axis: Floats | None) -> Exploration:
    """Begin a new survey along a given `axis` (3,), or along one that contacts suggest."""
    hand, setup = known.hand, known.setup
    assert hand.fit is not None
    frame = grasp.fit_object_frame(
        hand.fit, hand.points, hand.normals, setup.platform, setup.contact_error, axis
    )
    # An upright frame has the world's heights, and the object stands on its lower end.
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
        settings=setup.survey,
    )
    return replace(known, survey=survey)


def with_model(
    known: Exploration,
    dropped: frozenset[int],  # numbers of contours that the model left out
    uncertainty: ModelUncertainty,
    surface: planners.ObservedSurface | None,
    *,
    general: bool,  # whether the model is a general solid
    lying: Lying | None = None,  # how the object lies by the model; None: as before
) -> Exploration:
    """Add a finished model's surface and errors, and which contours it left out."""
    if lying is not None:
        known = replace(known, lying=lying._replace(contacts=len(known.hand.points)))
    survey = known.surveyed.with_dropped(dropped)
    model = known.model._replace(
        is_pending=False, singles=len(known.singles), surface=surface, general=general
    )
    return replace(known, survey=replace(survey, uncertainty=uncertainty), model=model)


def with_result(known: Exploration, finger: int, feature: float) -> Exploration:
    """Take up a finger's result; `feature`: largest height that may stay untouched [m]."""
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
        contour = widened(result.measured, feature, known.setup.survey)
        return replace(known, survey=known.surveyed.with_slice(contour))
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
    """A better slicing axis (3,), if the upper end's normal `face` (3,), world frame, gives one.

    None once there is a contour, or if an axis was given: by the user, or by an earlier touch.
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
