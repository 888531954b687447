"""What the planner remembers, and the goals that it makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from palpate.core import Floats, compose_poses, inverse_pose, split_pose, transform_points
from palpate.core.explore import Survey, TracedContour
from palpate.core.explore.grasp import ObjectFrame
from palpate.core.explore.planners import Height
from palpate.core.explore.probing import End, ProbeCommand, ProbeResult
from palpate.core.shapes import FittedSuperquadric
from palpate.messages.types import Contour, ContourGoal, ModelGoal, Probe, ProbeGoal, World


class Task(NamedTuple):
    """What a finger is at."""

    goal: int  # Number of the goal
    begun: float  # Robot time of the decision, s
    height: float  # Of the slice, m
    # The end that is probed, and how; None for a slice.
    probing: tuple[End, ProbeCommand] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class HandContacts:
    """Where the hand has met the object so far."""

    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3), m
    # Outward unit normals, (n, 3).
    normals: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    closings: int = 0  # Times that the hand has closed
    grips: int = 0  # Of these, since it first met something
    fit: FittedSuperquadric | None = None  # The coarse model through all that, once there is one


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What the planner knows."""

    world: World | None = None  # Where the object stands
    pad_width: float = 0.0  # Of a finger, m
    resolution: float = 0.0  # Smallest difference that the sensor tells, m
    grasped: HandContacts = field(default_factory=HandContacts)  # By the hand
    frame: ObjectFrame | None = None  # Once the object has been grasped
    survey: Survey | None = None  # What is known since
    # Touches of each end.
    ends: Mapping[End, tuple[ProbeResult, ...]] = field(
        default_factory=lambda: MappingProxyType({})
    )
    # Finger to what it is at.
    tasks: Mapping[int, Task] = field(default_factory=lambda: MappingProxyType({}))
    # Finger to its result, not yet taken up.
    pending: Mapping[int, Contour | Probe] = field(default_factory=lambda: MappingProxyType({}))
    # Finger to the robot time that it has reached, s.
    clocks: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    # Numbers of all slices, in the order in which they were taken up.
    contours: tuple[int, ...] = ()
    probes: tuple[int, ...] = ()  # Numbers of the probes that hit
    modelled: tuple[int, int] = (0, 0)  # Usable contours and probes of the last model
    goals: int = 0  # Contours and probes asked for
    models: int = 0  # Models asked for
    asked: bool = False  # Whether a model is being waited for
    touches: int = 0  # Touches spent
    clock: float = 0.0  # Robot time spent, s

    @property
    def usable(self) -> tuple[int, ...]:
        """Numbers of the contours that a model is fitted to."""
        assert self.survey is not None
        pairs = zip(self.contours, self.survey.traced, strict=True)
        return tuple(number for number, one in pairs if one._replace(dropped=False).usable)

    @property
    def evidence(self) -> tuple[int, int]:
        """Usable contours, and probes, that there are."""
        return len(self.usable), len(self.probes)

    @property
    def is_searching(self) -> bool:
        """Whether a finger still looks for an end, so that nobody knows where slices should be."""
        assert self.survey is not None
        return not self.survey.traced and any(task.probing for task in self.tasks.values())

    @property
    def is_stale(self) -> bool:
        """Whether there is more than the last model knows, and enough for another."""
        return bool(self.usable) and self.evidence != self.modelled


def contour_goal(state: State, finger: int, chosen: Height) -> ContourGoal:
    """A slice to trace."""
    assert state.survey is not None and state.frame is not None
    centre, radius = state.survey.approach(chosen.height)
    return ContourGoal(
        id=state.goals,
        finger=finger,
        frame=state.frame.pose,
        height=chosen.height,
        centre=centre,
        radius=radius,
        not_before=state.clock,
        reason=chosen.reason,
    )


def probe_goal(state: State, finger: int, probing: ProbeCommand) -> ProbeGoal:
    """A single touch."""
    assert state.frame is not None
    return ProbeGoal(
        id=state.goals,
        finger=finger,
        pose=compose_poses(state.frame.pose, probing.pose),
        reach=probing.reach,
        not_before=state.clock,
    )


def model_goal(state: State) -> ModelGoal:
    """A model of all that there is."""
    return ModelGoal(
        number=state.models,
        contours=() if state.survey is None else state.usable,
        probes=state.probes,
        closings=state.grasped.closings,
        touches=state.touches,
        robot_time=state.clock,
    )


def traced_of(contour: Contour, begun: float) -> TracedContour:
    """A contour as the survey keeps it, slicing frame."""
    into = inverse_pose(contour.frame)
    gaps = transform_points(into, contour.gap_ends) - transform_points(into, contour.gap_starts)
    return TracedContour(
        height=contour.height,
        status=contour.status,
        points=transform_points(into, contour.points),
        normals=contour.normals @ split_pose(contour.frame)[1],
        across=contour.curvature,
        contact_low=contour.contact_low,
        contact_high=contour.contact_high,
        missing=float(np.linalg.norm(gaps, axis=1).sum()),
        touches=contour.touches,
        seconds=max(contour.robot_time - begun, 0.0),
    )
