"""Solids of a set: fitted as a whole, or continued from those of the set before it.

A fit depends on the sets alone, in the order of their numbers: one that is not kept is made anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from palpate.core import Floats, Steps, no_steps
from palpate.core.explore import SpaceMap
from palpate.core.rebuild import Method, Solid, reconstruct
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.messages import types
from palpate.nodes.rebuilding.candidates import Candidates, MeshVolume
from palpate.nodes.rebuilding.evidence import (
    Goal,
    State,
    common_frame,
    known_space,
    touched_ends,
    touched_goals,
    touched_points,
    touched_since,
)

if TYPE_CHECKING:
    from palpate.core.rebuild import GeneralSolid

SETS = 3  # By how the last so many were predicted a method is chosen
MORE = 1.25  # Times as many touches as a general solid was fitted to: then it is fitted anew
SWEPT = 5.0e-3  # Depth inside a solid at which no finger can have been, m


def predicted_squares(state: State, goal: Goal, step: Steps) -> tuple[dict[str, Floats], bool]:
    """Mean square distance of each of the last touches from the solids before it, by method, m^2.

    Those of the last `SETS` different sets, each by the solids of the one before it; and whether
    the better one is to be published: where a slice could not be traced, or slices make no solid.
    """
    squares: dict[str, list[Floats]] = {"lattice": [], "general": []}
    later, sets, enough = goal, 0, False
    for before in reversed(state.history):
        since = touched_since(state, before, later)
        if not since:
            continue
        touched = stack_points(since)
        fitted = fitted_solids(state, before, step)
        known = fitted.sliced is None or goal.failed
        if enough and not known:
            break
        for method, found in fitted.predicted(later.number, touched).items():
            squares[method].append(found)
        later, sets, enough = before, sets + 1, known
        if sets == SETS:
            break
    return {method: np.concatenate(found) for method, found in squares.items() if found}, enough


def fitted_solids(state: State, goal: Goal, step: Steps) -> Candidates:
    """The solids of a set: those that are kept, or else fitted anew."""
    if goal.number not in state.fitted:
        state.fitted[goal.number] = _candidates(state, goal, step)
    return state.fitted[goal.number]


def _candidates(state: State, goal: Goal, step: Steps) -> Candidates:
    sliced, why = None, ""
    if goal.contours and not goal.general:
        try:
            sliced = _rebuild(state, goal, step)
        except ValueError as error:  # what was touched is no solid: a result, not a fault
            why = str(error)
    touched = [one for one in touched_points(state, goal) if len(one.points)]
    alone = Candidates(sliced, None, stack_points(touched), why)
    if sliced is not None and is_swept(alone.volume, known_space(state, goal)):
        why = "a finger has passed through what its slices enclose"
        sliced, alone = None, replace(alone, sliced=None, why=why)
    if not touched or (sliced is not None and not goal.failed):
        return alone
    found = _continued(state, goal, step)
    if found is not None:
        return replace(alone, general=found[0], whole=found[1])
    general = _general(state, goal, touched, step)
    if general is None:
        return replace(alone, why="all touches lie in one plane")
    return replace(alone, general=general, whole=len(touched))


def _general(
    state: State, goal: Goal, touched: list[ContactPoints], step: Steps
) -> GeneralSolid | None:
    """The general solid of all touches; None if they lie in one plane."""
    # Of objects that slices tell of, nobody waits for these imports.
    from palpate.core.rebuild import general

    final = isinstance(goal, types.PlanDone)
    grasped = [state.contacts[number] for number in range(goal.closings)]
    evidence = stack_points([one for one in grasped if len(one.points)] + touched)
    if general.is_flat(evidence.points):
        return None
    return general.rebuild_general(
        evidence,
        free=known_space(state, goal).free_places(),
        platform=state.platform,
        cell=general.FINE if final else general.fitting_cell(evidence),
        folds=general.FOLDS if final else general.FEW_FOLDS,
        step=step,
    )


def _continued(state: State, goal: Goal, step: Steps) -> tuple[GeneralSolid, int] | None:
    """The general solid of the set before, with the touches since; None where it must be fitted.

    And the number of touches to which it was last fitted as a whole.

    That is at the end; where there are many more touches than at the last fit, or one of them lies
    beside the solid; and where a finger went through what was taken for solid.
    """
    before = next((one for one in reversed(state.history) if one.number < goal.number), None)
    if before is None or isinstance(goal, types.PlanDone) or before.missed != goal.missed:
        return None
    kept = set(touched_goals(before)) <= set(touched_goals(goal))
    known = (
        fitted_solids(state, before, step) if kept and before.closings == goal.closings else None
    )
    if known is None or known.general is None:
        return None
    more = touched_since(state, before, goal)
    many = len(touched_points(state, goal)) > MORE * known.whole
    if many or not all(known.general.covers(one.points) for one in more):
        return None
    with step("implicit spline"):
        solid = known.general
        for one in more:
            solid = solid.update(one)
    return solid, known.whole


def is_swept(volume: MeshVolume, space: SpaceMap) -> bool:
    """Whether a finger has been deep inside a solid (m), which is then none: it is hollow there."""
    free, vertices = space.free_places(), volume.mesh.vertices
    low, high = vertices.min(axis=0) + SWEPT, vertices.max(axis=0) - SWEPT
    free = free[((free > low) & (free < high)).all(axis=1)]
    return bool(volume.depths(free).max(initial=0.0) > SWEPT)


def _rebuild(state: State, goal: Goal, step: Steps) -> Solid:
    touched = {
        id_: [state.touches[id_][touch] for touch in sorted(state.touches.get(id_, {}))]
        for id_ in (*goal.contours, *goal.probes, *goal.arcs)
    }
    return rebuild_set(
        [state.contours[id_] for id_ in goal.contours],
        [state.probes[id_] for id_ in goal.probes],
        touched,
        state.platform,
        "lattice" if isinstance(goal, types.PlanDone) else "draft",
        step,
    )


def rebuild_set(
    contours: Sequence[types.Contour],  # At least one
    probes: Sequence[types.Probe],  # Single touches beside them
    # What each touch of these measured, and of unfinished contours, by the goal's number
    touched: Mapping[int, Sequence[ContactPoints]],
    platform: float,  # Height on which the object stands, m
    method: Method = "lattice",
    step: Steps = no_steps,  # Told which step begins
) -> Solid:
    """The solid of a set.

    Raises ValueError if the contours were not traced in one frame, or as `reconstruct` does.
    """
    frame = common_frame(contours)
    points = [each for of_goal in touched.values() for each in of_goal]
    return reconstruct(
        [contour.points for contour in contours],
        patches=stack_points(points),
        tops=touched_ends(contours, probes, touched, platform),
        method=method,
        frame=frame,
        step=step,
    )
