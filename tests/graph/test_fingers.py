"""Explorations with one or several fingers: the same bytes, however their messages travel."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.graph import override
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import EXPLORE
from palpate.launch.progress import Display
from palpate.launch.run import perform
from palpate.messages import decode, encode
from palpate.messages.bus import Consumed
from palpate.messages.recording import open_recording
from palpate.messages.types import ContourGoal
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.runtime import composed
from palpate.nodes.runtime.composed import Watcher
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.replay.rerun import past_differences, plan_resume, replay
from tests.graph.conftest import FEW, FINGERS, Harm, finished

pytestmark = pytest.mark.graph
SENSING = (simulator, filter, curvature, tracer)
TYPES = {local: kind for one in SENSING for local, kind in one.NODE.outputs.items()}
EACH = ("/touch/raw", "/touch/image", "/touch/patch", "/finger/goal", "/finger/clock")
Bodies = dict[str, list[bytes]]


def messages_in(run: Path) -> Bodies:
    """Every message of a run, by topic, in the order in which it was published."""
    bodies: Bodies = {}
    for kept in open_recording(run / "topics.mcap").messages():
        bodies.setdefault(kept.topic, []).append(kept.body)
    return bodies


def of_topic(bodies, topic):
    kind = TYPES["/" + topic.split("/", 2)[-1] if topic.startswith("/finger_") else topic]
    return [decode(kind, body) for body in bodies[topic]]


def contours_of(bodies):
    topics = [topic for topic in bodies if topic.endswith("/contour/traced")]
    return [contour for topic in topics for contour in of_topic(bodies, topic)]


def identical(a: Path, b: Path) -> bool:
    return all(one.identical for one in compare_recordings(a, b).topics.values())


@pytest.fixture(scope="module")
def three(explored) -> Bodies:
    return messages_in(explored(3))


def test_fingers_have_topics_of_their_own_and_share_contours_and_time(three, explored):
    for finger in (1, 2, 3):
        for topic in EACH:
            assert three[f"/finger_{finger}{topic}"], topic
    assert {topic for topic in three if not topic.startswith("/finger_")} == {
        *("/world", "/truth", "/touch/info", "/hand/goal", "/hand/contacts", "/contour/goal")
    }
    assert [len(three[topic]) for topic in ("/world", "/truth", "/touch/info")] == [1, 1, 1]
    alone = messages_in(explored(1))
    assert not [topic for topic in alone if topic.startswith("/finger_")]
    assert "/finger/clock" not in alone and len(alone["/contour/traced"]) == 5
    contours = contours_of(three)
    assert {contour.status for contour in contours} == {"closed"}
    assert sorted(contour.id for contour in contours) == list(range(5))
    assert {contour.finger for contour in contours} == {1, 2, 3}
    ends = [max(one.robot_time for one in contours_of(bodies)) for bodies in (three, alone)]
    assert ends[0] < 0.6 * ends[1]  # five contours of much the same length: two, two and one


def test_every_finger_has_its_own_errors_and_clock_and_awaits_the_decision(three):
    first = [of_topic(three, f"/finger_{n}/touch/raw")[0] for n in (1, 2, 3)]
    # They begin at heights that mirror each other on a ball, but not with the same noise.
    assert len({frame.array.tobytes() for frame in first}) == 3
    assert [frame.finger for frame in first] == [1, 2, 3]
    for finger in (1, 2, 3):
        clocks = of_topic(three, f"/finger_{finger}/finger/clock")
        times = [patch.robot_time for patch in of_topic(three, f"/finger_{finger}/touch/patch")]
        assert [clock.robot_time for clock in clocks] == times == sorted(times)
        assert {clock.finger for clock in clocks} == {finger}
    goals = [decode(ContourGoal, body) for body in three["/contour/goal"]]
    begun = {goal.id: goal.not_before for goal in goals}
    for finger in (1, 2, 3):
        for frame in of_topic(three, f"/finger_{finger}/touch/raw"):
            assert frame.robot_time > begun[frame.goal]
    assert len(set(begun.values())) == 1 + 2  # three at once, the others one after the other


class Keeping(Watcher):
    """Keeps the bytes of all messages, by topic."""

    def __init__(self) -> None:
        self.bodies: Bodies = {}

    def received(self, topic: str, message: object) -> None:
        self.bodies.setdefault(topic, []).append(encode(message))


def scheduled(folder, file, ends, args, draw):
    """All that a run in one process publishes, its edges drawn by a generator, if given."""
    args |= {"record": False}
    arguments = {name: SourceMapped(value, "") for name, value in args.items()}
    graph = describe(file, arguments, folder).graph
    few = FEW if file == EXPLORE else {}
    laid = {key: SourceMapped(value, "") for key, value in few.items()}
    wirings = override(graph, laid).wirings()
    watch = tuple(topic for one in wirings for topic in one.outputs.values())
    watcher, schedule = Keeping(), None if draw is None else 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(composed.random, "Random", lambda _: draw)
        ending = composed.run_composed(
            wirings, ends=ends, watch=watch, watcher=watcher, schedule=schedule
        )
    assert ending.status == "finished", ending.reason
    return watcher.bodies


class Preference(random.Random):
    """Draws edges to one node only when there are no others, or before all others."""

    def __init__(self, node: str, last: bool) -> None:
        super().__init__(0)
        self._node, self._last = node, last

    def choice(self, seq):
        preferred = [edge for edge in seq if (edge[1] == self._node) is not self._last]
        return super().choice(preferred or seq)


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 3))])
def test_no_order_of_handling_changes_a_byte(seed, three, tmp_path):
    draw = random.Random(seed)
    assert scheduled(tmp_path, FINGERS, "planner", {"fingers": 3}, draw) == three


@pytest.mark.slow
def test_no_order_changes_models_and_decisions(tmp_path):
    def bodies(draw):
        args = {"scene": "sphere", "fingers": 1}
        return scheduled(tmp_path, EXPLORE, "evaluator", args, draw)

    usual = bodies(None)
    assert len(usual["/score"]) == len(usual["/model/shape"]) > 1
    for draw in (Preference("planner", last=False), Preference("reconstructor", last=True)):
        assert bodies(draw) == usual


@pytest.mark.parametrize("fingers", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_replay_of_every_node_is_identical(fingers, explored):
    sensing = ("simulator", "tracer", "filter", "curvature")
    ends = [""] if fingers == 1 else [f"_{finger}" for finger in range(1, fingers + 1)]
    nodes = ["planner", *(f"{kind}{end}" for kind in sensing for end in ends)]
    lines: list[str] = []
    assert replay(explored(fingers) / "topics.mcap", nodes, lines.append) == 0
    assert sum("identical" in line for line in lines) == len(nodes)


@pytest.mark.parametrize(
    ("fingers", "names"),
    [
        (2, ["tracer_2", "planner"]),
        pytest.param(3, ["curvature_3", "filter_2", "recorder"], marks=pytest.mark.slow),
        pytest.param(3, ["", "", "simulator_1"], marks=pytest.mark.slow),
    ],
)
def test_exploration_survives_killed_nodes(fingers, names, explored, tmp_path):
    harm = Harm(names, signal.SIGKILL, seed=fingers)
    out = tmp_path / "killed"
    run = finished(FINGERS, out, {"fingers": fingers}, {}, composed=False)
    assert harm.count and sum(run.ending.restarts.values())
    assert identical(explored(fingers), out)


def resumed(bag, contour, out):
    plan = plan_resume(bag, contour, nodes=("planner",), out=out)
    assert plan.before is not None
    run = perform(plan, composed=False, display=Display())
    assert (run.ending.status, run.ending.gaps) == ("finished", 0), run.ending.reason
    return out


@pytest.mark.parametrize(
    ("fingers", "contour"),
    [(1, 4), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((1, 1), (3, 2)))],
)
def test_resume_from_any_contour_gives_the_same_end(fingers, contour, explored, tmp_path):
    again = resumed(explored(fingers), contour, tmp_path / "again")
    assert identical(explored(fingers), again)
    assert past_differences(explored(fingers), again) == ""


@pytest.mark.slow
def test_recording_that_was_never_closed_is_resumed_with_causes_before_effects(explored, tmp_path):
    data, place = (explored(3) / "topics.mcap").read_bytes(), 8
    while place < len(data) // 2:  # up to the end of a record past its middle
        place += 9 + int.from_bytes(data[place + 1 : place + 9], "little")
    cut = tmp_path / "topics.mcap"
    cut.write_bytes(data[:place])
    assert not open_recording(cut).closed
    again = resumed(cut, None, tmp_path / "again")
    assert identical(explored(3), again)
    # Each touch is first sent as a frame, then as an image, then as a patch; no message twice.
    numbers: dict[str, list[int]] = {}
    sent: dict[tuple[str, int, int], dict[str, int]] = {}
    for kept in open_recording(again / "topics.mcap").messages():
        numbers.setdefault(kept.topic, []).append(kept.seq)
        _, finger, *rest = kept.topic.split("/", 2)
        topic = "/" + "".join(rest)
        if topic.startswith("/touch/"):
            message = decode(TYPES[topic], kept.body)
            times = sent.setdefault((finger, message.goal, message.touch), {})
            times.setdefault(topic, kept.sent_ns)
    assert all(found == list(range(len(found))) for found in numbers.values())
    for times in sent.values():
        chain = [times[f"/touch/{name}"] for name in ("raw", "image", "patch")]
        assert chain == sorted(chain)


def test_resume_consumes_only_what_was_sent_before_a_contour_that_must_be_there(explored, tmp_path):
    plan = plan_resume(explored(1), 2, nodes=("planner",), out=tmp_path / "again")
    assert plan.before is not None
    traced = [one for one in plan.before.consumed["planner"] if one.topic == "/contour/traced"]
    assert traced == [Consumed("tracer", "/contour/traced", seq) for seq in range(2)]
    assert plan.before.consumed["recorder"] == []
    assert not (tmp_path / "again").exists()
    with pytest.raises(ValueError, match="has 5 contours, so none to resume after 9"):
        plan_resume(explored(1), 9, nodes=("planner",), out=tmp_path / "again")
    with pytest.raises(ValueError, match=r"wants module 'palpate_toy_heights' for"):
        plan_resume(explored(1), None, out=tmp_path / "again")
    assert "/world (1 of 1)" in past_differences(explored(1), explored(3))
