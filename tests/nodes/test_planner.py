from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.frames import IDENTITY
from palpate.messages.codec import encode
from palpate.messages.types import Contour, ContourGoal, Probe, ProbeGoal, SensorInfo, World
from palpate.nodes.planner import (
    Params,
    State,
    know_sensor,
    know_world,
    start,
    take_contour,
    take_probe,
)

TOP = 0.1


@pytest.fixture
def looking(info: SensorInfo, world: World) -> tuple[State, ProbeGoal]:
    """A planner that has asked for its first touch from above."""
    state, _ = know_sensor(Params(), start(Params())[0], info)
    state, [(topic, goal)] = know_world(Params(), state, world)  # type: ignore[misc]
    assert topic == "/probe/goal"
    assert isinstance(goal, ProbeGoal)
    return state, goal


def probe(goal: ProbeGoal, outcome: Any = "hit", height: float = TOP) -> Probe:
    point = np.array([*goal.pose[:2], height])
    up = np.array([0.0, 0.0, 1.0])
    return Probe(
        id=goal.id,
        finger=1,
        outcome=outcome,
        point=point,
        normal=up,
        touches=1,
        robot_time=float(goal.id + 1),
    )


def contour(goal: ContourGoal, status: Any = "closed", radius: float = 0.03) -> Contour:
    turn = 2 * np.pi * np.arange(90) / 90
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(90)])
    points = rim * radius + [0.0, 0.0, goal.height]
    return Contour(
        id=goal.id,
        finger=1,
        frame=IDENTITY,
        height=goal.height,
        points=points,
        normals=rim,
        curvature=np.zeros(90),
        status=status,
        gap_starts=np.zeros((0, 3)),
        gap_ends=np.zeros((0, 3)),
        gap_whys=(),
        felt_low=np.zeros(0),
        felt_high=np.zeros(0),
        touches=20,
        robot_time=float(goal.id + 1),
    )


def explored(
    params: Params, state: State, goal: ProbeGoal, answer: Any = contour
) -> list[tuple[str, Any]]:
    """Everything that the planner says when each goal is answered at once."""
    said: list[tuple[str, Any]] = []
    waiting: list[Any] = [goal]
    while waiting:
        asked = waiting.pop(0)
        if isinstance(asked, ProbeGoal):
            state, outputs = take_probe(params, state, probe(asked))
        else:
            state, outputs = take_contour(params, state, answer(asked))
        said += outputs  # type: ignore[arg-type]
        waiting += [m for _, m in outputs if isinstance(m, (ProbeGoal, ContourGoal))]  # type: ignore
    return said


def of(said: list[tuple[str, Any]], topic: str) -> list[Any]:
    return [message for heard, message in said if heard == topic]


def test_it_looks_from_above_first(looking: tuple[State, ProbeGoal], world: World) -> None:
    _, goal = looking
    assert goal.pose[:2] == pytest.approx([0.0, 0.0])
    assert goal.pose[2] > world.platform + world.reach
    assert goal.reach > world.reach


def test_it_looks_elsewhere_after_a_miss_and_says_so_in_the_end(
    looking: tuple[State, ProbeGoal],
) -> None:
    state, goal = looking
    places = {tuple(goal.pose[:2])}
    outputs: Any = [("/probe/goal", goal)]
    while outputs[0][0] == "/probe/goal":
        state, outputs = take_probe(Params(), state, probe(outputs[0][1], "miss", 0.0))
        if outputs[0][0] == "/probe/goal":
            places.add(tuple(outputs[0][1].pose[:2]))
    [(topic, done)] = outputs
    assert len(places) > 400  # rings a pad apart, as far as the finger reaches
    assert (topic, done.reason, done.contours) == (
        "/plan/done",
        "nothing was felt from above",
        (),
    )


def test_slices_go_from_the_middle_up_and_then_down(looking: tuple[State, ProbeGoal]) -> None:
    said = explored(Params(contours=5), *looking)
    heights = [goal.height for goal in of(said, "/contour/goal")]
    assert heights[0] == pytest.approx(0.5 * TOP)
    assert heights == sorted(heights[:3]) + sorted(heights[3:], reverse=True)
    assert np.ptp(np.diff(sorted(heights))) < 1e-12
    assert min(heights) > 0.0
    assert max(heights) < TOP


def test_every_contour_brings_a_model_with_all_so_far(looking: tuple[State, ProbeGoal]) -> None:
    said = explored(Params(contours=4), *looking)
    goals = of(said, "/model/goal")
    assert [goal.number for goal in goals] == [0, 1, 2, 3] or [g.number for g in goals] == [
        1,
        2,
        3,
        4,
    ]
    assert [len(goal.contours) for goal in goals] == [1, 2, 3, 4]
    assert [goal.touches for goal in goals] == [21, 41, 61, 81]


def test_the_end_names_all_contours_and_all_touches_from_above(
    looking: tuple[State, ProbeGoal],
) -> None:
    said = explored(Params(contours=4), *looking)
    [done] = of(said, "/plan/done")
    assert said[-1][1] is done
    assert len(done.contours) == 4
    assert len(done.probes) == 5
    assert done.touches == 4 * 20 + 5
    assert done.uncovered == pytest.approx(0.0, abs=1e-12)
    assert encode(done)


def test_goals_have_one_series_of_numbers(looking: tuple[State, ProbeGoal]) -> None:
    said = explored(Params(contours=4), *looking)
    numbers = [m.id for t, m in said if t in ("/contour/goal", "/probe/goal")]
    assert numbers == list(range(1, len(numbers) + 1))


def test_a_slice_that_fails_is_tried_once_more_nearer_to_the_middle(
    looking: tuple[State, ProbeGoal],
) -> None:
    tried: list[float] = []

    def fails_at_the_top(goal: ContourGoal) -> Contour:
        tried.append(goal.height)
        return contour(goal, "stuck" if goal.height > 0.08 else "closed")

    said = explored(Params(contours=5), *looking, fails_at_the_top)
    first, second = (height for height in tried if height > 0.08)
    assert 0.08 < second < first
    [done] = of(said, "/plan/done")
    assert len(done.contours) == 4
    assert done.uncovered > 0.0


def test_without_a_closed_contour_the_end_says_so(looking: tuple[State, ProbeGoal]) -> None:
    said = explored(Params(contours=3), *looking, lambda goal: contour(goal, "pole"))
    [done] = of(said, "/plan/done")
    assert (done.reason, done.contours) == ("no contour could be closed", ())


def test_a_narrow_top_is_not_touched_again(looking: tuple[State, ProbeGoal]) -> None:
    said = explored(Params(contours=3), *looking, lambda goal: contour(goal, radius=0.004))
    [done] = of(said, "/plan/done")
    assert len(done.probes) == 1


def test_the_next_slice_is_approached_from_outside_the_widest_contour(
    looking: tuple[State, ProbeGoal],
) -> None:
    said = explored(Params(contours=3), *looking)
    later = of(said, "/contour/goal")[1:]
    assert all(goal.radius > 0.03 + 0.02 for goal in later)


def test_a_top_felt_beside_the_middle_is_felt_again_over_it(
    looking: tuple[State, ProbeGoal],
) -> None:
    def aside(goal: ContourGoal) -> Contour:
        return replace(contour(goal), points=contour(goal).points + [0.02, 0.0, 0.0])

    state, goal = looking
    state, [(_, first)] = take_probe(Params(contours=3), state, probe(goal, height=0.08))  # type: ignore
    state, outputs = take_contour(Params(contours=3), state, aside(first))
    [again] = of(outputs, "/probe/goal")  # type: ignore[arg-type]
    assert again.pose[:2] == pytest.approx([0.02, 0.0], abs=1e-6)
    state, [(_, following)] = take_probe(Params(contours=3), state, probe(again))  # type: ignore
    # The true top is higher: all slices are planned anew.
    assert following.height == pytest.approx(0.5 * TOP)


def test_the_end_counts_the_slices_that_failed(looking: tuple[State, ProbeGoal]) -> None:
    answer = lambda goal: contour(goal, "stuck" if goal.height > 0.08 else "closed")  # noqa: E731
    [done] = of(explored(Params(contours=5), *looking, answer), "/plan/done")
    assert done.reason == "4 of 5 slices are traced, the others failed"
