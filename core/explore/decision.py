"""What to do next: one pure function from the state of an exploration to a list of goals.

Before there is a slicing frame the hand closes. Then each idle finger in turn gets a touch of an
end, a slice, a single touch, or nothing; a model is requested once there are enough results that
the last one does not contain. When no task and no model is left, the exploration is done.

Every task has its limits: a number of touches, and a robot time by which the last of them must have
ended even if it touches nothing. The tracer makes no touch beyond these limits; a task that returns
without a touch shows that the budget is spent. Where a whole contour no longer fits into the
budget, touches of ends come first, then as much of a contour as fits: its touches count.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.core.explore import grasp, planners, probing
from palpate.core.explore.exploration import Exploration
from palpate.core.explore.survey import Demand
from palpate.core.explore.tasks import (
    CloseHand,
    Done,
    Goal,
    MakeModel,
    SingleTouch,
    Task,
    TouchEnd,
    TraceSlice,
    TurnObject,
    Work,
)
from palpate.core.robot_time import longest_seconds, move_between

ENDS: tuple[probing.End, ...] = ("upper", "lower")


def goals(known: Exploration, demand: Demand, rule: planners.Planner) -> list[Goal]:
    """The next goals, in order; none while a result or a model must be waited for."""
    if known.survey is None:
        return [_grasp_goal(known, demand)]
    if known.lying.pose is None:
        return _placing_goals(known, demand)
    goals_now: list[Goal] = []
    for number, finger in known.fingers.items():
        if finger.task is not None or known.broken:
            continue
        for goal in _finger_goals(known, demand, rule, number):
            goals_now.append(goal)
            known = known.after(goal)
    if goals_now or known.tasks or known.model.is_pending:
        return goals_now
    return [_turn_goal(known, demand, rule) or Done(_reason(known, demand, rule))]


def _grasp_goal(known: Exploration, demand: Demand) -> Goal:
    """The next closing of the hand; after the last one, a coarse model, or the end."""
    closing = _next_closing(known)
    if closing is not None and _fits_closing(known, demand, closing):
        return closing
    if len(known.hand.points):
        return MakeModel()
    limits = "reach" if math.isinf(demand.most_seconds) else "reach and robot time"
    return Done(f"the hand closed on nothing within {limits}")


def _next_closing(known: Exploration) -> CloseHand | None:
    """The next closing; None once there are enough contacts, or all places were searched."""
    contacts, setup, settings = known.hand, known.setup, known.setup.grasp
    enough = settings.enough_contacts
    if known.lying.placement:
        enough = settings.lost_contacts if known.lying.fault else settings.turned_contacts
    if len(contacts.points) >= enough or contacts.grips >= settings.max_grips:
        return None
    opening = settings.opening * setup.reach
    hand = grasp.Hand(opening=opening, reach=opening)
    if len(contacts.points):
        touched = contacts.points, contacts.normals, setup.platform
        pose = grasp.next_pose(hand, *touched)
        return CloseHand(pose, grasp.brought_near(hand, pose, *touched))
    places = grasp.search_places(setup.reach, settings.search_spacing)
    number = contacts.closings - contacts.earlier
    search = grasp.search_pose(places, number, setup.platform)
    return None if search is None else CloseHand(search, hand)


def _fits_closing(known: Exploration, demand: Demand, closing: CloseHand) -> bool:
    """Whether a closing fits into the robot time that the hand may take."""
    settings = known.setup.grasp
    is_enough = len(known.hand.points) >= settings.fit_contacts
    limit = demand.most_seconds * (settings.time_share if is_enough else 1.0)
    if math.isinf(limit) or known.setup.robot is None:
        return known.seconds < limit
    last, advanced = known.hand.last, closing.hand.advanced
    travel, turn = move_between(None if last is None else last.pose, closing.pose)
    before = () if last is None else last.hand.advanced
    travel += max(before, default=0.0) + max(advanced, default=0.0)
    reach = closing.hand.reach - min(advanced, default=0.0)
    return known.seconds + longest_seconds(known.setup.robot, travel, turn, reach) <= limit


def _placing_goals(known: Exploration, demand: Demand) -> list[Goal]:
    """Goals that find the pose of an object that was turned over: closings, then a model."""
    lying = known.lying
    if lying.is_turning or known.model.is_pending:
        return []
    closing = _next_closing(known)
    if closing is not None and _fits_closing(known, demand, closing):
        return [closing]
    if lying.fault and lying.contacts == len(known.hand.points):
        return [Done(lying.fault)]
    return [MakeModel()]


def _turn_goal(known: Exploration, demand: Demand, rule: planners.Planner) -> Goal | None:
    """Set the object down on another side, if that lowers what is left to be known; or None.

    Only for planners that choose single touches. Where slices give the solid, only if the demand is
    that the underside is known.
    """
    surface, lying = known.model.surface, known.lying
    touches = isinstance(rule, planners.Predicted) or getattr(rule, "single_touches", False)
    asked = demand.underside == "known" or known.model.general
    if lying.placement >= demand.most_turns or not (touches and asked):
        return None
    if known.broken or surface is None or not known.surveyed.uncertainty.bounded:
        return None
    observation = known.observation(demand)
    if observation.budget.spent or lying.pose is None:
        return None
    findings = planners.estimate_error(observation).findings
    if planners.judge(findings, observation.limits).reached:
        return None
    turn = planners.choose_turn(
        surface,
        demand.tolerance,
        underside=demand.underside == "known",
        settings=known.setup.turning,
    )
    return None if turn is None else TurnObject(turn @ lying.pose)


def _finger_goals(
    known: Exploration, demand: Demand, rule: planners.Planner, finger: int
) -> list[Goal]:
    """The next goals of one idle finger: a task, a model on which the next choice depends, or both.

    While a model is being made, the only task is a slice that depends on no model.
    """
    touches = _touches_left(known, demand)
    if touches > 0.0 and not (known.is_cut or known.model.is_pending):
        if known.retry is not None:
            return [_single_task(known, demand, finger, known.retry)]
        is_last = bool(known.surveyed.contours) and not _fits_contour(known, demand, touches)
        due = _end_task(known, demand, finger, is_last=is_last)
        if due is not None:
            return [due]
    if not known.surveyed.traced and _is_touching_end(known):
        return []  # a finger looks for the end: until then heights of slices are not known
    asked: list[Goal] = [MakeModel()] if _is_model_due(known) else []
    if asked:
        known = known.after(MakeModel())
    observation = known.observation(demand, finger)
    match _choice(known, rule, observation):
        case planners.Height() as chosen if touches > 0.0:
            return [*asked, _slice_task(known, demand, finger, chosen, touches)]
        case planners.Touch() as touch if touches > 0.0:
            return [_single_task(known, demand, finger, SingleTouch(touch))]
        case planners.Stop() if not (known.model.is_pending or observation.budget.spent):
            if _has_news(known) or known.targets:
                return [MakeModel()]
            if not known.tasks and touches > 0.0:
                end = _end_task(known, demand, finger, is_last=True)
                return [] if end is None else [end]
    return asked


def _touches_left(known: Exploration, demand: Demand) -> float:
    """Touches that an idle finger may make: what the limits of the other tasks leave over."""
    left = demand.most_touches
    if math.isinf(left):
        return left
    left -= known.touches + sum(task.max_touches for task in known.tasks)
    if len(known.fingers) > 1:
        share = known.setup.goals.max_contour_share * _contour_touches(known)
        left = min(left, math.ceil(share))
    return left


def _contour_touches(known: Exploration) -> float:
    touches = [contour.touches for contour in known.surveyed.traced]
    return float(np.mean(touches)) if touches else known.setup.goals.first_contour_touches


def _fits_contour(known: Exploration, demand: Demand, touches: float) -> bool:
    """Whether a whole contour is expected to fit into `touches` and the robot time left."""
    seconds = [contour.seconds for contour in known.surveyed.traced]
    end = known.seconds + (float(np.mean(seconds)) if seconds else 0.0)
    return _contour_touches(known) <= touches and end <= demand.most_seconds


def _is_touching_end(known: Exploration) -> bool:
    return any(isinstance(task.work, TouchEnd) for task in known.tasks)


def _end_task(known: Exploration, demand: Demand, finger: int, *, is_last: bool) -> Task | None:
    """The next touch of an end, if one is due.

    First each end is found. It is touched all over once there is a contour near it, or if
    `is_last`: no slices follow. One finger touches ends, away from other fingers. Ends of a general
    solid are part of its surface, which the planner treats.
    """
    if not known.setup.goals.touch_ends or known.model.general or _is_touching_end(known):
        return None
    survey = known.surveyed
    for end in ENDS:
        height = survey.high if end == "upper" else survey.low
        if any(abs(task.height - height) < known.setup.finger_spacing for task in known.tasks):
            continue
        command = probing.next_probe(
            end, _end_observation(known, end, demand.tolerance, is_last=is_last)
        )
        if isinstance(command, probing.ProbeCommand):
            return _task(known, demand, finger, height, 1.0, TouchEnd(end, command))
    return None


def _end_observation(
    known: Exploration, end: probing.End, tolerance: float, *, is_last: bool
) -> probing.EndObservation:
    survey, is_upper = known.surveyed, end == "upper"
    height, other = (survey.high, survey.low) if is_upper else (survey.low, survey.high)
    contour = survey.outermost(upper=is_upper)
    max_distance = known.setup.goals.end_nearness * (survey.high - survey.low)
    is_due = contour is not None and (is_last or abs(contour.height - height) < max_distance)
    return probing.EndObservation(
        height=height,
        deviation=survey.high_deviation if is_upper else survey.low_deviation,
        other_height=other,
        radius=survey.frame.radius,
        width=known.setup.pad_width,
        tolerance=tolerance,
        noise=survey.uncertainty.pose,
        is_standing=survey.standing and not is_upper,
        contour=probing.SideContour(
            contour.points, contour.normals, contour.contact_low, contour.contact_high
        )
        if contour is not None and is_due
        else None,
        probes=survey.ends.get(end, ()),
    )


def _is_model_due(known: Exploration) -> bool:
    """Whether there are enough results that the last model does not contain for another one."""
    settings, model, touches = known.setup.goals, known.model, known.touches
    if model.is_pending or not known.surveyed.traced:
        return False
    is_much = touches - model.touches >= settings.contour_share * touches
    if known.end_touches != model.end_touches or (is_much and _has_news(known)):
        return True
    return len(known.targets) >= max(settings.single_batch, int(settings.single_share * touches))


def _has_news(known: Exploration) -> bool:
    """Whether there are slices or touches of ends that the last model does not contain."""
    slices, model = len(known.surveyed.traced), known.model
    return (slices, known.end_touches) != (model.slices, model.end_touches)


def _choice(
    known: Exploration, rule: planners.Planner, observation: planners.Observation
) -> planners.Choice:
    """The planner's answer; an answer that cannot be carried out becomes a `Stop`.

    While a model is being made, the planner is asked only for slices that depend on no model.
    """
    if known.goals >= known.setup.goals.max_goals:
        return planners.Stop("a model can list no more contours and single touches")
    if known.lying.placement and not getattr(rule, "single_touches", False):
        rule = planners.Touches()  # the slicing frame is that of the first pose
    settled = planners.settled_height(rule, observation)
    if settled is not None:
        return settled
    if known.model.is_pending:
        return planners.Wait("a model is in the making")
    try:
        return planners.check_choice(rule, observation)
    except planners.WrongChoiceError as error:
        return planners.Stop(str(error))


def _slice_task(
    known: Exploration, demand: Demand, finger: int, chosen: planners.Height, touches: float
) -> Task:
    survey, width, settings = known.surveyed, known.setup.pad_width, known.setup.goals
    centre, radius = survey.approach(chosen.height)
    gap = settings.max_gap * max(1.0 - settings.dense_feature * width / demand.feature, 0.0) * width
    # A contour that is much longer than the longest so far does not lead around the object.
    perimeters = [made.perimeter for made in survey.traced if made.usable]
    longest = max(perimeters, default=2.0 * math.pi * survey.frame.radius)
    turns = math.ceil(settings.contour_turns * longest / (settings.touch_advance * width))
    max_touches = settings.min_contour_touches + turns
    work = TraceSlice(centre, radius, gap, max_touches, chosen.reason)
    return _task(known, demand, finger, chosen.height, touches, work)


def _single_task(known: Exploration, demand: Demand, finger: int, single: SingleTouch) -> Task:
    height = float(known.surveyed.frame.pose.to_local(single.touch.target)[2])
    return _task(known, demand, finger, height, 1.0, single)


def _task(
    known: Exploration, demand: Demand, finger: int, height: float, touches: float, work: Work
) -> Task:
    return Task(
        number=known.goals,
        finger=finger,
        start=known.seconds,
        height=height,
        max_touches=touches,
        not_after=demand.most_seconds,
        work=work,
    )


def _reason(known: Exploration, demand: Demand, rule: planners.Planner) -> str:
    """Why the exploration ends, and what kind of solid its slices gave."""
    if known.broken:
        return known.broken
    choice = _choice(known, rule, known.observation(demand))
    if not isinstance(choice, planners.Stop):
        raise ValueError(
            f"nothing is under way, and the planner neither stops nor goes on: {choice}"
        )
    uncertainty = known.surveyed.uncertainty
    if not known.surveyed.contours or (uncertainty.starlike and uncertainty.bounded):
        return choice.reason
    if not uncertainty.bounded:
        return f"{choice.reason}; its method of rebuilding states no error bound"
    if uncertainty.whole is None:
        return f"{choice.reason}; no solid could be rebuilt from its slices"
    return f"{choice.reason}; its slices are not star-shaped: it is rebuilt from contours alone"
