from __future__ import annotations

import subprocess
import sys
import time
from collections import deque
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.messages.bus.message_log import Consumed
from palpate.messages.bus.subscriber import Received
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.types.world import World
from palpate.nodes.runtime.loop import NodeLoop
from palpate.nodes.runtime.node import Input, Node, Sink, lone_wiring
from palpate.nodes.runtime.repeating import JournalOrder
from palpate.nodes.runtime.work import NodeWork, Outgoing, Promise, SinkWork

BEFORE = (Consumed("a", "/x", 0), Consumed("b", "/y", 0), Consumed("a", "/x", 1))


def arrival(publisher: str, topic: str, seq: int) -> Received:
    return Received(publisher, topic, Header(1, 0, seq, 0, 0.0, 0), b"")


def test_arrivals_are_handed_out_in_the_order_of_the_journal():
    order = JournalOrder(BEFORE)
    for seq in (0, 1, 2):
        order.put(arrival("a", "/x", seq))
    assert order.take() == arrival("a", "/x", 0)
    assert order.take() is None and order.replaying
    order.put(arrival("b", "/y", 0))
    order.put(arrival("b", "/y", 1))
    assert [order.take(), order.take()] == [arrival("b", "/y", 0), arrival("a", "/x", 1)]
    assert not order.replaying
    assert order.rest() == [arrival("a", "/x", 2), arrival("b", "/y", 1)]


def test_a_publisher_that_sends_something_else_than_before_is_named():
    order = JournalOrder(BEFORE)
    order.put(arrival("a", "/x", 1))
    with pytest.raises(ValueError, match="/x 0 of a must come next, as before; got 1"):
        order.take()


WORLD = World(platform=0.0, reach=0.1, fingers=1, seed=1)


class Station:
    """Sockets of a node to which the launcher sends these messages, and others these worlds."""

    def __init__(self, told: list[dict[str, Any]], worlds: int = 0, **past: Any) -> None:
        header = Header(1, 0, 0, 0, 0.0, schema_hash(World))
        self.arrivals = deque([Received("sim", "/world", header, encode(WORLD))] * worlds)
        self.told, self.sent, self.waiting = deque(told), list[tuple[str, Any]](), False
        self.line = SimpleNamespace(receive=self.next_told, send=self.send)
        self.tap = SimpleNamespace(refresh=lambda: None, publish=lambda _: None)
        missing = {"/world": 2}
        self.subscriber = SimpleNamespace(in_step=False, gaps=2, duplicates=0, missing=missing)
        past_log = SimpleNamespace(**past)
        self.publisher = SimpleNamespace(sent={"/out": 3}, past=past_log, serve=lambda: None)

    def next_told(self):
        return self.told.popleft() if self.told else None

    def send(self, kind, **fields):
        self.sent.append((kind, fields))

    def wait(self, _):
        return False, True

    def take_in(self):
        pass

    def receive(self):
        return self.arrivals.popleft() if self.arrivals else None

    def answer(self, published, cause):
        assert not published and not cause.finished


EDGES = (Input("sim", "/world", "/world", "World"),)


def test_a_sink_that_is_told_to_stop_writes_what_has_come_and_what_never_will():
    written = list[tuple[str, int]]()
    writer = SimpleNamespace(write=lambda topic, header, body: written.append((topic, len(body))))
    work = SinkWork(Sink(params=dict, open=lambda *_: writer), None, lone_wiring(None, EDGES, ()))
    NodeLoop("recorder", Station([{"kind": "stop"}], worlds=3)).run(work)  # type: ignore[arg-type]
    assert written == [("/world", len(encode(WORLD)))] * 3
    assert work.missing == {"/world": 2}


@pytest.mark.parametrize("finished", ["", "all is done"])
def test_a_node_that_acts_tells_again_its_end_and_handles_nothing_after_a_stop(
    finished,
):
    handled = list[World]()
    node = Node(
        params=dict,
        start=lambda _: (None, []),
        inputs={"/world": (World, lambda _, state, world: (handled.append(world), []))},
        outputs={},
        has_side_effects=True,
    )
    station: Any = Station([{"kind": "stop"}], 1, handled={}, counts={}, finished=finished)
    loop = NodeLoop("actor", station, going=True)
    loop.skip = lambda had: None  # type: ignore[method-assign]
    loop.run(NodeWork(node, None, lone_wiring(None, EDGES, ())))
    ends = [fields["reason"] for kind, fields in station.sent if kind == "finished"]
    assert ends == ([finished] if finished else [])
    assert not handled and len(station.arrivals) == 1


PRELOADED = """
import sys
from palpate.preloading import preload
import palpate.nodes.tracer
late = "palpate.core.explore.tracing.contour_trace"
print(late in sys.modules)
preload(["palpate.nodes.tracer"])
print(late in sys.modules)
"""


def test_what_a_node_takes_from_lazy_rooms_is_there_before_it_is_forked():
    done = subprocess.run([sys.executable, "-c", PRELOADED], capture_output=True, text=True)
    assert done.stdout.split() == ["False", "True"]


def test_all_that_a_node_had_not_come_to_is_owed_and_what_it_had_published_goes_first():
    had, done = {"/a": 1, "/b": 2}, []
    station = Station([])
    loop = NodeLoop("n", station, going=True)
    station.publisher.was_published = lambda topic: done.count(topic) < had[topic]
    station.publisher.promise = station.send = lambda topic, *_: done.append(topic)
    score, plain = Promise("/a", bytes, 0), Outgoing("/b", b"", 0.0, 0)
    owed = loop._republish([score, score, plain], behind=False)
    owed += loop._republish([score, plain, plain], behind=bool(owed))
    assert done == ["/a", "/b", "/b"]
    assert owed == [score, score, plain]


def test_who_is_busy_for_long_answers_those_who_ask_and_gives_signs_of_life(
    monkeypatch: pytest.MonkeyPatch,
):
    station, served = Station([{"kind": "go"}, {"kind": "stop"}]), list[int]()
    node = Node(params=dict, start=lambda _: (None, []), inputs={}, outputs={})
    work = NodeWork(node, None, lone_wiring(None, (), ()))
    loop = NodeLoop("busy", station)  # type: ignore[arg-type]

    def serve() -> None:
        served.append(1)
        with work.steps("made for who asks"):  # which asks nobody to look up once more
            pass

    station.publisher.serve = serve
    loop.run(work)
    served.clear()
    now = [time.monotonic()]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    beats = [kind for kind, _ in station.sent].count("alive")
    for seconds in (1.0, 0.001, 0.03, 0.001, 0.3):
        now[0] += seconds
        with work.steps("long"):
            pass
    assert len(served) == 3
    assert [kind for kind, _ in station.sent].count("alive") > beats


UNUSED = """
import sys
from palpate.preloading import import_when_used, preload
preload([])
import scipy.sparse
import numpy
print("numpy.f2py" in sys.modules, "numpy.f2py.crackfortran" in sys.modules)
print(callable(numpy.ma.masked_array), numpy.ma is sys.modules["numpy.ma"])
import_when_used("numpy.nothing_of_the_kind")
"""


def test_parts_of_numpy_that_nobody_uses_are_there_and_imported_at_their_first_use():
    done = subprocess.run([sys.executable, "-c", UNUSED], capture_output=True, text=True)
    assert (done.stdout.split(), done.stderr) == (["True", "False", "True", "True"], "")
