"""The planner's first part: the hand closes until the object is known well enough to slice it."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.approach import search_places
from palpate.core.explore.grasp.face_axis import face_axis
from palpate.core.explore.grasp.fit import CoarseFit
from palpate.core.explore.grasp.hand import Hand
from palpate.core.explore.grasp.poses import next_pose, search_pose
from palpate.core.explore.slicing_frame import SlicingFrame, slicing_frame
from palpate.core.explore.survey import Survey
from palpate.core.frames import inverse, split_pose, transform
from palpate.core.shapes.bend import Bend
from palpate.messages.types import GraspContacts, GraspGoal, Superquadric
from palpate.nodes.planner_state import Grasped, State

CONTACTS = 60
"""Contacts after which the hand has felt enough."""
MOST_GRIPS = 30
"""Times that it closes on the object at most."""
SPACING = 12.0e-3
"""Distance of the places at which the object is looked for, m: less than a pad."""
OPENING = 0.8
"""Of the reach: how far the hand's fingers open."""
CONTACT_ERROR = 0.1e-3
"""Standard deviation of a contact, m."""


def grasp_goal(state: State) -> GraspGoal | None:
    """The next closing of the hand; None once it has felt enough, or looked everywhere."""
    assert state.world is not None
    grasped, world = state.grasped, state.world
    hand = Hand(opening=OPENING * world.reach, reach=OPENING * world.reach)
    if len(grasped.points) >= CONTACTS or grasped.grips >= MOST_GRIPS:
        return None
    if len(grasped.points):
        pose = next_pose(hand, grasped.points, grasped.normals, world.platform)
    else:
        places = search_places(world.reach, SPACING)
        found = search_pose(places, grasped.closings, world.platform)
        if found is None:
            return None
        pose = found
    return GraspGoal(
        number=grasped.closings,
        pose=pose,
        fingers=hand.fingers,
        opening=hand.opening,
        reach=hand.reach,
        not_before=state.clock,
    )


def with_contacts(state: State, contacts: GraspContacts) -> State:
    """The state, knowing what the hand met."""
    before = state.grasped
    points = np.concatenate([before.points, contacts.points])
    grasped = Grasped(
        points=points,
        normals=np.concatenate([before.normals, contacts.normals]),
        closings=before.closings + 1,
        grips=before.grips + bool(len(points)),
    )
    return replace(state, grasped=grasped, clock=contacts.robot_time)


def with_coarse(state: State, coarse: Superquadric, axis: Floats | None) -> State:
    """The state with the slicing frame that the coarse model lets choose, or with a given axis."""
    fit = CoarseFit(
        size=coarse.size,
        exponents=coarse.exponents,
        pose=coarse.pose,
        taper=coarse.taper,
        bend=Bend(coarse.bend, coarse.bend_direction if coarse.bend else 0.0),
        residuals=coarse.residuals,
        rms=coarse.residual,
        doubts=coarse.doubts,
    )
    return with_frame(replace(state, grasped=replace(state.grasped, fit=fit)), axis)


def with_frame(state: State, axis: Floats | None) -> State:
    """The state at the beginning of the slices, along a given axis or along one that is found."""
    assert state.world is not None and state.grasped.fit is not None
    grasped, platform = state.grasped, state.world.platform
    fit = state.grasped.fit
    frame = slicing_frame(fit, grasped.points, grasped.normals, platform, CONTACT_ERROR, axis)
    survey = Survey(
        low=platform if _is_upright(frame) else frame.low,
        high=frame.high,
        low_deviation=0.0 if _is_upright(frame) else frame.extent_error,
        high_deviation=frame.extent_error,
        radius=frame.radius,
        standing=_is_upright(frame),
        reached=_reached(frame, grasped.points),
        pad_width=state.pad_width,
        resolution=state.resolution,
    )
    return replace(state, frame=frame, survey=survey, ends=MappingProxyType({}))


def along_face(state: State, face: Floats) -> State | None:
    """The state with a better slicing axis, if the upper end's normal, in the world, tells one.

    None if it does not, or the axis was given: by the user, or by an earlier touch.
    """
    assert state.frame is not None
    if state.frame.axis == "given":
        return None
    axis = split_pose(state.frame.pose)[1][:, 2]
    better = face_axis(axis, face, state.grasped.normals)
    if better is None:
        return None
    found = with_frame(state, better)
    assert found.frame is not None and found.frame.axis == "given"  # so this happens but once
    return found


def _reached(frame: SlicingFrame, points: Floats) -> tuple[float, float]:
    """Lowest and highest contact along the slicing axis, m: never beyond the expected ends."""
    heights = transform(inverse(frame.pose), points)[:, 2]
    return max(float(heights.min()), frame.low), min(float(heights.max()), frame.high)


def _is_upright(frame: SlicingFrame) -> bool:
    """Whether its heights are the world's, so that the object stands on its lower end."""
    return float(split_pose(frame.pose)[1][2, 2]) == 1.0
