"""What the moves of a recorded run would have cost each robot."""

import json
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from palpate.core.poses import IDENTITY_POSE
from palpate.core.robot_time import ROBOTS, MoveGeometry, move_durations
from palpate.launch.files.source_map import InputError
from palpate.messages.types import ContourGoal, GraspContacts, ProbeGoal
from palpate.nodes.runtime.testing import example
from palpate.tools.cost import plot_cost, robot_time, robot_time_text
from tests.tools.recordings import frame

LIFTED = -1.0
PROBE, CONTOUR = 0, 1
# Wait, distance, turn, approach and slide of a probe and three touches of a contour.
ROWS = (
    (0.0, 0.0, 0.0, 0.05, LIFTED),
    (0.2, 0.04, 0.5, 0.02, LIFTED),
    (0.0, 0.01, 0.2, 0.004, 0.008),
    (0.0, 0.01, 0.2, 0.004, 0.009),
)
GOALS = (PROBE, CONTOUR, CONTOUR, CONTOUR)
PARTS = ("travel", "approach", "dwell", "retract", "wait")
TURNING, PRESSING = (0.0, 0.0, 3.0, 0.001, LIFTED), (0.0, 0.0, 0.0, 0.001, LIFTED)


def durations(rows, robot):
    """Time of each move by its parts [s]."""
    return move_durations(MoveGeometry.of_rows(np.array(rows)), ROBOTS[robot])


def ends(rows, robot="modern"):
    """Time at the end of each move [s]."""
    return np.cumsum(durations(rows, robot).total())


def frames(rows=ROWS, goals=GOALS, robot="modern", finger=1):
    """Frames whose times are made of their moves."""
    timed = zip(count(), rows, goals, ends(rows, robot), strict=False)
    return [
        frame(number, goal=goal, finger=finger, move=np.array(row), robot_time=float(end))
        for number, row, goal, end in timed
    ]


def goals(finger=1, contour=CONTOUR):
    probe = example(ProbeGoal, id=PROBE, finger=finger, pose=IDENTITY_POSE, reach=0.1)
    traced = example(ContourGoal, id=contour, finger=finger, frame=IDENTITY_POSE, radius=0.1)
    return [probe, traced]


OTHER = goals(2, 2)[1:]  # of the second finger


@pytest.fixture
def explored(record):
    """Writes messages as the recording of a run; the run's folder."""

    def write(*messages, robot="modern", **how):
        node = {"name": "simulator", "module": "palpate.nodes.simulator", "inputs": []}
        graph = json.dumps([{**node, "params": {"robot": robot}, "outputs": {}}])
        named = [(f"/x/{type(one).__name__}", one, seq) for seq, one in enumerate(messages)]
        about = {"graph": graph if robot else ""}
        return record(named, about=about, publisher="simulator", **how).parent

    return write


def test_time_of_each_robot_follows_from_its_moves(explored):
    costs = robot_time(explored(*goals(), *frames()))
    assert (costs["touches"], costs["closings"], costs["fingers"]) == (4, 0, 1)
    assert list(costs["robots"]) == list(ROBOTS)
    for name, cost in costs["robots"].items():
        parts = durations(ROWS, name)
        sums = {part: getattr(parts, part).sum() for part in PARTS}
        assert {part: cost[f"{part}_s"] for part in PARTS} == pytest.approx(sums)
        assert cost["total_s"] == pytest.approx(sum(sums.values()))
        assert cost["per_touch_s"] == pytest.approx(cost["total_s"] / 4)
        phases = cost["phases"]
        assert [phases[one]["moves"] for one in ("grasp", "contours", "probes")] == [0, 3, 1]
        assert phases["probes"]["total_s"] == pytest.approx(parts.total()[0])
        assert sum(one["total_s"] for one in phases.values()) == pytest.approx(cost["total_s"])


def test_moves_of_the_recorded_robot_add_up_to_its_time_unless_some_are_missing(explored):
    for robot in ("modern", "puma"):
        made = frames(robot=robot)
        costs = robot_time(explored(*goals(), made[0], *made, robot=robot))  # one frame came twice
        recorded = costs["recorded"]
        assert (recorded["agrees"], recorded["robot"], costs["touches"]) == (True, robot, 4)
        assert recorded["robot_time_s"] == made[-1].robot_time
    first, _, *rest = frames()
    costs = robot_time(explored(*goals(), first, *rest))
    lost = ends(ROWS)
    assert costs["recorded"]["missing_s"] == pytest.approx(lost[1] - lost[0])
    assert not costs["recorded"]["agrees"] and "its moves miss that by" in robot_time_text(costs)
    for robot in (None, "hydraulic"):
        costs = robot_time(explored(*goals(), *frames(), robot=robot))
        assert costs["recorded"]["agrees"] is None
        assert "cannot be checked" in robot_time_text(costs)
    costs = robot_time(explored(*goals(), *frames(), closed=False, sent=[0, 1, 2, 3, 4, 10**10]))
    assert not costs["complete"] and "never closed" in robot_time_text(costs)


def test_closings_of_the_hand_are_a_phase_and_no_touches(explored):
    grasp = (0.0, 0.0, 0.0, 0.06, LIFTED)
    times = ends([grasp, *ROWS])
    later = [replace(one, robot_time=float(t)) for one, t in zip(frames(), times[1:], strict=True)]
    closing = example(GraspContacts, move=np.array(grasp), robot_time=float(times[0]))
    costs = robot_time(explored(closing, *goals(), *later))
    assert (costs["touches"], costs["closings"], costs["recorded"]["agrees"]) == (4, 1, True)
    modern = costs["robots"]["modern"]
    assert modern["phases"]["grasp"]["total_s"] == pytest.approx(times[0])
    assert modern["per_touch_s"] == pytest.approx(times[-1] / 4)
    text = robot_time_text(costs)
    assert "4 touches, 1 closing of the hand" in text
    assert "grasp  contours    probes       all" in text


def test_several_fingers_take_as_long_as_the_slowest(explored):
    other = frames(ROWS[1:3], (2, 2), finger=2)
    costs = robot_time(explored(*goals(), *OTHER, *other, *frames()))
    assert (costs["fingers"], costs["touches"], costs["recorded"]["agrees"]) == (2, 6, True)
    for cost in costs["robots"].values():
        assert cost["slowest_finger"] == 1 and cost["finger_s"]["2"] < cost["finger_s"]["1"]
        assert cost["total_s"] == max(cost["finger_s"].values()) == cost["finger_s"]["1"]
        assert cost["per_touch_s"] == pytest.approx(cost["total_s"] / 6)
    assert "the table is of the slowest" in robot_time_text(costs)


def test_wait_for_another_finger_moves_with_it_unless_it_came_before(explored):
    first, second = ROWS[0], ROWS[2]
    for wait, is_awaited in ((float(ends(ROWS)[1]), True), (3.21, False)):
        waiting = frames([(wait, *first[1:]), second], (2, 2), finger=2)
        costs = robot_time(explored(*goals(), *OTHER, *waiting, *frames()))
        assert costs["recorded"]["agrees"]
        for name, cost in costs["robots"].items():
            begun = ends(ROWS, name)[1] if is_awaited else wait
            assert cost["finger_s"]["2"] == pytest.approx(begun + ends([first, second], name)[-1])
    # One finger turns and the other presses, at which another robot is slower.
    ready, other = ends([TURNING], "puma")[-1], ends([PRESSING] * 7, "puma")[-1]
    assert other > ready
    turned = frames([TURNING, (other - ready, *TURNING[1:])], (2, 2), "puma", finger=2)
    pressed = frames([PRESSING] * 7, [CONTOUR] * 7, "puma")
    cost = robot_time(explored(*goals(), *OTHER, *turned, *pressed, robot="puma"))
    modern, alone = cost["robots"]["modern"], ends([TURNING] * 2)
    assert modern["finger_s"]["1"] < alone[0]
    assert modern["finger_s"]["2"] == pytest.approx(alone[-1])


def test_recordings_that_tell_no_moves_are_refused(explored, tmp_path):
    unmoved = [replace(one, move=np.array([0, 0, 0, 0, LIFTED])) for one in frames()]
    for messages in ([*goals(), *unmoved], goals()):
        with pytest.raises(InputError, match="holds no moves of an arm"):
            robot_time(explored(*messages))
    (tmp_path / "text.mcap").write_text("no recording at all")
    odd = explored(b"\x80", types={"/x/bytes": "TactileFrame"})
    for path, names, words in (
        (tmp_path / "none", (), "the recording does not exist"),
        (tmp_path / "text.mcap", (), "is not an MCAP file"),
        (odd, (), "was recorded with other messages: not a TactileFrame"),
        (odd, ["pma"], "no robot 'pma'; did you mean 'puma'"),
    ):
        with pytest.raises(InputError, match=words):
            robot_time(path, names)


def test_cost_command_prints_table_or_json(explored, call):
    folder = explored(goals()[0], *frames())  # of three moves no goal is recorded
    code, text, _ = call("cost --robot puma --robot puma", folder)
    assert code == 0 and "its moves add up to that" in text
    [head] = [line for line in text.splitlines() if "puma, s" in line]
    assert head.split() == ["puma,", "s", "probes", "other", "all"]
    costs = json.loads(call("cost --json", folder / "topics.mcap").out)
    assert costs["recorded"]["agrees"]
    assert costs["robots"]["modern"]["phases"]["other"]["moves"] == 3


def test_cost_is_drawn_to_a_file_or_standard_output(here, call, refusal):
    nothing = dict.fromkeys(("scene", "compute_s", "largest_untouched_m", "sampling_floor_m"))
    counts = dict.fromkeys(("contours", "touches", "robot_time_s"), 0)
    lists = {"curve": [], "missed": [], "steps": {}, "nodes": {}, "status": "finished"}
    summary = here / "summary.json"  # of a run that came to nothing
    summary.write_text(json.dumps(nothing | counts | lists))
    for words, why in (
        ("--plot a.png", "a.png: must end in .svg"),
        ("--plot no/a.svg", "there is no folder"),
        ("--plot a.svg --json", "leave out --robot and --json"),
        ("--plot a.svg --robot puma", "leave out --robot and --json"),
    ):
        assert why in refusal(f"cost . {words}")
        assert [*here.iterdir()] == [summary]
    drawn = call("cost . --plot").out
    assert drawn.startswith("<svg")
    assert call("cost . --plot a.svg").code == 0
    assert (here / "a.svg").read_text() == drawn
    summary.write_text('{"curve": [{"touches": 3}]}')
    with pytest.raises(InputError, match="are not those of this version of palpate"):
        plot_cost(here, here / "b.svg")
