import dataclasses
import multiprocessing
import os
import re
import subprocess
import sys
import threading

import pytest

from palpate.launch.launcher import launch
from palpate.launch.processes import supervisor
from palpate.messages.types.touch import TactileFrame
from palpate.nodes.runtime.node import Input, Wiring
from tests.studies.toy_node import ToyParams, toy

pytestmark = pytest.mark.graph


def run(wirings, watcher, folder, **more):
    """Launch, and see that no process and no file of it is left."""
    watch = more.pop("watch", ())
    ends = more.pop("ends", wirings[0].name)
    ending = launch(wirings, ends=ends, watch=watch, watcher=watcher, work_dir=folder, **more)
    assert multiprocessing.active_children() == []
    assert [path for path in folder.iterdir() if path.suffix != ".txt"] == []
    return ending


def source(burst=5):
    return toy("source", ToyParams(burst=burst))


def counter(expects, upstream="source", **more):
    return toy("counter", ToyParams(expects=expects, **more), upstream=upstream)


def test_a_graph_ends_when_all_that_was_sent_has_been_consumed(watcher, tmp_path):
    ending = run([source(50), counter(50)], watcher, tmp_path, ends="counter", watch=["/source"])
    assert (ending.status, ending.reason) == ("finished", "50 received")
    assert (ending.gaps, ending.duplicates) == (0, 0)
    assert ending.statuses["counter"].messages == 50
    assert ending.statuses["source"].sent == 50
    assert ending.statuses["source"].state == "ending"
    assert [message.touch for _, message in watcher.messages] == list(range(50))
    assert all(type(message) is TactileFrame for _, message in watcher.messages)
    assert len(watcher.seconds) == 1 and 0.0 < watcher.seconds[0] < 60.0
    assert watcher.ticks > 0


def test_the_word_of_any_other_node_does_not_end_the_graph(watcher, tmp_path):
    early = toy("early", ToyParams(expects=1), upstream="source")
    ending = run([source(50), early, counter(50)], watcher, tmp_path, ends="counter")
    assert ending.reason == "50 received"


def test_a_sink_has_written_everything_when_the_graph_ends(watcher, toys, tmp_path):
    path = tmp_path / "lines.txt"
    graph = [source(100), counter(100), toys.sink(path, work=1e-3)]
    assert run(graph, watcher, tmp_path, ends="counter", depth=2).status == "finished"
    lines = path.read_text().splitlines()
    assert lines[0] == "open [('/source', 'TactileFrame')]"
    assert [line.split()[:2] for line in lines[1:-1]] == [["/source", str(n)] for n in range(100)]
    assert lines[-1] == "closed"


@pytest.mark.parametrize(("how", "words"), [
    ("raise", "broken failed while handling /source 2 from source: ZeroDivisionError: cannot"),
    ("undeclared", "broken published /nowhere, which it does not declare; it declares /out"),
    ("wrong type", "broken published a LogRecord on /out, declared as TactileFrame"),
    ("not finite", "handling /source 2 from source: CodecError: not a TactileFrame: robot_time"),
    ("start", "broken failed while starting: RuntimeError: no world to start in"),
    ("exit", "broken ended by itself with exit code 7"),
    ("kill", "broken was killed by SIGKILL"),
])  # fmt: skip
def test_a_node_that_breaks_ends_the_graph_and_is_named(how, words, watcher, toys, tmp_path):
    path = tmp_path / "lines.txt"
    ending = run([source(), toys.broken(how), toys.sink(path)], watcher, tmp_path)
    assert ending.status == "died"
    assert words in ending.reason
    assert "\n" not in ending.reason
    assert path.read_text().splitlines()[-1] == "closed"


def test_the_trace_of_a_failure_goes_to_the_log(watcher, toys, tmp_path):
    run([source(), toys.broken("raise")], watcher, tmp_path)
    assert [line.level for line in watcher.lines if line.node == "broken"] == ["error", "debug"]
    assert watcher.lines[-1].text.startswith("Traceback")
    assert "palpate_toy_broken.py" in watcher.lines[-1].text
    place = re.search(r"\(.*palpate_toy_broken\.py:\d+ in \w+\)$", watcher.lines[-2].text)
    assert place is not None


def test_a_module_or_parameters_that_do_not_fit_end_the_graph(watcher, tmp_path, toys):
    lost = Wiring(
        name="lost", module="palpate_nothing", params={}, inputs=(), outputs={}, subscribers={}
    )
    ending = run([source(), lost], watcher, tmp_path)
    assert ending.status == "died"
    assert ending.reason.startswith(
        "lost failed while loading: ValueError: no module 'palpate_nothing'"
    )
    wrong = toy("wrong", ToyParams())
    wrong = Wiring(
        name="wrong",
        module=wrong.module,
        params={"burst": "many"},
        inputs=(),
        outputs=wrong.outputs,
        subscribers={},
    )
    ending = run([source(), wrong], watcher, tmp_path)
    assert ending.status == "died"
    assert "wrong failed while loading: ValidationError: Expected `int`, got `str`" in ending.reason


def test_a_sink_that_cannot_close_is_a_failure(watcher, toys, tmp_path):
    graph = [source(), counter(5), toys.sink(tmp_path / "lines.txt", spoilt=True)]
    ending = run(graph, watcher, tmp_path, ends="counter")
    assert ending.status == "died"
    assert ending.reason.startswith("sink failed while closing: OSError: no space left on device (")


def test_quiet_without_an_end_is_reported(watcher, tmp_path, monkeypatch):
    monkeypatch.setattr(supervisor, "STALL", 0.6)
    silent = toy("silent", ToyParams())
    waiting = toy("waiting", ToyParams(), upstream="silent")
    ending = run([source(5), counter(6), silent, waiting], watcher, tmp_path, ends="counter")
    assert ending.status == "stalled"
    assert ending.reason == (
        "counter has not finished, and nothing has moved for 0.6 s: "
        "waiting has received nothing on /silent (silent)"
    )


def test_a_node_that_lacks_what_it_needs_is_named(watcher, toys, tmp_path, monkeypatch):
    monkeypatch.setattr(supervisor, "STALL", 0.6)
    graph = [source(5), toy("silent", ToyParams()), toys.needy("silent", "source")]
    ending = run(graph, watcher, tmp_path, ends="needy")
    assert ending.status == "stalled"
    assert "needy needs /silent before anything else" in ending.reason
    assert "needy has consumed 0 of 5 on /source from source" in ending.reason


@pytest.mark.parametrize("turn", range(4))
def test_what_is_needed_is_handled_first(turn, watcher, toys, tmp_path):
    late = toy("late", ToyParams(relay=True), upstream="source")
    graph = [source(3), late, toys.needy("late", "source")]
    ending = run(graph, watcher, tmp_path, ends="needy")
    assert (ending.status, ending.reason) == ("finished", "all there")


def test_what_the_watcher_raises_ends_the_graph(watcher, tmp_path):
    def full(topic, message):
        raise OSError("the screen is full")

    watcher.received = full
    with pytest.raises(OSError, match="the screen is full"):
        run([source(), counter(0)], watcher, tmp_path, watch=["/source"])
    assert multiprocessing.active_children() == []
    assert list(tmp_path.iterdir()) == []


def test_a_node_that_is_silent_for_long_is_mentioned(watcher, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.launch.processes.node_status.SILENCE", 0.4)
    slow = dataclasses.replace(counter(1, work=1.0), handler_timeout=0.2)
    assert run([source(1), slow], watcher, tmp_path, ends="counter").status == "finished"
    texts = [line.text for line in watcher.lines if "still working" in line.text]  # or starting
    assert texts == ["counter is still working, or hangs: no sign of life for 0.4 s"]


def test_a_node_that_is_silent_for_no_longer_than_it_declared_is_not(
    watcher, tmp_path, monkeypatch
):
    monkeypatch.setattr("palpate.launch.processes.node_status.SILENCE", 0.4)
    slow = dataclasses.replace(counter(1, work=1.0), handler_timeout=30.0)
    assert run([source(1), slow], watcher, tmp_path, ends="counter").status == "finished"
    assert [line.text for line in watcher.lines if "counter is still" in line.text] == []


def test_a_sink_still_writes_what_had_arrived_when_a_node_died(watcher, toys, tmp_path):
    path = tmp_path / "lines.txt"
    slow = toy("slow", ToyParams(relay=True, work=0.05), upstream="source")
    graph = [source(50), slow, toys.broken("raise", upstream="slow"), toys.sink(path, work=0.01)]
    assert run(graph, watcher, tmp_path).status == "died"
    lines = path.read_text().splitlines()
    assert len(lines) == 1 + 50 + 1
    assert lines[-1] == "closed"


def test_a_node_of_a_users_own_starts_light_with_one_thread_and_as_nice_as_asked():
    # In a process of its own, for what a server has once imported stays there.
    command = [sys.executable, "-m", "tests.graph.toys.run_light"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    reason, unchanged = done.stdout.splitlines()
    environment = {"OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    assert f"RuntimeError: [] {environment} {os.nice(0) + 3} (" in reason
    assert unchanged == "True"


SOURCE = toy("source", ToyParams())
COUNTER = toy("counter", ToyParams(), upstream="source")


def renamed(name):
    return dataclasses.replace(SOURCE, name=name)


TWICE = dataclasses.replace(COUNTER, inputs=COUNTER.inputs * 2)
LOST = dataclasses.replace(COUNTER, inputs=(Input("source", "/sauce", "/in", "TactileFrame"),))


@pytest.mark.parametrize(("wirings", "ends", "watch", "words"), [
    ([SOURCE, SOURCE], "source", [], "'source' is there twice"),
    ([SOURCE], "sink", [], r"no node 'sink' that could end the graph; there are \['source'\]"),
    ([renamed("launcher")], "launcher", [], "no node may be called 'launcher'"),
    ([renamed("two words")], "two words", [], "got 'two words'"),
    ([SOURCE], "source", ["/model"], "nobody publishes /model"),
    ([SOURCE, TWICE], "source", [], "counter subscribes to /source twice"),
    ([SOURCE, LOST], "source", [],
     "counter subscribes to /sauce of source, who does not publish it"),
])  # fmt: skip
def test_a_graph_that_cannot_run_is_refused(wirings, ends, watch, words, watcher):
    with pytest.raises(ValueError, match=words):
        launch(wirings, ends=ends, watch=watch, watcher=watcher)
    assert watcher.ticks == 0


def test_folders_that_are_missing_or_too_deep_are_refused(watcher, tmp_path):
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    with pytest.raises(ValueError, match="choose a folder with a shorter path"):
        launch([SOURCE], ends="source", watch=[], watcher=watcher, work_dir=deep)
    assert list(deep.iterdir()) == []
    with pytest.raises(ValueError, match="no folder for sockets can be made in"):
        launch([SOURCE], ends="source", watch=[], watcher=watcher, work_dir=tmp_path / "nowhere")


def test_a_launch_from_another_thread_is_refused(watcher):
    errors: list[RuntimeError] = []

    def attempt():
        try:
            launch([SOURCE], ends="source", watch=[], watcher=watcher)
        except RuntimeError as error:
            errors.append(error)

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join(10)
    assert "only be launched from the main thread" in str(errors[0])
