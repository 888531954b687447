import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.core.poses import IDENTITY_POSE
from palpate.core.robot_time import ROBOTS, MoveGeometry, elapsed_seconds, move_durations
from palpate.launch.files.source_map import InputError
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.motion import ContourGoal, GraspContacts, ProbeGoal
from palpate.messages.types.touch import TactileFrame
from palpate.tools.cli import command_line as cli
from palpate.tools.cost import PARTS, plot_cost, read_moves, robot_time, robot_time_text

LIFTED = -1.0
UP = np.array([0.0, 0.0, 1.0])
PROBE, CONTOUR = 0, 1
# A probe and three touches of a contour.
ROWS = (
    (0.0, 0.0, 0.0, 0.05, LIFTED),
    (0.2, 0.04, 0.5, 0.02, LIFTED),
    (0.0, 0.01, 0.2, 0.004, 0.008),
    (0.0, 0.01, 0.2, 0.004, 0.009),
)
GOALS = (PROBE, CONTOUR, CONTOUR, CONTOUR)


def frames(rows=ROWS, goals=GOALS, robot="modern", finger=1):
    """Frames whose times are made of their moves."""
    ends = elapsed_seconds(MoveGeometry.of_rows(np.array(rows)), ROBOTS[robot])
    return [
        TactileFrame(
            goal=goal, touch=number, finger=finger, direction=UP, pose=IDENTITY_POSE, outcome="hit",
            array=np.zeros((4, 4)), move=np.array(row), robot_time=float(end),
        )
        for number, (row, goal, end) in enumerate(zip(rows, goals, ends, strict=True))
    ]  # fmt: skip


def goals(finger=1, contour=CONTOUR):
    asked: Any = {"finger": finger, "not_before": 0.0}
    return [
        ProbeGoal(id=PROBE, pose=IDENTITY_POSE, reach=0.1, **asked),
        ContourGoal(
            id=contour, frame=IDENTITY_POSE, height=0.04, centre=np.zeros(2), radius=0.1, **asked
        ),
    ]


def closing(end):
    none = np.zeros((0, 3))
    return GraspContacts(
        number=0, points=none, normals=none, fingers=np.zeros(0, np.int32), missed=4, blocked=0,
        move=np.array([0.0, 0.0, 0.0, 0.06, LIFTED]), robot_time=end,
    )  # fmt: skip


def graph(robot):
    node = {"name": "simulator", "module": "palpate.nodes.simulator", "params": {"robot": robot}}
    return json.dumps([{**node, "inputs": [], "outputs": {}}])


@pytest.fixture
def record(tmp_path):
    """Writes messages as a run's recording; gives the run's folder."""
    writers = list[RecordingWriter]()

    def write(*messages, robot="modern", close=True):
        topics = {kind.__name__: f"/x/{kind.__name__}" for kind in map(type, messages)}
        writer = RecordingWriter(
            tmp_path / "topics.mcap",
            {topic: name for name, topic in topics.items()},
            dict.fromkeys(topics.values(), "simulator"),
            {"version": "1.2.3", "graph": "" if robot is None else graph(robot)},
        )
        for i, message in enumerate(messages):
            header = Header(7, 0, i, i, 0.0, schema_hash(type(message)))
            writer.write(topics[type(message).__name__], header, encode(message))
        if close:
            writer.close()
        else:
            writer._open_writer().flush()
        writers.append(writer)
        return tmp_path

    yield write
    for writer in writers:
        writer.close()


def test_each_robots_time_is_that_of_its_moves_phase_by_phase(record):
    found = robot_time(record(*goals(), *frames()))
    assert list(found["robots"]) == list(ROBOTS)
    assert (found["touches"], found["closings"], found["fingers"]) == (4, 0, 1)
    made = MoveGeometry.of_rows(np.array(ROWS))
    for name, robot in ROBOTS.items():
        cost, each = found["robots"][name], move_durations(made, robot)
        for part in PARTS:
            assert cost[f"{part}_s"] == pytest.approx(getattr(each, part).sum())
        assert cost["total_s"] == pytest.approx(elapsed_seconds(made, robot)[-1])
        assert cost["per_touch_s"] == pytest.approx(cost["total_s"] / 4)
        phases = cost["phases"]
        assert [phases[one]["moves"] for one in ("grasp", "contours", "probes")] == [0, 3, 1]
        assert phases["probes"]["total_s"] == pytest.approx(each.total()[0])
        assert sum(one["total_s"] for one in phases.values()) == pytest.approx(cost["total_s"])
        assert sum(cost[f"{part}_s"] for part in PARTS) == pytest.approx(cost["total_s"])


@pytest.mark.parametrize("robot", ["modern", "puma"])
def test_the_moves_of_the_robot_that_was_recorded_add_up_to_the_recorded_time(record, robot):
    made = frames(robot=robot)
    recorded = robot_time(record(*goals(), *made, robot=robot))["recorded"]
    assert recorded["agrees"] is True
    assert recorded["robot"] == robot
    assert recorded["robot_time_s"] == made[-1].robot_time


def test_a_move_that_the_recording_lacks_is_told(record):
    first, _, *rest = frames()
    found = robot_time(record(*goals(), first, *rest))
    assert found["recorded"]["agrees"] is False
    lost = elapsed_seconds(MoveGeometry.of_rows(np.array(ROWS)), ROBOTS["modern"])
    assert found["recorded"]["missing_s"] == pytest.approx(lost[1] - lost[0])
    assert "its moves miss that by" in robot_time_text(found)


@pytest.mark.parametrize("robot", [None, "hydraulic"])
def test_a_robot_that_is_not_known_cannot_be_checked_and_that_is_told(record, robot):
    found = robot_time(record(*goals(), *frames(), robot=robot))
    assert found["recorded"]["agrees"] is None
    assert "cannot be checked" in robot_time_text(found)


def test_a_frame_that_came_twice_is_one_move(record):
    made = frames()
    found = robot_time(record(*goals(), made[0], made[0], *made[1:]))
    assert found["touches"] == 4
    assert found["recorded"]["agrees"] is True


def test_closings_of_the_hand_are_a_phase_and_no_touches(record):
    grasp = (0.0, 0.0, 0.0, 0.06, LIFTED)
    ends = elapsed_seconds(MoveGeometry.of_rows(np.array([grasp, *ROWS])), ROBOTS["modern"])
    later = [
        replace(one, robot_time=float(end)) for one, end in zip(frames(), ends[1:], strict=True)
    ]
    found = robot_time(record(closing(float(ends[0])), *goals(), *later))
    assert (found["touches"], found["closings"]) == (4, 1)
    assert found["recorded"]["agrees"] is True
    modern = found["robots"]["modern"]
    assert modern["phases"]["grasp"]["total_s"] == pytest.approx(ends[0])
    assert modern["per_touch_s"] == pytest.approx(ends[-1] / 4)
    text = robot_time_text(found)
    assert "4 touches, 1 closing of the hand" in text
    assert "grasp  contours    probes       all" in text


def test_several_fingers_take_as_long_as_the_slowest(record):
    other = frames(ROWS[1:3], (2, 2), finger=2)
    found = robot_time(record(*goals(), *goals(2, 2)[1:], *other, *frames()))
    assert (found["fingers"], found["touches"]) == (2, 6)
    assert found["recorded"]["agrees"] is True
    for cost in found["robots"].values():
        assert cost["slowest_finger"] == 1
        assert cost["total_s"] == max(cost["finger_s"].values()) == cost["finger_s"]["1"]
        assert cost["finger_s"]["2"] < cost["finger_s"]["1"]
        assert cost["per_touch_s"] == pytest.approx(cost["total_s"] / 6)
    assert "the table is of the slowest" in robot_time_text(found)


def waiting(wait):
    """Two moves of a second finger, before the first of which it waits."""
    first, second = ROWS[0], ROWS[2]
    return frames([(wait, *first[1:]), second], (2, 2), finger=2)


@pytest.mark.parametrize("name", ROBOTS)
def test_who_waited_for_another_finger_waits_until_that_has_come_as_far(record, name):
    made = MoveGeometry.of_rows(np.array(ROWS))
    wait = float(elapsed_seconds(made, ROBOTS["modern"])[1])
    found = robot_time(record(*goals(), *goals(2, 2)[1:], *waiting(wait), *frames()))
    assert found["recorded"]["agrees"] is True
    alone = MoveGeometry.of_rows(np.array([ROWS[0], ROWS[2]]))
    robot = ROBOTS[name]
    ends = elapsed_seconds(made, robot)[1] + elapsed_seconds(alone, robot)
    assert found["robots"][name]["finger_s"]["2"] == pytest.approx(ends[-1])


def test_who_waited_for_something_else_waits_as_long(record):
    found = robot_time(record(*goals(), *goals(2, 2)[1:], *waiting(3.21), *frames()))
    alone = MoveGeometry.of_rows(np.array([ROWS[0], ROWS[2]]))
    for name, cost in found["robots"].items():
        assert cost["finger_s"]["2"] == pytest.approx(
            3.21 + elapsed_seconds(alone, ROBOTS[name])[-1]
        )


def test_nobody_waits_for_who_was_there_before(record):
    """Turning is what the first finger does, and pressing the other: a puma is slower at that."""
    turning, pressing = (0.0, 0.0, 3.0, 0.001, LIFTED), (0.0, 0.0, 0.0, 0.001, LIFTED)
    ready, other = (
        float(elapsed_seconds(MoveGeometry.of_rows(np.array(rows)), ROBOTS["puma"])[-1])
        for rows in ([turning], [pressing] * 7)
    )
    assert other > ready
    turned = frames([turning, (other - ready, *turning[1:])], (2, 2), "puma", finger=2)
    pressed = frames([pressing] * 7, [CONTOUR] * 7, "puma")
    folder = record(*goals(), *goals(2, 2)[1:], *turned, *pressed, robot="puma")
    cost = robot_time(folder)["robots"]["modern"]
    alone = elapsed_seconds(MoveGeometry.of_rows(np.array([turning] * 2)), ROBOTS["modern"])
    assert cost["finger_s"]["1"] < alone[0]
    assert cost["finger_s"]["2"] == pytest.approx(alone[-1])


def test_moves_for_which_no_goal_was_recorded_are_a_phase_of_their_own(record):
    found = robot_time(record(goals()[0], *frames()))
    assert found["robots"]["modern"]["phases"]["other"]["moves"] == 3
    assert "probes     other       all" in robot_time_text(found)


def test_a_recording_that_was_never_closed_is_told(record):
    found = robot_time(record(*goals(), *frames(), close=False))
    assert found["complete"] is False
    assert "never closed" in robot_time_text(found)


def test_only_the_robots_that_are_named_are_told_and_each_once(record):
    found = robot_time(record(*goals(), *frames()), ["puma", "puma"])
    assert list(found["robots"]) == ["puma"]


def test_the_file_and_its_folder_are_the_same_recording(record):
    folder = record(*goals(), *frames())
    assert read_moves(folder).path == read_moves(folder / "topics.mcap").path


def test_what_tells_no_moves_is_refused(record, tmp_path):
    unmoved = [replace(one, move=np.array([0, 0, 0, 0, LIFTED])) for one in frames()]
    with pytest.raises(InputError, match="holds no moves of an arm"):
        read_moves(record(*goals(), *unmoved))
    with pytest.raises(InputError, match="the recording does not exist"):
        read_moves(tmp_path / "none")
    (tmp_path / "text.mcap").write_text("no recording at all")
    with pytest.raises(InputError, match="is not an MCAP file"):
        read_moves(tmp_path / "text.mcap")


def test_a_recording_without_a_touch_is_refused(record):
    with pytest.raises(InputError, match="holds no moves of an arm"):
        read_moves(record(*goals()))


def test_a_recording_of_other_messages_is_refused(record, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.tools.cost.KINDS", {"TactileFrame": GraspContacts})
    with pytest.raises(InputError, match="was recorded with other messages: not a GraspContacts"):
        read_moves(record(*frames()))


def test_an_unknown_robot_is_refused_with_what_was_meant(tmp_path):
    with pytest.raises(InputError, match="no robot 'pma'; did you mean 'puma'"):
        robot_time(tmp_path, ["pma"])


def test_the_verb_prints_the_table_or_json(record, capsys):
    folder = str(record(*goals(), *frames()))
    assert cli.run(["cost", folder, "--robot", "puma"]) == 0
    text = capsys.readouterr().out
    assert "its moves add up to that" in text
    assert "puma, s       contours    probes       all" in text
    assert cli.run(["cost", folder, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recorded"]["agrees"] is True
    assert cli.run(["cost", "none"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.fixture
def explored(tmp_path):
    """The directory of a run that came to nothing."""
    nothing = dict.fromkeys(("scene", "compute_s", "largest_untouched_m", "sampling_floor_m"))
    counts = dict.fromkeys(("contours", "touches", "robot_time_s"), 0)
    lists = {"curve": [], "missed": [], "steps": {}, "nodes": {}, "status": "finished"}
    (tmp_path / "summary.json").write_text(json.dumps(nothing | counts | lists))
    return tmp_path


def test_what_accuracy_cost_is_drawn_to_a_file_or_to_standard_output(explored, capsys):
    assert cli.run(["cost", str(explored), "--plot"]) == 0
    drawn = capsys.readouterr().out
    assert drawn.startswith("<svg")
    assert cli.run(["cost", str(explored), "--plot", str(explored / "a.svg")]) == 0
    assert (explored / "a.svg").read_text() == drawn


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--plot", "a.png"], "a.png: must end in .svg"),
        (["--plot", "no/a.svg"], "there is no folder"),
        (["--plot", "a.svg", "--json"], "leave out --robot and --json"),
        (["--plot", "a.svg", "--robot", "puma"], "leave out --robot and --json"),
    ],
)
def test_a_picture_that_cannot_be_drawn_is_one_sentence(explored, capsys, monkeypatch, words, why):
    monkeypatch.chdir(explored)
    assert cli.run(["cost", ".", *words]) == 2
    err = capsys.readouterr().err
    assert why in err
    assert err.count("\n") == 1
    assert [path.name for path in explored.iterdir()] == ["summary.json"]


def test_figures_of_another_version_are_refused(tmp_path):
    (tmp_path / "summary.json").write_text('{"curve": [{"touches": 3}]}')
    with pytest.raises(InputError, match="are not those of this version of palpate"):
        plot_cost(tmp_path, Path("-"))
    with pytest.raises(InputError, match=r"there is no summary\.json in it"):
        plot_cost(tmp_path / "none", Path("-"))
