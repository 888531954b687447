"""The planner's probes of the two ends: when they are made, and what they have found."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from palpate.core.explore.probing.known import TOUCHED, End, EndKnown, Probed, Probing, Wall
from palpate.core.explore.probing.rule import next_probe
from palpate.core.explore.survey import Survey
from palpate.core.frames import inverse, split_pose, transform
from palpate.messages.types import Probe
from palpate.nodes.planner_grasp import along_face
from palpate.nodes.planner_state import State, Task

ENDS: tuple[End, ...] = ("upper", "lower")
NEAR = 0.07
"""Of the extent: an end is felt all over as soon as there is a contour so near to it."""


class Touch(NamedTuple):
    """A single touch of an end."""

    end: End
    """Which."""
    height: float
    """Where that is, m."""
    probing: Probing
    """The touch."""


def next_touch(state: State, tolerance: float, *, last: bool) -> Touch | None:
    """The next touch of an end, if one is due.

    At first each end is found; it is felt all over when there is a contour near to it, or when
    all slices are done. One finger at a time, and away from the others.
    """
    survey = state.survey
    assert survey is not None
    if any(task.probing for task in state.tasks.values()):
        return None
    for end in ENDS:
        height = survey.high if end == "upper" else survey.low
        if any(abs(task.height - height) < survey.apart for task in state.tasks.values()):
            continue
        found = next_probe(end, _known(state, survey, end, tolerance, last))
        if isinstance(found, Probing):
            return Touch(end, height, found)
    return None


def with_probe(state: State, task: Task, probe: Probe) -> State:
    """The state, knowing what a probe has found."""
    assert state.survey is not None and state.frame is not None and task.probing is not None
    end, probing = task.probing
    survey, frame = state.survey, state.frame
    if probe.outcome in TOUCHED:
        state = replace(state, probes=(*state.probes, probe.id))
        searching = end == "upper" and not survey.traced
        better = along_face(state, probe.normal) if searching else None
        if better is not None:
            return better
    into, axes = inverse(frame.pose), split_pose(frame.pose)[1]
    made = Probed(
        probing, probe.outcome, transform(into, probe.point[None])[0], probe.normal @ axes
    )
    ends = {**state.ends, end: (*state.ends.get(end, ()), made)}
    faces = [one for one in ends[end] if one.touched and one.probing.why != "edge"]
    if made.touched:
        survey = survey.reaching(float(made.point[2]), float(made.point[2]))
    if faces:
        upper = end == "upper"
        tip = (max if upper else min)((one.point for one in faces), key=lambda point: point[2])
        survey = survey.ended(tip, upper=upper)
    return replace(state, survey=survey, ends=ends)


def _known(state: State, survey: Survey, end: End, tolerance: float, last: bool) -> EndKnown:
    upper = end == "upper"
    here, there = (survey.high, survey.low) if upper else (survey.low, survey.high)
    wall = survey.outermost(upper=upper)
    due = wall is not None and (last or abs(wall.height - here) < NEAR * (survey.high - survey.low))
    return EndKnown(
        height=here,
        deviation=survey.high_deviation if upper else survey.low_deviation,
        other=there,
        radius=survey.radius,
        width=survey.pad_width,
        tolerance=tolerance,
        noise=0.0 if survey.doubt is None else survey.doubt.pose,
        standing=survey.standing and not upper,
        wall=Wall(wall.points, wall.normals, wall.felt_low, wall.felt_high)
        if wall is not None and due
        else None,
        probes=state.ends.get(end, ()),
    )
