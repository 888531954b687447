"""At a rate, robot time passes no faster than it should, and the solid is the same."""

import pytest

from palpate import launch
from palpate.launch.files.source_map import SourceMapped
from palpate.messages.codec import decode
from palpate.messages.recording import open_recording
from palpate.messages.types import TactileFrame
from palpate.nodes.runtime.sources import RobotPace
from palpate.nodes.runtime.work import Outgoing

pytestmark = pytest.mark.graph
RATE = 60.0  # Robot time that passes in a second
FEW = {"planner.most_touches": SourceMapped(24, ""), "planner.planner": SourceMapped("uniform", "")}


def explored(folder, name, text, *, composed):
    file = folder / f"{name}.yaml"
    file.write_text(text)
    args = {"scene": SourceMapped("sphere", "")}
    plan = launch.plan_run(file, args, FEW, name=name, out=folder / name)
    return launch.perform(plan, composed=composed, display=launch.Display())


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pacing")
    return explored(folder, "quick", "include: explore.yaml\n", composed=True)


@pytest.mark.parametrize("composed", [True, False])
def test_frames_come_at_their_robot_time_and_the_solid_is_the_same(quick, tmp_path, composed):
    paced = f"include: explore.yaml\nrate: {RATE}\n"
    slow = explored(tmp_path, "slow", paced, composed=composed)
    assert slow.summary["mesh_sha256"] == quick.summary["mesh_sha256"]
    found = list(open_recording(tmp_path / "slow" / "topics.mcap").messages())
    began = next(one.sent_ns for one in found if one.topic == "/world")
    frames = [one for one in found if one.topic == "/touch/raw"]
    assert len(frames) == slow.summary["touches"]
    for one in frames:
        passed = 1e-9 * (one.sent_ns - began)
        assert passed >= decode(TactileFrame, one.body).robot_time / RATE


def test_a_pace_holds_back_until_the_robot_time():
    pace = RobotPace(2.0)
    pace.start(100.0)
    late = [Outgoing("/touch/raw", b"", 6.0, 0), Outgoing("/world", b"", 0.0, 0)]
    assert pace.wait(late, 101.0) == 2.0
    assert pace.wait(late, 104.0) == 0.0
    assert pace.wait([], 100.0) == 0.0


def test_a_pace_that_nobody_started_begins_with_what_it_is_told_first():
    pace = RobotPace(1.0)
    assert pace.wait([Outgoing("/touch/raw", b"", 50.0, 0)], 7.0) == 0.0
    assert pace.wait([Outgoing("/touch/raw", b"", 51.5, 0)], 8.0) == 0.5


@pytest.mark.parametrize("rate", ["0", "-1", "fast"])
def test_a_rate_that_cannot_be_is_refused_with_its_line(tmp_path, rate):
    file = tmp_path / "odd.yaml"
    file.write_text(f"include: explore.yaml\nrate: {rate}\n")
    with pytest.raises(launch.files.InputError, match=r"odd.yaml:2: rate"):
        launch.plan_run(file, {}, {}, name="odd", out=tmp_path / "odd")
