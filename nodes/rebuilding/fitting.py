"""Fits of the solids of a set of contours, probes and touches.

A solid is fitted to the whole set, or continued from the solid of the set before. It depends only
on the sets in the order of their numbers, so a solid that is not kept can be fitted again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore import SpaceMap
from palpate.core.poses import Pose
from palpate.core.rebuild import LatticeSolid, Method, reconstruct
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.steps import Steps, no_steps
from palpate.messages import types
from palpate.nodes.rebuilding.candidates import (
    Candidates,
    FittedGeneral,
    Placements,
    is_final,
)
from palpate.nodes.rebuilding.placements import located, underside_of
from palpate.nodes.rebuilding.received import (
    Goal,
    State,
    as_at_first,
    closings_in,
    contacts_in,
    known_space,
    placements_of,
    touched_goals,
    touched_points,
    touched_since,
    touches_of,
    touches_since,
    untouched_by,
)
from palpate.nodes.rebuilding.soundness import departure, faults_of, lacks
from palpate.nodes.rebuilding.volume import MeshVolume

if TYPE_CHECKING:
    from palpate.core.rebuild import GeneralSolid
    from palpate.nodes.rebuilding.candidates import AnySolid


MIN_UPRIGHT_COSINE = 1.0 - 1e-12  # of the lean of an upright frame, with rounding errors
TOUCHED_OUTCOMES = ("hit", "bottomed")  # outcomes of touches with contact


def predicted_squares(state: State, goal: Goal, step: Steps) -> tuple[dict[str, Floats], bool]:
    """Mean square distances of the last touches from earlier solids, by method [m^2].

    The touches of each of the last `n_sets` different sets are predicted by the set before. Also
    whether they decide what is published: a slice was not traced, or slices make no solid.
    """
    squares: dict[str, list[Floats]] = {"lattice": [], "general": []}
    later, n_sets, has_choice = goal, 0, False
    seen = seen_state(state, goal, step)
    for before in reversed(state.history):
        since = touched_since(seen, before, later)
        if not since:
            continue
        touched = stack_points(since)
        fitted = fitted_solids(state, before, step)
        is_open = fitted.sliced is None or goal.failed
        if has_choice and not is_open:
            break
        for method, offsets in fitted.predicted(later.number, touched).items():
            squares[method].append(offsets)
        later, n_sets, has_choice = before, n_sets + 1, is_open
        if n_sets == state.settings.refits.n_sets:
            break
    return {method: np.concatenate(parts) for method, parts in squares.items() if parts}, has_choice


def fitted_solids(state: State, goal: Goal, step: Steps) -> Candidates:
    """The solids of a set, which are fitted if they are not kept."""
    if goal.number not in state.fitted:
        state.fitted[goal.number] = _candidates(state, goal, step)
    return state.fitted[goal.number]


def seen_state(state: State, goal: Goal, step: Steps) -> State:
    """The state in the frame of the first placement, by the poses that a set's solids give."""
    return as_at_first(state, fitted_solids(state, goal, step).placements.poses)


class Published(NamedTuple):
    """The solid of a set that is published, and its alternatives."""

    candidates: Candidates  # include the published solid
    solid: AnySolid | None  # None if no solid passes the checks
    predicted: Mapping[str, Floats]  # mean squares by method, of `predicted_squares` [m^2]
    rejected: tuple[str, ...]  # rejected solids, with reasons


def published_solid(state: State, goal: Goal, step: Steps) -> Published:
    """The solid of a set with better predictions, or that of the set before if it is rejected.

    With the method "thesis" it is the thesis's solid, without checks.
    """
    if state.method == "thesis":
        candidates = fitted_solids(state, goal, step)
        return Published(candidates, candidates.sliced, {}, ())
    chosen = _chosen(state, goal, step)
    before = next((set_ for set_ in reversed(state.history) if set_.number < goal.number), None)
    if chosen.solid is None:
        if not chosen.rejected or before is None:
            return chosen
        earlier = _chosen(state, before, step)
        return chosen._replace(candidates=earlier.candidates, solid=earlier.solid)
    bound = goal.rms_bound_95 if isinstance(goal, types.PlanDone) else None
    if bound is None:
        return chosen
    why = _lacking(chosen, bound, step)
    if why:
        other = None if before is None else _chosen(state, before, step)
    else:
        other = _draft(state, goal, before, chosen.solid, step)
        why = _departing(chosen, other, bound, step)
    if not why or other is None or other.solid is None:
        return chosen
    return other._replace(predicted=chosen.predicted, rejected=(*chosen.rejected, *why))


def _lacking(published: Published, bound: float, step: Steps) -> tuple[str, ...]:
    """A sentence if parts that a general solid lacks cause more error than the bound [m]."""
    solid = published.solid
    if solid is None or isinstance(solid, LatticeSolid):
        return ()
    with step("prediction"):
        volume = MeshVolume(published.candidates.mesh_of(solid))
        candidates = published.candidates
        return lacks(volume, candidates.touched, bound, candidates.settings.soundness)


def _departing(
    published: Published, draft: Published | None, bound: float, step: Steps
) -> tuple[str, ...]:
    """A sentence if the rms distance of a solid from its draft exceeds the bound [m]."""
    if published.solid is None or draft is None or draft.solid is None:
        return ()
    with step("prediction"):
        mesh = published.candidates.mesh_of(published.solid)
        drafted, settings = draft.candidates.mesh_of(draft.solid), published.candidates.settings
        return departure(mesh, drafted, bound, settings.soundness)


def _chosen(state: State, goal: Goal, step: Steps) -> Published:
    """The solid of a set with better predictions, not compared with a draft."""
    candidates = fitted_solids(state, goal, step)
    with step("prediction"):
        predicted, is_enough = predicted_squares(state, goal, step)
    solid = candidates.better(predicted if is_enough else {})
    return Published(candidates, solid, predicted, candidates.rejected)


def _draft(
    state: State, goal: Goal, before: Goal | None, solid: AnySolid, step: Steps
) -> Published | None:
    """The solid with which a final solid is compared.

    It is that of the set before if that has the same touches; else a draft of the final slices, or
    None for a general solid.
    """
    if before is not None and set(touched_goals(before)) == set(touched_goals(goal)):
        return _chosen(state, before, step)
    if not isinstance(solid, LatticeSolid):
        return None
    touched = fitted_solids(state, goal, step).touched
    candidates = _sliced(state, goal, touched, ("draft",), step)
    return Published(candidates, candidates.sliced, {}, ())


def _candidates(state: State, goal: Goal, step: Steps) -> Candidates:
    """The solids of a set, and the poses of the object that follow from them."""
    before = next((set_ for set_ in reversed(state.history) if set_.number < goal.number), None)
    known = Placements() if before is None else fitted_solids(state, before, step).placements
    fitted = _fitted(state, known.poses, goal, step)
    if fitted.general is None or not placements_of(state):
        return replace(fitted, placements=known)
    with step("placement"):
        placements = located(state, goal, fitted.general.solid, known)
    return replace(fitted, placements=placements)


def _fitted(state: State, poses: tuple[Pose, ...], goal: Goal, step: Steps) -> Candidates:
    """The solids of a set; `poses`: of the object in the world after each turn."""
    seen = as_at_first(state, poses)
    touched = [contacts for contacts in touched_points(seen, goal) if len(contacts.points)]
    if state.method == "thesis":
        return _by_thesis(state, goal, stack_points(touched), step)
    methods: tuple[Method, ...] = ("lattice", "draft") if is_final(goal) else ("draft",)
    by_slices = _sliced(state, goal, stack_points(touched), methods, step)
    if by_slices.sliced is not None and not goal.failed:
        return by_slices
    # If the first slice met nothing, a solid of the hand's contacts shows where to touch.
    if not touched and not (goal.failed and closings_in(state, goal, 0)):
        return by_slices
    general = _general(state, poses, goal, step)
    if general is None:
        return replace(by_slices, why="all touches lie in one plane")
    if not is_final(goal):  # it is not checked: the planner touches it where it may be wrong
        return replace(by_slices, general=general)
    space = None if state.space is None else known_space(seen, goal)
    volume, limits = MeshVolume(general.solid.rough_mesh), state.settings.soundness
    faults = faults_of(volume, None, by_slices.touched, space, limits)
    if faults:
        reasons = tuple(f"the general solid: {fault}" for fault in faults)
        return replace(by_slices, rejected=(*by_slices.rejected, *reasons))
    return replace(by_slices, general=general)


def _sliced(
    state: State, goal: Goal, touched: ContactPoints, methods: Sequence[Method], step: Steps
) -> Candidates:
    """The solid in slices by the first of the methods whose solid passes all checks."""
    settings = state.settings
    failed = Candidates(None, None, touched, settings=settings)
    if not goal.contours or goal.general:
        return failed
    space = None if state.space is None else known_space(state, goal)
    for method in methods:
        try:
            solid = _rebuild(state, goal, method, step)
        except ValueError as error:  # the contours make no solid: a result, not a fault
            return replace(failed, why=str(error))
        sliced_only = replace(failed, sliced=solid, why="")
        with step("bound"):
            deviation = solid.whole_deviation()
        limits = settings.soundness if method == "lattice" else settings.draft_soundness
        limits = limits if is_final(goal) else settings.early_soundness
        deviation_of_whole = deviation and deviation.whole
        swept = None if space is None or is_final(goal) else _swept_between(state, goal, space)
        faults = faults_of(sliced_only.volume, deviation_of_whole, touched, space, limits, swept)
        if not faults:
            return sliced_only
        reasons = tuple(f"the {method} of its slices: {fault}" for fault in faults)
        failed = replace(failed, why="; ".join(faults), rejected=(*failed.rejected, *reasons))
    return failed


def _by_thesis(state: State, goal: Goal, touched: ContactPoints, step: Steps) -> Candidates:
    """The thesis's solid of the contours, not checked against touches."""
    failed = Candidates(None, None, touched, method="thesis", settings=state.settings)
    if not goal.contours:
        return failed
    try:
        return replace(failed, sliced=_rebuild(state, goal, "thesis", step))
    except ValueError as error:
        # A few contours make no solid yet; that is reported only for the final model.
        return replace(failed, why=str(error)) if is_final(goal) else failed


def _swept_between(state: State, goal: Goal, space: SpaceMap) -> Floats:
    """The places (n, 3) that fingers have swept between the outermost contours [m]."""
    contours = [state.contours[id_] for id_ in goal.contours]
    swept = space.free_places()
    heights = Pose.from_array(common_frame(contours)).to_local(swept)[:, 2]
    levels = [contour.height for contour in contours]
    return swept[(heights > min(levels)) & (heights < max(levels))]


def _general(
    state: State, poses: tuple[Pose, ...], goal: Goal, step: Steps
) -> FittedGeneral | None:
    """The general solid of all touches; None if they lie in one plane.

    It continues the solid of the set before if possible; otherwise it is fitted without one.
    """
    seen = as_at_first(state, poses)
    touched = touches_since(seen, (), goal)
    earlier = _earlier(state, goal, step)
    if earlier is not None:
        continued = _continued(seen, goal, *earlier, len(touched), step)
        if continued is not None:
            return continued
    # Imported late: objects with a solid in slices do not need it.
    from palpate.core.rebuild.general import is_flat

    grasped = contacts_in(state, goal, poses, {number for _, number in touched} | {0})
    parts = [*grasped, *touched]
    evidence = stack_points([contacts for contacts, _ in parts])
    if is_flat(evidence.points):
        return None
    placement = np.concatenate([np.full(int(part.touch.max()) + 1, n) for part, n in parts])
    underside = None
    if placement.any() and earlier is not None:
        underside = earlier[1].underside
        if underside is None:
            underside = underside_of(earlier[1].solid, state.settings.locating)
    solid = _fit_general(seen, goal, evidence, placement.astype(np.int32), None, underside, step)
    count = len(touched)
    return FittedGeneral(solid, count, count, underside)


def _continued(
    seen: State, goal: Goal, earlier: Goal, before: FittedGeneral, count: int, step: Steps
) -> FittedGeneral | None:
    """The general solid of the set before, continued; None if it must be fitted without one.

    A few further touches within its cells are added one by one, each by a local fit; otherwise all
    coefficients are fitted again. `count`: number of all touches.
    """
    more = touches_since(seen, touched_goals(earlier), goal)
    # A placement that is new to the solid also brings contacts of the hand: fit without it.
    known = {int(number) for number in before.solid.placements_of_touches}
    if not {number for _, number in more} <= known:
        return None
    refits = seen.settings.refits
    is_few = count <= refits.whole_ratio * before.whole and goal.missed == earlier.missed
    is_covered = all(before.solid.covers(contacts.points) for contacts, _ in more)
    if is_few and is_covered and not is_final(goal):
        with step("implicit spline"):
            solid = before.solid
            for touch, placement in more:
                solid = solid.update(touch, placement)
        return before._replace(solid=solid)
    if count > refits.anew_ratio * before.anew:
        return None
    evidence = stack_points([before.solid.contacts, *(contacts for contacts, _ in more)])
    first, underside = before.solid.placements_of_touches, before.underside
    placements = np.array([*first, *(number for _, number in more)], np.int32)
    solid = _fit_general(seen, goal, evidence, placements, before.solid, underside, step)
    return FittedGeneral(solid, count, before.anew, underside)


def _earlier(state: State, goal: Goal, step: Steps) -> tuple[Goal, FittedGeneral] | None:
    """The set before and its general solid, if this set contains all touches of that set."""
    before = next((set_ for set_ in reversed(state.history) if set_.number < goal.number), None)
    if before is None or len(closings_in(state, before, 0)) != len(closings_in(state, goal, 0)):
        return None
    if not set(touched_goals(before)) <= set(touched_goals(goal)):
        return None
    known = fitted_solids(state, before, step).general
    return None if known is None else (before, known)


def _fit_general(
    seen: State,
    goal: Goal,
    evidence: ContactPoints,
    placement: Ints,
    start: GeneralSolid | None,
    underside: Floats | None,
    step: Steps,
) -> GeneralSolid:
    from palpate.core.rebuild import general

    space = known_space(seen, goal)
    free, platform = space.free_places(), seen.platform
    if placement.any() and platform is not None:
        # The face on which it stood at first can be touched now; the space below it was free.
        below = space.below(evidence.points, seen.settings.sweeps)
        free, platform = np.concatenate([free, below]), None
    return general.rebuild_general(
        evidence,
        free=free,
        spanned=untouched_by(seen, goal).valleys,
        platform=platform,
        cell=None if is_final(goal) else general.fitting_cell(evidence),
        outward=True,
        placement=placement if placement.any() else None,
        underside=underside,
        start=start,
        draft=not is_final(goal),
        step=step,
    )


def _rebuild(state: State, goal: Goal, method: Method, step: Steps) -> LatticeSolid:
    return rebuild_set(
        [state.contours[id_] for id_ in goal.contours],
        [state.probes[id_] for id_ in goal.probes],
        {id_: touches_of(state, id_) for id_ in touched_goals(goal)},
        state.platform,
        method,
        step,
    )


def rebuild_set(
    contours: Sequence[types.Contour],  # at least one
    probes: Sequence[types.Probe],  # single touches
    # Contacts of each touch of contours, probes and unfinished contours, by number of the goal.
    touched: Mapping[int, Sequence[ContactPoints]],
    platform: float | None,  # height on which the object stands [m]; None if it is held
    method: Method = "lattice",
    step: Steps = no_steps,  # measures the time of each step
) -> LatticeSolid:
    """The solid of a set; ValueError if its contours have several frames, or of `reconstruct`."""
    frame = common_frame(contours)
    points = [contacts for of_goal in touched.values() for contacts in of_goal]
    return reconstruct(
        [contour.points for contour in contours],
        patches=stack_points(points),
        tops=touched_ends(contours, probes, touched, platform),
        method=method,
        frame=frame,
        step=step,
    )


def common_frame(contours: Sequence[types.Contour]) -> Floats:
    """Pose (7,) of the frame in which all contours were traced; ValueError if they differ."""
    first = contours[0]
    for other in contours[1:]:
        if not np.array_equal(other.frame, first.frame):
            raise ValueError(
                f"contours must be traced in one slicing frame, but that of contour {other.id} "
                f"is not that of contour {first.id}"
            )
    return first.frame


def is_upright(frame: Floats) -> bool:
    """Whether the z axis of a frame is the world's, so that an object stands on its lower end."""
    return bool(Pose.from_array(frame).axes[2, 2] >= MIN_UPRIGHT_COSINE)


def touched_ends(
    contours: Sequence[types.Contour],
    probes: Sequence[types.Probe],
    touched: Mapping[int, Sequence[ContactPoints]],
    platform: float | None,
) -> Floats | None:
    """Contacts (k, 3) of the ends of an object [m]; None if there are none.

    Arguments are those of `rebuild_set`; a probe without contacts in `touched` has its own point.
    In an upright frame, a known height of the platform counts as a contact of the lower end.

    Raises ValueError if the contours were not traced in one frame.
    """
    frame = common_frame(contours)
    tops = list(_probed(contours, probes, touched, frame))
    if platform is not None and is_upright(frame):
        tops.append(np.array([*frame[:2], platform]))
    return np.array(tops) if tops else None


def _probed(
    contours: Sequence[types.Contour],
    probes: Sequence[types.Probe],
    touched: Mapping[int, Sequence[ContactPoints]],
    frame: Floats,
) -> Iterator[Floats]:
    """Farthest contact (3,) of each probe that touched an end, beyond the outermost contours."""
    position, axes = Pose.from_array(frame)
    levels = [contour.height for contour in contours]
    low, high = min(levels), max(levels)
    for probe in probes:
        if probe.outcome not in TOUCHED_OUTCOMES:
            continue
        side = 1.0 if (probe.point - position) @ axes[:, 2] > 0.5 * (low + high) else -1.0
        parts = [part.points for part in touched.get(probe.id, ()) if len(part.points)]
        points = np.concatenate(parts) if parts else probe.point[None]
        reached = side * (points - position) @ axes[:, 2]
        if reached.max() > max(side * low, side * high):
            yield points[int(reached.argmax())]
