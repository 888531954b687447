import dataclasses

import pytest

from palpate.launch.exchange_rate import cost_curve, halving_lines, time_by_step
from palpate.launch.progress import Progress
from palpate.messages.types.catalogue import NodeStatus
from palpate.messages.types.model import PlanDone, PlanEstimate


def estimate(number, touches, bound, halving=None):
    return PlanEstimate(
        number=number,
        contours=number,
        touches=touches,
        robot_time=2.0 * touches,
        rms_bound_95=bound,
        largest_untouched=5e-3,
        halving_touches=halving,
        halving_seconds=None if halving is None else 3.0 * halving,
    )


@pytest.fixture
def scored(score):
    def scored(number, touches, rms):
        spent = {"contours": number, "touches": touches, "robot_time": 2.0 * touches}
        return dataclasses.replace(score, number=number, rms=rms, **spent)

    return scored


def progress(estimates, scores=(), **more):
    return Progress(
        estimates=[(1.0 * one.number, one) for one in estimates],
        scores=[(1.0 * one.number + 5.0, one) for one in scores],
        **more,
    )


def test_score_and_estimate_of_a_model_are_one_entry_at_the_time_of_the_model(scored):
    curve = cost_curve(
        progress(
            [estimate(2, 20, 1e-3), estimate(3, 40, 5e-4, 12.0)],
            [scored(2, 20, 8e-4)],
            made={2: 1.5},
            spent=[(1.0, 2.0), (3.0, 6.0)],
        ),
        None,
    )
    assert [one["rms_m"] for one in curve] == [8e-4, None]
    assert [one["rms_bound_95_m"] for one in curve] == [1e-3, 5e-4]
    assert [one["wall_s"] for one in curve] == [1.5, 3.0]
    assert [one["compute_s"] for one in curve] == [3.0, 6.0]
    assert [one["forecast"] for one in curve] == [None, {"touches": 12.0, "robot_time_s": 36.0}]
    assert curve[0]["largest_untouched_m"] == 5e-3


def test_what_halving_cost_stands_beside_what_was_foretold(scored):
    estimates = [estimate(2, 20, 1e-3, 30.0), estimate(3, 40, 9e-4, 10.0), estimate(4, 60, 1e-4)]
    curve = cost_curve(progress(estimates), None)
    assert [one["halved"] for one in curve] == [
        {"touches": 40, "robot_time_s": 80.0},
        {"touches": 20, "robot_time_s": 40.0},
        None,
    ]
    assert [one["ratio"] for one in curve] == [
        {"touches": 0.75, "robot_time_s": 1.125},
        {"touches": 0.5, "robot_time_s": 0.75},
        None,
    ]
    # The bound was foretold to halve, whatever the truth; and what the finer final mesh brings, or
    # a model of which nothing is stated, is no halving.
    scores = [scored(2, 20, 4e-4), scored(3, 40, 1e-4), scored(5, 60, 1e-5)]
    curve = cost_curve(progress([*estimates, estimate(5, 60, 4e-5)], scores), None)
    assert [one["halved"] and one["halved"]["touches"] for one in curve] == [40, 20, None, None]
    assert cost_curve(progress([], scores), None)[0]["halved"] is None


def test_a_robot_without_a_clock_has_no_ratio():
    told = [estimate(2, 20, 1e-3, 30.0), estimate(3, 40, 1e-4)]
    still = [dataclasses.replace(one, robot_time=0.0) for one in told]
    curve = cost_curve(progress(still), None)
    assert (curve[0]["halved"], curve[0]["ratio"]) == ({"touches": 20, "robot_time_s": 0.0}, None)


def test_the_last_entry_of_a_run_that_is_over_has_all_that_was_computed():
    done = PlanDone(
        number=3, contours=(), probes=(), touches=40, robot_time=80.0, reason="x", uncovered=0.0,
        reached=True, rms_bound_95=1e-4, largest_untouched=0.0,
    )  # fmt: skip
    told = [estimate(2, 20, 1e-3), estimate(3, 40, 1e-4)]
    spent = [(2.0, 1.0), (3.0, 2.0)]
    assert cost_curve(progress(told, spent=spent, done=done), 7.5)[-1]["compute_s"] == 7.5
    assert cost_curve(progress(told, spent=spent), 7.5)[-1]["compute_s"] == 2.0
    assert cost_curve(progress(told), None)[-1]["compute_s"] is None
    assert cost_curve(Progress(), 7.5) == []


def test_processor_time_is_added_up_by_steps_and_what_is_none_is_rest():
    def status(node, cpu, **steps):
        counts = dict.fromkeys(("messages", "sent", "gaps", "duplicates"), 0)
        times = {"p50": 0.0, "p99": 0.0, "cpu": cpu}
        return NodeStatus(node=node, state="ending", steps=steps, **times, **counts)

    found = time_by_step(
        {
            "simulator_1": status("simulator_1", 2.0, casting=1.5),
            "simulator_2": status("simulator_2", 1.5, casting=1.0),
            "reconstructor": status("reconstructor", 4.25, lattice=3.0, ends=1.25),
        }
    )
    assert list(found) == ["lattice", "casting", "ends", "rest"]
    assert list(found.values()) == [3.0, 2.5, 1.25, 1.0]
    assert time_by_step({}) == {}


def test_the_next_halving_is_foretold_in_words_and_the_last_told():
    estimates = [estimate(2, 20, 1e-3, 16.0), estimate(3, 40, 4e-4, 12.3)]
    assert halving_lines(cost_curve(progress(estimates), None)) == [
        "next halving of the bound: about 12 touches, 37 s",
        "last halving of the bound: foretold 16 touches, 48 s; took 20 touches, 40 s",
    ]
    assert halving_lines(cost_curve(progress([estimate(2, 20, 1e-3)]), None)) == [
        "no further slice halves the bound, as far as can be told"
    ]
    assert halving_lines([]) == []
