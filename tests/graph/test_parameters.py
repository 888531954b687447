"""A graph whose parameters are set and whose node dies: recorded, replayed, gone on with."""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack

import pytest

from palpate.launch.processes.registry import running_graphs
from palpate.launch.run_directory import read_summary
from palpate.messages.recording.reader import open_recording
from palpate.messages.types.catalogue import ParameterEvent
from palpate.messages.types.touch import TactileImage
from palpate.nodes.runtime.testing import recorded
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.cli import command_line as cli
from palpate.tools.introspection.descriptions import set_parameter
from palpate.tools.introspection.requests import params_of, publish, request, sample_status

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
SAID = """{param: order, value: '"none"', topic: /touch/raw, after: 0}"""  # By no node
ESTIMATE = (
    "{number: 0, contours: 0, touches: 0, robot_time: 0, rms_bound_95: null, "
    "largest_untouched: 1, halving_touches: null, halving_seconds: null, open_share: null, "
    "open_width: null}"
)
WITHIN = 60.0  # A deadline that only a broken graph misses, s


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A run whose filter was set, killed, and set once more."""
    folder = tmp_path_factory.mktemp("tuned")
    command = [sys.executable, "-m", "palpate", "run", "vase", "--tolerance", "0.1mm", "--quiet"]
    env = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
    with (
        ExitStack() as stack,
        subprocess.Popen([*command, "--out", str(folder / "run")], env=env) as process,
    ):
        try:
            card = wait_for(lambda: next(iter(running_graphs(folder)), None))
            wait_for(lambda: handled(card) > 10)
            assert set_parameter(card, "filter", "contact", "1.0e-4").endswith("5.0e-05 -> 0.0001")
            said = {"rate": 1.0, "times": 2, "run": str(folder / "run"), "echo": lambda _: None}
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("XDG_RUNTIME_DIR", str(folder))
                publish("/filter/parameter_events", SAID, **{**said, "rate": 20.0})
                publish("plan/estimate", ESTIMATE, **{**said, "times": 1})
            os.kill(about(card)["pid"], signal.SIGKILL)
            wait_for(lambda: about(card)["restarts"] == 1)
            set_parameter(card, "filter", "order", "median")
            record = [
                sys.executable,
                "-m",
                "palpate",
                "bag",
                "record",
                "-o",
                str(folder / "o.mcap"),
            ]
            stack.enter_context(subprocess.Popen(record, env=env))
            (card,) = running_graphs(folder)
            [node] = [one for one in card.nodes if one.name == "filter"]
            assert params_of(node) == {"order": "median", "contact": 1e-4}
            refused = (
                ("axis", "true", r"planner\.axis cannot be set while it runs"),
                ("tolerance", "0.1um", r"planner: tolerance is 1e-07 m; it must be at least what"),
                ("tolerance", "0.1s", r"tolerance 0\.1s: the unit 's' is none of m, cm, mm, um"),
                ("tolerance", "2", r"tolerance cannot be 2: .*<= 1\.0"),
                ("most_seconds", "10ms", r"the unit 'ms' is none of s, min, h"),
                ("most_touches", "0", r"most_touches cannot be 0"),
            )
            for param, value, words in refused:
                with pytest.raises(ValueError, match=words):
                    set_parameter(card, "planner", param, value)
            done = set_parameter(card, "planner", "tolerance", "0.3mm")
            assert done == "planner.tolerance: 0.0001 -> 0.0003"
            set_parameter(card, "planner", "most_seconds", "2h")
            assert process.wait(WITHIN) in (0, 1)
        finally:
            process.kill()
    return folder / "run"


def wait_for(what):
    deadline = time.monotonic() + WITHIN
    while not (found := what()):
        assert time.monotonic() < deadline, "nothing came of it"
    return found


def about(card):
    return request(card, "status")["nodes"]["filter"]


def handled(card):
    found = sample_status(card, ["filter"]).get("filter")
    return 0 if found is None else found.status.messages


def test_what_tools_had_nodes_publish_is_recorded_once_as_from_outside(tuned):
    messages = [*open_recording(tuned / "topics.mcap").messages()]
    outside = [(one.topic, one.publisher) for one in messages if one.outside]
    assert outside.count(("/filter/parameter_events", "filter")) == 2
    assert outside.count(("/plan/estimate", "planner")) == 1
    assert len(outside) == 3


def test_it_is_recorded_where_each_was_set_but_once(tuned):
    events = recorded(tuned, "/filter/parameter_events", ParameterEvent)
    first, second = [one for one in events if one.value != '"none"']
    assert len(events) == 4
    assert (first.param, first.value) == ("contact", "0.0001")
    assert (second.param, second.value) == ("order", '"median"')
    images = len(recorded(tuned, "/touch/image", TactileImage))
    assert 10 <= first.after <= second.after < images


def test_the_planner_ends_by_the_tolerance_that_was_set_while_it_ran(tuned):
    first, second = recorded(tuned, "/planner/parameter_events", ParameterEvent)
    assert (first.param, first.value, first.topic) == ("tolerance", "0.0003", "/model/shape")
    assert (second.param, second.value) == ("most_seconds", "7200.0")
    summary = read_summary(tuned)
    assert (summary["tolerance_m"], summary["tolerance_met"]) == (3e-4, True)
    assert summary["rms_bound_95_m"] > 1e-4


def test_a_replay_publishes_the_same_as_it_sets_the_same(tuned, capsys):
    assert cli.run(["replay", str(tuned)]) == 0
    assert "2 on /filter/parameter_events" in capsys.readouterr().out
    assert cli.run(["replay", str(tuned), "--nodes", "planner"]) == 0
    assert "2 on /planner/parameter_events" in " ".join(capsys.readouterr().out.split())


def test_who_records_it_from_outside_has_it_from_the_first_message_on(tuned):
    outside = tuned.parent / "o.mcap"
    assert all(one.identical for one in compare_recordings(tuned, outside).topics.values())
    assert cli.run(["replay", str(outside)]) == 0


@pytest.mark.parametrize("place", ["contour=1", "end"])
def test_who_goes_on_from_anywhere_comes_to_the_same_solid(place, tuned, tmp_path):
    again = tmp_path / "again"
    went_on = ["replay", str(tuned), "--from", place, "--quiet", "--out", str(again)]
    code = cli.run(went_on)
    assert (again / "mesh.stl").read_bytes() == (tuned / "mesh.stl").read_bytes()
    topics = compare_recordings(tuned, again).topics.items()
    differ = {name for name, one in topics if not one.identical}
    if place == "end":
        missed = read_summary(tuned)["missed"]  # by when the parameters were set
        assert (code, differ) == (int(bool(missed)), set())
    else:  # what tools sent after that contour is not sent again, and changes no solid
        assert differ <= {"/filter/parameter_events", "/plan/estimate"}
