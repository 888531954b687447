from __future__ import annotations

import dataclasses
import threading

import pytest

from palpate.bench.bus.toy_node import ToyParams, toy
from palpate.launch.launcher import launch
from palpate.nodes.runtime.node import Input, Wiring

SOURCE = toy("source", ToyParams())
COUNTER = toy("counter", ToyParams(), upstream="source")


def renamed(name: str) -> Wiring:
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


def test_a_folder_with_too_long_a_path_is_refused(watcher, tmp_path):
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    with pytest.raises(ValueError, match="choose a folder with a shorter path"):
        launch([SOURCE], ends="source", watch=[], watcher=watcher, work_dir=deep)
    assert list(deep.iterdir()) == []


def test_a_folder_that_is_not_there_is_refused(watcher, tmp_path):
    with pytest.raises(ValueError, match="no folder for sockets can be made in"):
        launch([SOURCE], ends="source", watch=[], watcher=watcher, work_dir=tmp_path / "nowhere")


def test_a_launch_from_another_thread_is_refused(watcher):
    errors: list[RuntimeError] = []

    def attempt() -> None:
        try:
            launch([SOURCE], ends="source", watch=[], watcher=watcher)
        except RuntimeError as error:
            errors.append(error)

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join(10)
    assert "only be launched from the main thread" in str(errors[0])
