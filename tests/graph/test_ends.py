"""How a launched graph ends: finished, broken or stalled, and always without a trace."""

from __future__ import annotations

import os
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from palpate_toy import toy, wiring

from palpate.launch.launcher import launch
from palpate.launch.processes.node_status import SupervisionSettings
from palpate.messages.types import TactileFrame
from palpate.nodes.filter import Params
from palpate.nodes.runtime.node import Input
from tests.graph.conftest import broken, sink, started

pytestmark = pytest.mark.graph


def source(burst=5):
    return toy("source", burst=burst)


def counter(expects, upstream="source", **more):
    return toy("counter", upstream=upstream, expects=expects, **more)


def test_graph_ends_when_all_that_was_sent_is_consumed(run, watcher, tmp_path):
    path = tmp_path / "lines.txt"
    early = toy("early", upstream="source", expects=1)  # does not end the graph
    graph = [source(50), early, sink(path, work=1e-3), counter(50)]
    ending = run(graph, watch=["/source"], depth=2)
    assert (ending.status, ending.reason) == ("finished", "50 received")
    assert (ending.gaps, ending.duplicates) == (0, 0)
    assert ending.statuses["counter"].messages == 50
    assert (ending.statuses["source"].sent, ending.statuses["source"].state) == (50, "ending")
    assert watcher.touches() == list(range(50))
    assert all(type(message) is TactileFrame for _, message in watcher.messages)
    assert len(watcher.seconds) == 1 and 0.0 < watcher.seconds[0] < 60.0
    assert watcher.ticks > 0
    first, *lines, last = path.read_text().splitlines()
    assert (first, last) == ("open [('/source', 'TactileFrame')]", "closed")
    assert [line.split()[:2] for line in lines] == [["/source", str(n)] for n in range(50)]


@pytest.mark.parametrize(
    "graph",
    [
        [toy("source", burst=200, late=0.15), counter(200)],
        [source(200), counter(200, late=0.15)],
        [source(200), toy("slow", upstream="source", work=5e-4), counter(200)],
    ],
    ids=["late source", "late subscriber", "ends with a full queue"],
)
def test_nothing_is_lost_in_queues_of_one(graph, run):
    ending = run(graph, depth=1)
    assert (ending.status, ending.gaps) == ("finished", 0)
    sent = graph[0].params.burst
    assert [ending.statuses[one.name].messages for one in graph[1:]] == [sent] * (len(graph) - 1)


@pytest.mark.parametrize(("node", "words"), [
    (broken("raise"), "broken failed while handling /source 2 from source: ZeroDivisionError: can"),
    (broken("undeclared"), "broken published /nowhere, which it does not declare; it declares"),
    (broken("wrong type"), "broken published a LogRecord on /out, declared as TactileFrame"),
    (broken("not finite"), "/source 2 from source: CodecError: not a TactileFrame: robot_time"),
    (broken("start"), "broken failed while starting: RuntimeError: no world to start in"),
    (broken("exit"), "broken ended by itself with exit code 7"),
    (broken("kill"), "broken was killed by SIGKILL"),
    (wiring("lost", "palpate_nothing", {}, outputs={}),
     "lost failed while loading: ValueError: no module 'palpate_nothing'"),
    (wiring("wrong", "palpate_toy", {"burst": "many"}),
     "wrong failed while loading: ValidationError: Expected `int`, got `str`"),
])  # fmt: skip
def test_node_that_breaks_ends_the_graph_and_is_named(node, words, run, watcher, tmp_path):
    path = tmp_path / "lines.txt"
    ending = run([source(), sink(path), node], ends="source")
    assert ending.status == "died"
    assert words in ending.reason and "\n" not in ending.reason
    # Where a node cannot even be loaded, the graph may end before the sink has begun.
    if path.exists() or "while loading" not in words:
        assert path.read_text().splitlines()[-1] == "closed"
    lines = [line for line in watcher.lines if line.node == "broken"]
    if "ZeroDivisionError" in words:  # its trace goes to the log
        assert [line.level for line in lines] == ["error", "debug"]
        assert re.search(r"\(.*palpate_toy_broken\.py:\d+ in \w+\)$", lines[0].text)
        assert lines[1].text.startswith("Traceback")
        assert "palpate_toy_broken.py" in lines[1].text


def test_sink_writes_what_had_arrived_and_fails_if_it_cannot_close(run, tmp_path):
    ending = run([source(), sink(tmp_path / "lines.txt", spoilt=True), counter(5)])
    assert ending.status == "died"
    assert ending.reason.startswith("sink failed while closing: OSError: no space left on device (")
    path = tmp_path / "lines.txt"
    slow = toy("slow", upstream="source", relay=True, work=0.02)
    graph = [source(50), slow, sink(path, work=0.01), broken("raise", upstream="slow")]
    assert run(graph, ends="source").status == "died"
    lines = path.read_text().splitlines()
    assert len(lines) == 1 + 50 + 1 and lines[-1] == "closed"


def test_stall_is_reported_with_who_waits_for_what(run):
    inputs = (
        Input("silent", "/silent", "/touch/info", "TactileFrame"),
        Input("source", "/source", "/touch/raw", "TactileFrame"),
    )
    needy = wiring("needy", "palpate.nodes.filter", Params(), inputs=inputs, outputs={})
    graph = [source(5), toy("silent"), toy("waiting", upstream="silent"), needy, counter(6)]
    ending = run(graph, settings=SupervisionSettings(stall_time=0.6))
    assert ending.status == "stalled"
    for reason in (
        "counter has not finished, and nothing has moved for 0.6 s: ",
        "waiting has received nothing on /silent (silent)",
        "needy needs /silent before anything else",
        "needy has consumed 0 of 5 on /source from source",
    ):
        assert reason in ending.reason


def test_exception_of_the_watcher_ends_the_graph(run, watcher):
    def full(topic, message):
        raise OSError("the screen is full")

    watcher.received = full
    with pytest.raises(OSError, match="the screen is full"):
        run([counter(0), source()], watch=["/source"])


def test_silence_longer_than_declared_is_mentioned_once(run, watcher):
    slow = replace(counter(1, work=0.7), handler_timeout=0.2)
    settings = SupervisionSettings(silence_limit=0.4)
    assert run([source(1), slow], settings=settings).status == "finished"
    texts = [line.text for line in watcher.lines if "counter is still working" in line.text]
    assert texts == ["counter is still working, or hangs: no sign of life for 0.4 s"]


def launched(mode: str) -> list[str]:
    """What a script prints that launches a graph: its process and its server are fresh."""
    with started("run_graph.py", mode) as process:
        out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return [line for line in out.splitlines() if line not in ("launching", "ready")]


def test_own_node_starts_light_with_one_thread_and_as_nice_as_asked():
    ending, unchanged = launched("light")
    environment = {"OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    assert f"RuntimeError: [] {environment} {os.nice(0) + 3} (" in ending
    assert unchanged == "the environment is unchanged: True"


@pytest.mark.slow
def test_graph_runs_after_one_whose_module_is_missing():
    first, second, _ = launched("missing")
    assert first.startswith(
        "died - lost failed while loading: ValueError: no module 'palpate.nodes.nothing'"
    )
    assert second == "finished - 5 received"


SOURCE = toy("source")
COUNTER = toy("counter", upstream="source")
TWICE = replace(COUNTER, inputs=COUNTER.inputs * 2)
LOST = replace(COUNTER, inputs=(Input("source", "/sauce", "/in", "TactileFrame"),))


@pytest.mark.parametrize(("wirings", "ends", "watch", "words"), [
    ([SOURCE, SOURCE], "source", [], "'source' occurs twice"),
    ([SOURCE], "sink", [], r"no node 'sink' that can end the graph; there are \['source'\]"),
    ([replace(SOURCE, name="launcher")], "launcher", [], "no node may be named 'launcher'"),
    ([replace(SOURCE, name="two words")], "two words", [], "got 'two words'"),
    ([SOURCE], "source", ["/model"], "no node publishes /model"),
    ([SOURCE, TWICE], "source", [], "counter subscribes to /source twice"),
    ([SOURCE, LOST], "source", [],
     "counter subscribes to /sauce of source, who does not publish it"),
])  # fmt: skip
def test_graph_that_cannot_run_is_refused(wirings, ends, watch, words, watcher):
    with pytest.raises(ValueError, match=words):
        launch(wirings, ends=ends, watch=watch, watcher=watcher)
    assert watcher.ticks == 0


def test_folder_missing_or_too_deep_and_another_thread_are_refused(watcher, tmp_path):
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    options = {"ends": "source", "watch": [], "watcher": watcher}
    with pytest.raises(ValueError, match="choose a folder with a shorter path"):
        launch([SOURCE], work_dir=deep, **options)
    assert list(deep.iterdir()) == []
    with pytest.raises(ValueError, match="no folder for sockets can be made in"):
        launch([SOURCE], work_dir=tmp_path / "nowhere", **options)
    with ThreadPoolExecutor(1) as pool:
        refused = pool.submit(launch, [SOURCE], **options).exception(timeout=10)
    assert "only be launched from the main thread" in str(refused)
