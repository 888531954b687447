"""The planner's phases beside the slices: closings of the hand, and probes of both ends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import Demand, Survey, TracedContour
from palpate.core.explore.grasp import (
    Hand,
    ObjectFrame,
    brought_near,
    end_face_axis,
    fit_object_frame,
    next_pose,
    search_places,
    search_pose,
)
from palpate.core.explore.planners import Height, ObservedSurface, Touch
from palpate.core.explore.probing import (
    End,
    EndObservation,
    ProbeCommand,
    ProbeResult,
    SideContour,
    next_probe,
)
from palpate.core.poses import Pose
from palpate.core.shapes import Bend, FittedSuperquadric
from palpate.core.touch import HITS, Pad
from palpate.messages import derive
from palpate.messages.types import (
    Contour,
    ContourGoal,
    GraspContacts,
    GraspGoal,
    ModelGoal,
    Probe,
    ProbeGoal,
    Superquadric,
    World,
)
from palpate.nodes.planning.budget import OPENING_SHARE, Allowance, fits_closing
from palpate.nodes.specs.sensors import CONTACT_ERROR


class Task(NamedTuple):
    """What a finger is at."""

    goal: int  # Number of the goal
    begun: float  # Robot time of the decision, s
    height: float  # Of the slice, m
    allowed: Allowance  # What it may take
    # The end that is probed, and how; None for a slice.
    probing: tuple[End, ProbeCommand] | None = None
    touch: Touch | None = None  # The single touch that is made; None for a slice or an end
    backed: int = 0  # Times that it was begun anew from farther off
    limit: int = 0  # Touches after which a slice is given up, whatever may be spent


@dataclass(frozen=True, slots=True, eq=False)
class HandContacts:
    """Where the hand has met the object so far."""

    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3), m
    # Outward unit normals, (n, 3).
    normals: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    closings: int = 0  # Times that the hand has closed
    grips: int = 0  # Of these, since it first met something
    fit: FittedSuperquadric | None = None  # The coarse model through all that, once there is one
    resting: Pose | None = None  # Of the hand at the last closing
    advanced: float = 0.0  # How far a finger had been brought in for it, the farthest, m


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What the planner knows."""

    demand: Demand  # What is asked of it, as of the last model
    world: World | None = None  # Where the object stands
    pad_width: float = 0.0  # Of a finger, m
    resolution: float = 0.0  # Smallest difference that the sensor tells, m
    pad: Pad | None = None  # Of a finger
    grasped: HandContacts = field(default_factory=HandContacts)  # By the hand
    frame: ObjectFrame | None = None  # Once the object has been grasped
    survey: Survey | None = None  # What is known since
    # Touches of each end.
    ends: Mapping[End, tuple[ProbeResult, ...]] = field(default_factory=dict)
    # Finger to what it is at.
    tasks: Mapping[int, Task] = field(default_factory=dict)
    # Finger to its result, not yet taken up.
    pending: Mapping[int, Contour | Probe] = field(default_factory=dict)
    # Finger to the robot time that it has reached, s.
    clocks: Mapping[int, float] = field(default_factory=dict)
    # Numbers of all slices, in the order in which they were taken up.
    contours: tuple[int, ...] = ()
    probes: tuple[int, ...] = ()  # Numbers of the probes that hit
    arcs: tuple[int, ...] = ()  # Of the contours that are of no use: their touches count
    failed: bool = False  # Whether one of these could not be traced, the budget aside
    missed: tuple[int, ...] = ()  # Numbers of the single touches that met nothing
    surface: ObservedSurface | None = None  # Of the last model
    general: bool = False  # Whether that is a general solid
    aimed: tuple[Floats, ...] = ()  # What single touches were aimed at since, (3,) each
    refused: tuple[Floats, ...] = ()  # What single touches were aimed at in vain
    singles: int = 0  # Single touches that hit
    again: Task | None = None  # The single touch that is to be begun anew from farther off
    # Finger to where its last single touch began, (3,), m.
    resting: Mapping[int, Floats] = field(default_factory=dict)
    faults: int = 0  # Results in succession that a fault of the sensor ended
    broken: str = ""  # Why the sensor is not to be used any more
    # Whether a goal came back without a touch: what is left of the budget is too little for one.
    cut: bool = False
    # Usable contours, probes and arcs of the last model.
    modelled: tuple[int, int, int] = (0, 0, 0)
    modelled_touches: int = 0  # Touches spent when it was asked for
    goals: int = 0  # Contours and probes asked for
    models: int = 0  # Models asked for
    asked: bool = False  # Whether a model is being waited for
    touches: int = 0  # Touches spent
    clock: float = 0.0  # Robot time spent, s
    closing: GraspGoal | None = None  # What the hand was last asked for

    @property
    def usable(self) -> tuple[int, ...]:
        """Numbers of the contours that a model is fitted to."""
        assert self.survey is not None
        pairs = zip(self.contours, self.survey.traced, strict=True)
        return tuple(number for number, one in pairs if one.tells)

    @property
    def evidence(self) -> tuple[int, int, int]:
        """Usable contours, probes of ends and arcs that there are."""
        return len(self.usable), len(self.probes) - self.singles, len(self.arcs)

    @property
    def is_searching(self) -> bool:
        """Whether a finger still looks for an end, so that nobody knows where slices should be."""
        assert self.survey is not None
        return not self.survey.traced and any(task.probing for task in self.tasks.values())

    @property
    def is_stale(self) -> bool:
        """Whether there is more than the last model knows, and enough for another."""
        if not (self.usable or self.arcs):
            return False
        if self.evidence != self.modelled:
            many = self.touches - self.modelled_touches >= MODEL_SHARE * self.touches
            if many or self.evidence[1] != self.modelled[1]:
                return True
        return len(self.aimed) >= max(BATCH, int(BATCH_SHARE * self.touches))

    @property
    def is_beyond_model(self) -> bool:
        """Whether there is more than the last model knows."""
        return self.evidence != self.modelled or bool(self.aimed)


# Single touches after which there is another model, or this share of all touches, if it is more;
# after contours there is one that have at least this share of all touches: so long runs, too, go
# with the first power of their touches.
BATCH, BATCH_SHARE, MODEL_SHARE = 8, 0.08, 0.05
# Of a contour's touches: at least so many, and so many times as take it once around the expected
# perimeter where each takes this share of the pad's width.
LEAST_LIMIT, AMPLE_TURNS, TOUCH_SHARE = 20, 1.6, 0.5
BACK_OFF, MOST_BACK = 15.0e-3, 2  # A touch that began inside is begun so much farther off, m
ASIDE = 6.0e-3  # A contact so far from where it was aimed at was in vain, m
# What may stay untouched between two touches of a contour, of the pad's width: so much at most, for
# a pad that goes farther misses the contour, and nothing where only features of the other share
# may. Touches that overlap tell how far their poses are off: finer work needs that.
WIDEST_GAP, DENSE = 0.3, 0.7


def contour_goal(
    state: State, finger: int, chosen: Height, feature: float, task: Task
) -> ContourGoal:
    """A slice to trace."""
    assert state.survey is not None and state.frame is not None
    centre, radius = state.survey.approach(chosen.height)
    return derive(
        ContourGoal,
        chosen,
        task.allowed,
        id=state.goals,
        finger=finger,
        frame=state.frame.pose.array,
        centre=centre,
        radius=radius,
        most_touches=min(task.limit, task.allowed.most_touches or task.limit),
        gap=WIDEST_GAP * max(1.0 - DENSE * state.pad_width / feature, 0.0) * state.pad_width,
        not_before=state.clock,
    )


def contour_limit(state: State) -> int:
    """Touches after which a contour is given up: it goes elsewhere than around the object.

    From the longest contour so far, or from the radius that the first contacts let expect.
    """
    assert state.survey is not None
    survey = state.survey
    around = [one.perimeter for one in survey.traced if one.usable]
    longest = max(around, default=2.0 * math.pi * survey.radius)
    return LEAST_LIMIT + math.ceil(AMPLE_TURNS * longest / (TOUCH_SHARE * state.pad_width))


def probe_goal(
    state: State, finger: int, touch: ProbeCommand | Touch, allowed: Allowance
) -> ProbeGoal:
    """A single touch: of an end, in the slicing frame, or of the solid as it is known."""
    pose = touch.pose
    if isinstance(touch, ProbeCommand):
        assert state.frame is not None
        pose = state.frame.pose @ pose
    told = {"id": state.goals, "finger": finger, "pose": pose.array, "not_before": state.clock}
    return derive(ProbeGoal, touch, allowed, **told)


def with_single(state: State, task: Task, probe: Probe) -> State:
    """The state, knowing what a single touch has found."""
    touch = task.touch
    assert touch is not None
    state = replace(state, resting={**state.resting, probe.finger: touch.pose.position}, again=None)
    if probe.outcome == "inside" and task.backed < MOST_BACK:
        pose = touch.pose.advanced(-BACK_OFF)
        farther = touch._replace(pose=pose, reach=touch.reach + BACK_OFF)
        return replace(state, again=task._replace(touch=farther, backed=task.backed + 1))
    state = replace(state, aimed=(*state.aimed, touch.target))
    hit = probe.outcome in HITS
    if not hit or np.linalg.norm(probe.point - touch.target) > ASIDE:
        state = replace(state, refused=(*state.refused, touch.target))
    if probe.outcome == "miss":
        state = replace(state, missed=(*state.missed, probe.id))
    if not hit:
        return state
    return replace(state, probes=(*state.probes, probe.id), singles=state.singles + 1)


def model_goal(state: State) -> ModelGoal:
    """A model of all that there is."""
    contours = () if state.survey is None else state.usable
    told = {"closings": state.grasped.closings, "robot_time": state.clock}
    return derive(ModelGoal, state, number=state.models, contours=contours, **told)


def traced_of(contour: Contour, begun: float) -> TracedContour:
    """A contour as the survey keeps it, slicing frame."""
    frame = Pose.from_array(contour.frame)
    gaps = contour.gap_ends - contour.gap_starts
    return derive(
        TracedContour,
        contour,
        points=frame.to_local(contour.points),
        normals=contour.normals @ frame.axes,
        across=contour.curvature,
        missing=float(np.linalg.norm(gaps, axis=1).sum()),
        seconds=max(contour.robot_time - begun, 0.0),
    )


ENOUGH_CONTACTS = 60  # Contacts after which the hand has touched enough
MAX_GRIPS = 30  # Times that it closes on the object at most
# Distance of the places at which the object is looked for, m: less than a pad.
SEARCH_SPACING = 12.0e-3
ENDS: tuple[End, ...] = ("upper", "lower")
# Of the extent: an end is touched all over as soon as there is a contour so near to it.
END_NEARNESS = 0.07


def grasp_goal(demand: Demand, state: State) -> GraspGoal | None:
    """The next closing of the hand; None once it has touched enough, or looked everywhere.

    Nor is there one where the robot time would not last for it.
    """
    assert state.world is not None
    grasped, world = state.grasped, state.world
    hand = Hand(opening=OPENING_SHARE * world.reach, reach=OPENING_SHARE * world.reach)
    if len(grasped.points) >= ENOUGH_CONTACTS or grasped.grips >= MAX_GRIPS:
        return None
    if len(grasped.points):
        known = grasped.points, grasped.normals, world.platform
        pose = next_pose(hand, *known)
        hand = brought_near(hand, pose, *known)
    else:
        places = search_places(world.reach, SEARCH_SPACING)
        found = search_pose(places, grasped.closings, world.platform)
        if found is None:
            return None
        pose = found
    told = {"number": grasped.closings, "pose": pose.array, "advanced": np.array(hand.advanced)}
    goal = derive(GraspGoal, hand, **told, not_before=state.clock)
    return goal if fits_closing(demand, state, goal) else None


def with_contacts(state: State, contacts: GraspContacts) -> State:
    """The state, knowing what the hand met."""
    before, goal = state.grasped, state.closing
    assert goal is not None
    points = np.concatenate([before.points, contacts.points])
    grasped = HandContacts(
        points=points,
        normals=np.concatenate([before.normals, contacts.normals]),
        closings=before.closings + 1,
        grips=before.grips + bool(len(points)),
        resting=Pose.from_array(goal.pose),
        advanced=float(goal.advanced.max(initial=0.0)),
    )
    return replace(state, grasped=grasped, clock=contacts.robot_time)


def with_coarse(state: State, coarse: Superquadric, axis: Floats | None) -> State:
    """The state with the slicing frame that the coarse model lets choose, or with a given axis."""
    fit = fitted_superquadric(coarse)
    return with_frame(replace(state, grasped=replace(state.grasped, fit=fit)), axis)


def fitted_superquadric(coarse: Superquadric) -> FittedSuperquadric:
    """The coarse model as a solid."""
    bend = Bend(coarse.bend, coarse.bend_direction if coarse.bend else 0.0)
    return derive(FittedSuperquadric, coarse, bend=bend, rms=coarse.residual)


class EndTouch(NamedTuple):
    """A single touch of an end."""

    end: End  # Which
    height: float  # Where that is, m
    probing: ProbeCommand  # The touch


def next_touch(state: State, tolerance: float, *, last: bool) -> EndTouch | None:
    """The next touch of an end, if one is due.

    At first each end is found; it is touched all over when there is a contour near to it, or when
    all slices are done. One finger at a time, and away from the others.
    """
    survey = state.survey
    assert survey is not None
    if any(task.probing for task in state.tasks.values()):
        return None
    for end in ENDS:
        height = survey.high if end == "upper" else survey.low
        if any(abs(task.height - height) < survey.finger_spacing for task in state.tasks.values()):
            continue
        found = next_probe(end, _end_observation(state, survey, end, tolerance, last))
        if isinstance(found, ProbeCommand):
            return EndTouch(end, height, found)
    return None


def _end_observation(
    state: State, survey: Survey, end: End, tolerance: float, last: bool
) -> EndObservation:
    upper = end == "upper"
    here, there = (survey.high, survey.low) if upper else (survey.low, survey.high)
    contour = survey.outermost(upper=upper)
    due = contour is not None and (
        last or abs(contour.height - here) < END_NEARNESS * (survey.high - survey.low)
    )
    return EndObservation(
        height=here,
        deviation=survey.high_deviation if upper else survey.low_deviation,
        other=there,
        radius=survey.radius,
        width=survey.pad_width,
        tolerance=tolerance,
        noise=0.0 if survey.uncertainty is None else survey.uncertainty.pose,
        standing=survey.standing and not upper,
        contour=SideContour(
            contour.points, contour.normals, contour.contact_low, contour.contact_high
        )
        if contour is not None and due
        else None,
        probes=state.ends.get(end, ()),
    )


def with_probe(state: State, task: Task, probe: Probe) -> State:
    """The state, knowing what a probe has found."""
    assert state.survey is not None and state.frame is not None and task.probing is not None
    end, probing = task.probing
    survey, frame = state.survey, state.frame
    if probe.outcome in HITS:
        state = replace(state, probes=(*state.probes, probe.id))
        searching = end == "upper" and not survey.traced
        better = along_face(state, probe.normal) if searching else None
        if better is not None:
            return better
    point = frame.pose.to_local(probe.point)
    made = ProbeResult(probing, probe.outcome, point, probe.normal @ frame.pose.axes)
    ends = {**state.ends, end: (*state.ends.get(end, ()), made)}
    faces = [one for one in ends[end] if one.touched and one.probing.reason != "edge"]
    if made.touched:
        survey = survey.reaching(float(made.point[2]), float(made.point[2]))
    if faces:
        upper = end == "upper"
        tip = (max if upper else min)((one.point for one in faces), key=lambda point: point[2])
        survey = survey.ended(tip, upper=upper)
    return replace(state, survey=survey, ends=ends)


def along_face(state: State, face: Floats) -> State | None:
    """The state with a better slicing axis, if the upper end's normal, in the world, tells one.

    None if it does not, or the axis was given: by the user, or by an earlier touch.
    """
    assert state.frame is not None
    if state.frame.axis == "given":
        return None
    axis = state.frame.pose.axes[:, 2]
    better = end_face_axis(axis, face, state.grasped.normals)
    if better is None:
        return None
    found = with_frame(state, better)
    assert found.frame is not None and found.frame.axis == "given"  # so this happens but once
    return found


def with_frame(state: State, axis: Floats | None) -> State:
    """The state at the beginning of the slices, along a given axis or along one that is found."""
    assert state.world is not None and state.grasped.fit is not None
    grasped, platform = state.grasped, state.world.platform
    frame = fit_object_frame(
        state.grasped.fit, grasped.points, grasped.normals, platform, CONTACT_ERROR, axis
    )
    # Where heights are the world's, the object stands on its lower end.
    upright = float(frame.pose.axes[2, 2]) == 1.0
    heights = frame.pose.to_local(grasped.points)[:, 2]
    survey = Survey(
        low=platform if upright else frame.low,
        high=frame.high,
        low_deviation=0.0 if upright else frame.extent_error,
        high_deviation=frame.extent_error,
        radius=frame.radius,
        standing=upright,
        # Never beyond the expected ends
        reached=(max(float(heights.min()), frame.low), min(float(heights.max()), frame.high)),
        pad_width=state.pad_width,
        resolution=state.resolution,
    )
    return replace(state, frame=frame, survey=survey, ends={})
