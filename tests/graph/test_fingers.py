"""Several fingers at once: the same bytes, however their messages travel."""

from pathlib import Path

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.progress import Display
from palpate.launch.run import perform, plan_run
from palpate.messages.codec import decode, encode
from palpate.messages.recording.reader import open_recording
from palpate.messages.types.model import ShapeModel
from palpate.messages.types.motion import ContourGoal
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.runtime.composed import run_composed
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.replay.rerun import replay
from tests.graph.conftest import explore_heights

TOYS = Path(__file__).parent / "toys"
FILE, UNSCORED = TOYS / "fingers.yaml", TOYS / "unscored.yaml"
KINDS = (simulator, filter, curvature, tracer)
FINGERS = 3
NODES = ["planner", *(f"{kind}_{n}" for kind in ("simulator", "tracer") for n in (1, 2, 3))]
EACH = ("/touch/raw", "/touch/image", "/touch/patch", "/finger/goal", "/finger/clock")
Bodies = dict[str, list[bytes]]


def messages_in(run):
    """Every message of a run, by topic, in the order in which it was published."""
    found: Bodies = {}
    for kept in open_recording(run / "topics.mcap").messages():
        found.setdefault(kept.topic, []).append(kept.body)
    return found


@pytest.fixture(scope="module")
def composed(explored):
    """Recording of a run in one process, and what it holds."""
    run = explored(FINGERS)
    return run / "topics.mcap", messages_in(run)


@pytest.fixture(scope="module")
def alone(explored):
    """The same with one finger."""
    return messages_in(explored(1))


@pytest.fixture(autouse=True)
def _toys(monkeypatch):
    monkeypatch.syspath_prepend(str(TOYS.parent))


def wirings(out, fingers):
    args = {"fingers": SourceMapped(fingers, ""), "record": SourceMapped(False, "")}
    return describe(FILE, args, out).graph.wirings()


def of_topic(bodies, topic):
    """The messages of a topic."""
    kinds = {local: kind for one in KINDS for local, kind in one.NODE.outputs.items()}
    kind = kinds["/" + topic.split("/", 2)[-1] if topic.startswith("/finger_") else topic]
    return [decode(kind, body) for body in bodies[topic]]


def contours_of(bodies):
    topics = [topic for topic in bodies if topic.endswith("/contour/traced")]
    return [contour for topic in topics for contour in of_topic(bodies, topic)]


def test_every_finger_has_topics_of_its_own_and_the_rest_is_told_once(composed):
    _, bodies = composed
    for finger in range(1, FINGERS + 1):
        for topic in EACH:
            assert bodies[f"/finger_{finger}{topic}"], topic
    assert {topic for topic in bodies if not topic.startswith("/finger_")} == {
        *("/world", "/truth", "/touch/info", "/hand/goal", "/hand/contacts", "/contour/goal")
    }
    assert [len(bodies[topic]) for topic in ("/world", "/truth", "/touch/info")] == [1, 1, 1]


def test_the_fingers_share_out_the_heights_and_close_every_contour(composed):
    found = contours_of(composed[1])
    assert {contour.status for contour in found} == {"closed"}
    assert sorted(contour.id for contour in found) == list(range(5))
    assert {contour.finger for contour in found} == {1, 2, 3}


def test_what_a_finger_does_takes_no_time_of_the_others(composed, alone):
    ends = {1: max(contour.robot_time for contour in contours_of(alone))}
    ends[FINGERS] = max(contour.robot_time for contour in contours_of(composed[1]))
    # Five contours of much the same length: two, two and one of them.
    assert ends[FINGERS] < 0.6 * ends[1]


def test_every_finger_has_errors_and_a_clock_of_its_own(composed):
    first = [of_topic(composed[1], f"/finger_{n}/touch/raw")[0] for n in (1, 2, 3)]
    # They begin at heights that mirror each other on a ball, but not with the same noise.
    assert len({frame.array.tobytes() for frame in first}) == FINGERS
    assert [frame.finger for frame in first] == [1, 2, 3]
    for finger in range(1, FINGERS + 1):
        clocks = of_topic(composed[1], f"/finger_{finger}/finger/clock")
        patches = of_topic(composed[1], f"/finger_{finger}/touch/patch")
        times = [patch.robot_time for patch in patches]
        assert [clock.robot_time for clock in clocks] == times == sorted(times)
        assert {clock.finger for clock in clocks} == {finger}


def test_no_finger_starts_before_the_decision(composed):
    _, bodies = composed
    begun = {
        goal.id: goal.not_before
        for goal in (decode(ContourGoal, b) for b in bodies["/contour/goal"])
    }
    for finger in range(1, FINGERS + 1):
        for frame in of_topic(bodies, f"/finger_{finger}/touch/raw"):
            assert frame.robot_time > begun[frame.goal]
    # The first three at once, the others when a contour was taken up.
    assert len(set(begun.values())) == 1 + 2


def test_one_finger_has_neither_namespace_nor_clock(alone):
    assert not [topic for topic in alone if topic.startswith("/finger_")]
    assert "/finger/clock" not in alone
    assert len(alone["/contour/traced"]) == 5


@pytest.mark.parametrize(
    "schedules", [range(5), pytest.param(range(5, 20), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_no_order_of_the_edges_changes_a_byte(schedules, composed, tmp_path, watcher):
    graph = wirings(tmp_path, FINGERS)
    watch = tuple(topic for one in graph for topic in one.outputs.values())
    for schedule in schedules:
        watcher.messages.clear()
        ending = run_composed(
            graph, ends="planner", watch=watch, watcher=watcher, schedule=schedule
        )
        assert ending.status == "finished", ending.reason
        bodies: Bodies = {}
        for topic, message in watcher.messages:
            bodies.setdefault(topic, []).append(encode(message))
        assert bodies == composed[1]


@pytest.mark.graph
def test_separate_processes_publish_the_same_to_the_last_byte(composed, tmp_path):
    run = explore_heights(tmp_path / "run", FINGERS, composed=False)
    assert messages_in(run) == composed[1]
    assert compare_recordings(composed[0], run).first == ""
    assert replay(run / "topics.mcap", NODES, lambda line: None) == 0


@pytest.mark.slow
@pytest.mark.graph
def test_a_whole_exploration_is_the_same_in_processes_and_in_one(tmp_path):
    given = {"scene": "sphere", "fingers": 2, "count": 2}
    args = {name: SourceMapped(value, "") for name, value in given.items()}
    found = []
    for composed in (False, True):
        plan = plan_run(UNSCORED, args, {}, name="sphere", out=tmp_path / f"run_{composed}")
        run = perform(plan, composed=composed, display=Display())
        assert (run.ending.status, run.ending.gaps) == ("finished", 0), run.ending.reason
        found.append(messages_in(run.folder))
    assert found[0] == found[1]
    assert {contour.finger for contour in contours_of(found[0])} == {1, 2}
    assert decode(ShapeModel, found[0]["/model/shape"][-1]).final
