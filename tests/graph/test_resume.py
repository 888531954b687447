"""Explorations that go on from their recording, or go on though nodes are killed."""

import signal
from pathlib import Path

import pytest

from palpate.launch.progress import Display
from palpate.launch.run import perform
from palpate.messages.bus.message_log import Consumed
from palpate.messages.recording.reader import open_recording
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.chaos.history import causality_violations, read_history, violations_in
from palpate.tools.replay.rerun import past_differences, plan_resume
from tests.graph.conftest import explore_heights
from tests.graph.test_restarts import Harm

pytestmark = pytest.mark.graph
TOYS = Path(__file__).parent / "toys"


@pytest.fixture(scope="module", autouse=True)
def _toys():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOYS.parent))
        yield


@pytest.fixture(scope="module")
def alone(explored):
    return explored(1)


@pytest.fixture(scope="module")
def three(explored):
    return explored(3)


def gone_on(bag, contour, out):
    plan = plan_resume(bag, contour, nodes=("planner",), out=out)
    assert plan.before is not None
    run = perform(plan, composed=False, display=Display())
    assert (run.ending.status, run.ending.gaps) == ("finished", 0), run.ending.reason
    return out


def identical(a, b):
    return all(one.identical for one in compare_recordings(a, b).topics.values())


@pytest.mark.parametrize("contour", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_a_finger_goes_on_from_any_contour_to_the_same_end(contour, alone, tmp_path):
    again = gone_on(alone, contour, tmp_path / "again")
    assert identical(alone, again)
    assert past_differences(alone, again) == ""


def test_three_fingers_go_on_to_the_same_end(three, tmp_path):
    assert identical(three, gone_on(three, 2, tmp_path / "again"))


def test_a_recording_that_was_never_closed_is_gone_on_with_cause_before_effect(three, tmp_path):
    cut = tmp_path / "topics.mcap"
    cut.write_bytes(whole_records((three / "topics.mcap").read_bytes()))
    assert not open_recording(cut).closed
    again = gone_on(cut, None, tmp_path / "again")
    assert identical(three, again)
    history = read_history(again / "topics.mcap")
    assert [*violations_in(history), *causality_violations(history, whole=True)] == []


def whole_records(data):
    """The beginning of a recording, up to the end of a record past its middle."""
    place = 8
    while place < len(data) // 2:
        place += 9 + int.from_bytes(data[place + 1 : place + 9], "little")
    return data[:place]


def test_only_what_was_sent_before_the_contour_is_known(alone, tmp_path):
    plan = plan_resume(alone, 2, nodes=("planner",), out=tmp_path / "again")
    assert plan.before is not None
    traced = [one for one in plan.before.consumed["planner"] if one.topic == "/contour/traced"]
    assert traced == [Consumed("tracer", "/contour/traced", seq) for seq in range(2)]
    assert plan.before.consumed["recorder"] == []
    assert not (tmp_path / "again").exists()


def test_what_cannot_be_gone_on_from_is_refused(alone, tmp_path):
    with pytest.raises(ValueError, match="has 5 contours, so none to go on from after 9"):
        plan_resume(alone, 9, nodes=("planner",), out=tmp_path / "again")
    with pytest.raises(ValueError, match=r"wants module 'toys.palpate_toy_heights' for"):
        plan_resume(alone, None, out=tmp_path / "again")


def test_another_past_is_told(alone, three):
    assert "/world (1 of 1)" in past_differences(alone, three)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_three_fingers_whose_nodes_are_killed_come_to_the_same_end(seed, three, tmp_path):
    names = [["tracer_2", "simulator_1", "planner"], ["curvature_3", "filter_2", "recorder"]]
    harm = Harm(names[seed - 1], signal.SIGKILL, seed)
    harm.start()
    killed = explore_heights(tmp_path / "killed", 3, composed=False, killed=True)
    assert harm.when
    assert identical(three, killed)
