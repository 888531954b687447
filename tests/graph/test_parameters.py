"""A graph whose parameters are set and whose node dies: recorded, replayed, resumed; its pace."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.processes.registry import running_graphs
from palpate.launch.run_directory import read_summary
from palpate.messages import decode
from palpate.messages.recording import open_recording
from palpate.messages.types import ParameterEvent, TactileFrame, TactileImage
from palpate.nodes.runtime.testing import recorded
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.introspection.descriptions import set_parameter
from palpate.tools.introspection.requests import publish, request
from tests.graph.conftest import FINGERS, WITHIN, finished, handled, palpate, started, wait_for

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
SAID = """{param: order, value: '"none"', topic: /touch/raw, after: 0}"""  # By no node
ESTIMATE = (
    "{number: 0, contours: 0, touches: 0, robot_time: 0, rms_bound_95: null, "
    "largest_untouched: 1, halving_touches: null, halving_seconds: null, open_share: null, "
    "open_width: null}"
)
REFUSED = (
    ("axis", "true", r"planner\.axis cannot be set while it runs"),
    ("tolerance", "0.1um", r"planner: tolerance is 1e-07 m; it must be at least the resolution"),
    ("tolerance", "0.1s", r"tolerance 0\.1s: the unit 's' is none of m, cm, mm, um"),
    ("tolerance", "2", r"tolerance cannot be 2: .*<= 1\.0"),
    ("most_seconds", "10ms", r"the unit 'ms' is none of s, min, h"),
    ("most_touches", "0", r"most_touches cannot be 0"),
)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory) -> Path:
    """A run whose filter was set, killed, and set once more; recorded from outside as well."""
    folder = tmp_path_factory.mktemp("tuned")
    out, outside = folder / "run", folder / "o.mcap"
    draft = ("--set", "reconstructor.quality=draft", "--quiet", "--out", out)
    with started("run", "vase", "--tolerance", "0.1mm", *draft) as process:
        try:
            card = wait_for(running_graphs)[0]
            wait_for(lambda: handled(card, "filter") > 10)
            done = set_parameter(card, "filter", "contact", "1.0e-4")
            assert done.endswith("5.0e-05 -> 0.0001")
            options = {"times": 2, "run": str(out), "echo": lambda _: None}
            publish("/filter/parameter_events", SAID, rate=20.0, **options)
            publish("plan/estimate", ESTIMATE, rate=1.0, **{**options, "times": 1})
            os.kill(about(card)["pid"], signal.SIGKILL)
            wait_for(lambda: about(card)["restarts"] == 1)
            set_parameter(card, "filter", "order", "median")
            recorder = started("bag", "record", "-o", outside)
            assert recorder.stdout is not None and recorder.stdout.readline()  # it records
            for param, value, words in REFUSED:
                with pytest.raises(ValueError, match=words):
                    set_parameter(card, "planner", param, value)
            done = set_parameter(card, "planner", "tolerance", "0.3mm")
            assert done == "planner.tolerance: 0.0001 -> 0.0003"
            set_parameter(card, "planner", "most_seconds", "2h")
            assert process.wait(4 * WITHIN) in (0, 1)
            recorder.communicate(timeout=WITHIN)
        finally:
            process.kill()
    return out


def about(card):
    return request(card, "status")["nodes"]["filter"]


@pytest.mark.slow
def test_parameters_and_messages_of_tools_are_recorded_once_inside_and_outside(tuned):
    messages = open_recording(tuned / "topics.mcap").messages()
    outside = [(one.topic, one.publisher) for one in messages if one.outside]
    assert outside.count(("/filter/parameter_events", "filter")) == 2
    assert outside.count(("/plan/estimate", "planner")) == 1
    assert len(outside) == 3
    events = recorded(tuned, "/filter/parameter_events", ParameterEvent)
    first, second = [one for one in events if one.value != '"none"']
    assert len(events) == 4
    assert (first.param, first.value) == ("contact", "0.0001")
    assert (second.param, second.value) == ("order", '"median"')
    assert 10 <= first.after <= second.after < len(recorded(tuned, "/touch/image", TactileImage))
    first, second = recorded(tuned, "/planner/parameter_events", ParameterEvent)
    assert (first.param, first.value, first.topic) == ("tolerance", "0.0003", "/model/shape")
    assert (second.param, second.value) == ("most_seconds", "7200.0")
    summary = read_summary(tuned)
    assert (summary["tolerance_m"], summary["tolerance_met"]) == (3e-4, True)
    assert summary["rms_bound_95_m"] > 1e-4
    outside = tuned.parent / "o.mcap"
    assert all(one.identical for one in compare_recordings(tuned, outside).topics.values())


@pytest.mark.slow
def test_replay_sets_the_same_and_publishes_the_same(tuned):
    for node in ("filter", "planner"):
        done = palpate("replay", tuned, "--nodes", node)
        assert done.code == 0
        assert f"2 on /{node}/parameter_events" in " ".join(done.out.split())


@pytest.mark.slow
@pytest.mark.parametrize("place", ["contour=1", "end"])
def test_resume_from_any_point_gives_same_solid(place, tuned, tmp_path):
    again = tmp_path / "again"
    done = palpate("replay", tuned, "--from", place, "--quiet", "--out", again)
    assert (again / "mesh.stl").read_bytes() == (tuned / "mesh.stl").read_bytes()
    topics = compare_recordings(tuned, again).topics.items()
    differ = {name for name, one in topics if not one.identical}
    if place == "end":
        missed = read_summary(tuned)["missed"]  # by when the parameters were set
        assert (done.code, differ) == (int(bool(missed)), set())
    else:  # what tools sent after that contour is not sent again, and changes no solid
        assert differ <= {"/filter/parameter_events", "/plan/estimate"}


RATE = 60.0  # Robot time that passes in a second


@pytest.mark.parametrize("composed", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_paced_frames_come_at_their_robot_time_and_are_the_same(composed, explored, tmp_path):
    file, out = tmp_path / "paced.yaml", tmp_path / "run"
    file.write_text(f"include: {FINGERS}\nrate: {RATE}\n")
    finished(file, out, {"fingers": 1}, {}, composed=composed)
    recorded = list(open_recording(out / "topics.mcap").messages())
    began = next(message.sent_ns for message in recorded if message.topic == "/world")
    for message in recorded:
        if message.topic == "/touch/raw":
            passed = 1e-9 * (message.sent_ns - began)
            assert passed >= decode(TactileFrame, message.body).robot_time / RATE
    assert all(topic.identical for topic in compare_recordings(explored(1), out).topics.values())


@pytest.mark.parametrize("rate", ["0", "-1", "fast"])
def test_rate_that_cannot_be_is_refused_with_its_line(tmp_path, rate):
    file = tmp_path / "odd.yaml"
    file.write_text(f"include: explore.yaml\nrate: {rate}\n")
    with pytest.raises(InputError, match=r"odd.yaml:2: rate"):
        finished(file, tmp_path / "odd", {}, {}, composed=True)
