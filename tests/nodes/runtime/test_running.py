"""Nodes at work: by themselves, composed in one process, and over sockets across deaths."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import pytest
import zmq

from palpate.messages import Header, decode, encode, schema_hash
from palpate.messages.bus import ControlServer, NodeSockets, Received
from palpate.messages.types import LogRecord, NodeStatus, ParameterEvent, World
from palpate.nodes import filter as filtering
from palpate.nodes.runtime.composed import Watcher, run_composed
from palpate.nodes.runtime.loop import run_node
from palpate.nodes.runtime.node import (
    Deferred,
    Finished,
    Input,
    Node,
    Outputs,
    Sink,
    Source,
    Timed,
    Wiring,
    with_parameter,
)
from palpate.nodes.runtime.work import ContractError, NodeWork, Outgoing
from palpate.preloading import open_closed_streams
from tests.messages.cases import addresses, cases

WORLD = World(platform=0.0, reach=0.1, fingers=1, seed=1)


def line(text: str) -> LogRecord:
    return LogRecord(node="n", level="info", text=text, robot_time=2.5)


class Params(msgspec.Struct, frozen=True, kw_only=True):
    """Of the toy."""

    least: int = 0  # Told in each answer
    expects: int = 0  # Finishes with so many messages; 0 never does
    fails: bool = False  # Raises an error at the third message


def take(params: Params, count: int, message: LogRecord) -> tuple[int, Outputs]:
    if params.fails and count == 2:
        raise ValueError("a taxel came off")
    count += 1
    outputs: Outputs = [("/out", line(f"{message.text} {params.least}"))]
    if message.text == "long":
        outputs.append(("/out", Deferred(LogRecord, lambda step: made_late(step, count))))
    return count, [*outputs, *([Finished("all came")] if count == params.expects else [])]


def made_late(step: Any, count: int) -> LogRecord:
    with step("late"):
        return line(f"late {count}")


# Answers each message with its text and a parameter; what it is asked for "long" comes later.
TOY = Node(
    params=Params,
    start=lambda params: (0, [("/out", line("started"))]),
    inputs={"/in": (LogRecord, take), "/need": (World, lambda _, state, world: (state, []))},
    outputs={"/out": LogRecord, "/toy/parameter_events": ParameterEvent},
    settable={"least": "/in", "expects": "/in"},
    needs=("/need",),
)
LINES = [f"{number}" for number in range(4)]


def read(period: float) -> Iterator[Any]:
    yield Timed(0.0, "/worlds", WORLD)
    yield None
    for i, text in enumerate(LINES):
        yield Timed(period * i, "/lines", encode(line(text)))
    yield Finished("read")


SOURCE = Source(
    params=msgspec.defstruct("Paced", [("period", float, 0.0), ("paused", bool, False)]),
    outputs=lambda params: {"/lines": LogRecord, "/worlds": World},
    open=lambda params: read(params.period),
    paused=lambda params: params.paused,
)


def wiring(name: str, params: Any = None, module: str = "", **changes: Any) -> Wiring:
    """The toy between a publisher of lines and one who receives its answers."""
    inputs = (
        Input("source", "/lines", "/in", "LogRecord"),
        Input("source", "/worlds", "/need", "World"),
    )
    base = Wiring(
        name=name,
        module=module,
        params=Params() if params is None else params,
        inputs=inputs,
        outputs={one: one for one in TOY.outputs},
        subscribers={"/out": ("tester",)},
        types={"/out": "LogRecord"},
    )
    return replace(base, **changes)


def arrival(text: str, seq: int = 0, schema: int = 0) -> Received:
    header = Header(1, 0, seq, 0, 0.0, schema or schema_hash(LogRecord))
    return Received("source", "/lines", header, encode(line(text)))


NEED = Received("source", "/worlds", Header(1, 0, 0, 0, 0.0, schema_hash(World)), encode(WORLD))


def texts(published: Any) -> list[str]:
    """What was published, in a word each: texts, parameters as they were set, reasons of ends."""
    bodies = []
    for output in published:
        if isinstance(output, Finished):
            bodies.append(output.reason)
        elif getattr(output, "topic", "") == "/toy/parameter_events":
            event = decode(ParameterEvent, output.body)
            bodies.append(f"{event.param}={event.value} after {event.after}")
        else:
            bodies.append(decode(LogRecord, output.body).text)
    return bodies


def work(params: Params | None = None, node: Node = TOY, **more: Any) -> NodeWork:
    return NodeWork(node, params or Params(), wiring("toy", **more))


def test_needs_are_handled_first_and_messages_of_another_schema_refused():
    toy = work(Params(expects=2))
    [parcel] = toy.begin()
    assert parcel == Outgoing("/out", encode(line("started")), 2.5, schema_hash(LogRecord))
    assert toy.take(arrival("a")) == [] and toy.take(arrival("b", 1)) == []
    assert toy.waits == ["/worlds"] and toy.consumed["source", "/lines"] == 0
    assert texts(toy.take(NEED)) == ["a 0", "b 0", "all came"]
    assert toy.waits == [] and toy.latency.count == 3
    assert toy.consumed == {("source", "/lines"): 2, ("source", "/worlds"): 1}
    assert toy.latency.quantile(0.5) > 0.0
    toy = work()
    toy.take(NEED)
    with pytest.raises(ContractError, match="/lines is not a LogRecord of this version"):
        toy.take(arrival("a", schema=77))
    with pytest.raises(ValueError, match="not a LogRecord"):
        toy.take(arrival("a", 5)._replace(body=b"\x80"))
    assert toy.doing == "handling /lines 5 from source"


def test_message_that_takes_long_comes_last_or_is_promised():
    toy = work()
    toy.begin()
    toy.take(NEED)
    parcels = iter(toy.outputs_of(arrival("long")))
    assert texts([next(parcels)]) == ["long 0"] and "late" not in toy.steps.seconds
    assert texts(parcels) == ["late 1"] and set(toy.steps.seconds) == {"toy", "late"}
    now, promise = toy.replay(arrival("long", 1))
    assert texts([now]) == ["long 0"] and promise.topic == "/out"
    assert decode(LogRecord, promise.make()).text == "late 2"


def test_parameter_is_read_as_in_a_launch_file_and_set_at_the_same_place_again():
    toy = work()
    assert toy.set(toy.change("least", "7")) == []
    assert texts(toy.begin()) == ["started", "least=7 after 0"]
    toy.take(NEED)
    assert texts(toy.take(arrival("a"))) == ["a 7"]
    changes = [toy.change("least", "8"), toy.change("least", "9")]
    assert texts([one for change in changes for one in toy.set(change)]) == [
        "least=8 after 1",
        "least=9 after 1",
    ]
    assert texts(toy.take(arrival("b", 1))) == ["b 9"]
    again = NodeWork(TOY, Params(), wiring("toy"), changes)
    again.begin()
    again.take(NEED)
    live = texts(again.take(arrival("a"))) + texts(again.take(arrival("b", 1)))
    assert live == ["a 0", "least=8 after 1", "least=9 after 1", "b 9"]
    params = filtering.Params()
    median = msgspec.structs.replace(params, order="median")
    assert with_parameter(params, "order", '"median"') == median
    for value in ("0", "1", "null", '"x"', "[", "NaN"):
        with pytest.raises(ValueError, match="contact cannot be"):
            with_parameter(params, "contact", value)
    with pytest.raises(ValueError, match="2002 characters are too many"):
        with_parameter(params, "order", f'"{"x" * 2000}"')


@cases(
    "change, words",
    ({"settable": {"least": "/no"}}, "'least' by '/no' is no parameter by an input"),
    ({"settable": {"most": "/in"}}, "'most' by '/in' is no parameter by an input"),
    ({"outputs": {"/out": LogRecord}}, "must publish ParameterEvent and act on nothing"),
    ({"has_side_effects": True}, "must publish ParameterEvent and act on nothing"),
)
def test_node_whose_run_could_not_be_repeated_is_refused(change: Any, words: str):
    with pytest.raises(ValueError, match=words):
        replace(TOY, **change)
    with pytest.raises(ValueError, match="cannot repeat what they published"):
        replace(SOURCE, outside=True)


@cases(
    "outputs, wired, words",
    ([("/no", WORLD)], {}, "toy published /no, which it does not .*; it declares /out, /w"),
    ([("/out", WORLD)], {}, "toy published a World on /out, declared as LogRecord"),
    ([("/out", Deferred(World, lambda _: WORLD))], {}, "published a World on /out, declared"),
    ([("/out", Deferred(LogRecord, lambda _: 7))], {}, "published a int on /out, declared"),
    ([("/w", WORLD)], {}, "toy published /w, which another finger's node publishes"),
    ([], {"inputs": (Input("a", "/a", "/odd", "World"),)}, "is wired to /odd, which it does"),
    ([], {"outputs": {"/odd": "/odd"}}, "is wired to /odd, which it does not declare"),
)
def test_node_that_does_what_it_does_not_declare_is_refused(outputs, wired, words):
    node = Node(
        params=Params,
        start=lambda params: (None, outputs),
        inputs=TOY.inputs,
        outputs={"/out": LogRecord, "/w": World},
    )
    with pytest.raises(ContractError, match=words):
        work(node=node, **{"outputs": {"/out": "/out"}, **wired}).begin()


def test_closed_streams_lead_nowhere(monkeypatch: pytest.MonkeyPatch):
    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    open_closed_streams()
    streams = [sys.stdin, sys.stdout, sys.stderr]
    assert [stream.readable() for stream in streams] == [True, False, False]
    assert sys.stdin.read() == "" and all(os.get_inheritable(stream.fileno()) for stream in streams)
    for stream in streams:
        stream.close()


class Ears(Watcher):
    """A watcher that keeps what it hears."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self.records: list[LogRecord] = []

    def received(self, topic: str, message: object) -> None:
        self.messages.append(message)

    def log(self, record: LogRecord) -> None:
        self.records.append(record)


class Kept:
    """What a sink wrote."""

    def __init__(self, types: Mapping[str, str]) -> None:
        self.types, self.entries, self.missing = dict(types), [], None

    def write(self, topic: str, header: Header, body: bytes) -> None:
        self.entries.append((topic, header.seq, body))

    def flush(self) -> None:
        pass

    def close(self, missing: Mapping[str, int]) -> None:
        self.missing = dict(missing)


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> dict[str, Kept]:
    """Modules of toy, source, sink and actor, found by name; what the sink wrote."""
    kept: dict[str, Kept] = {}

    def opened(_: object, types: Mapping[str, str]) -> Kept:
        kept["sink"] = Kept(types)
        return kept["sink"]

    acting = replace(TOY, settable={}, has_side_effects=True)
    nodes = {"a_toy": TOY, "a_source": SOURCE, "an_actor": acting}
    nodes["a_sink"] = Sink(params=Params, open=opened)
    for name, node in nodes.items():
        module = ModuleType(name)
        setattr(module, type(node).__name__.upper(), node)
        monkeypatch.setitem(sys.modules, name, module)
    return kept


def graph(toy: Params, rate: float = 0.0) -> list[Wiring]:
    params, outputs = SOURCE.params(period=0.001), {"/lines": "/lines", "/worlds": "/worlds"}
    source = wiring("source", params, "a_source", inputs=(), outputs=outputs)
    kept = (Input("toy", "/out", "/out", "LogRecord"),)
    sink = wiring("sink", module="a_sink", inputs=kept, outputs={})
    return [source, wiring("toy", toy, "a_toy", rate=rate), sink]


@pytest.mark.parametrize("schedule", [None, 1])
def test_composed_graph_ends_with_its_counts(modules: dict[str, Kept], schedule: int | None):
    ears = Ears()
    ending = run_composed(
        graph(Params(expects=4)), ends="toy", watch=["/out"], watcher=ears, schedule=schedule
    )
    assert (ending.status, ending.reason) == ("finished", "all came")
    assert [one.text for one in ears.messages] == ["started", *(f"{text} 0" for text in LINES)]
    kept = modules["sink"]
    assert [(topic, seq) for topic, seq, _ in kept.entries] == [("/out", n) for n in range(5)]
    assert kept.types == {"/out": "LogRecord"} and kept.missing == {}
    toy, source = ending.statuses["toy"], ending.statuses["source"]
    assert (toy.node, toy.messages, toy.sent, source.sent) == ("toy", 5, 5, 5)
    assert 0.0 < sum(toy.steps.values()) <= toy.cpu and set(toy.steps) == {"toy"}
    assert (ending.gaps, ending.duplicates) == (0, 0)


def test_composed_node_keeps_robot_time_and_has_stalled_without_an_end(modules: dict[str, Kept]):
    began = time.monotonic()
    run_composed(graph(Params(expects=4), rate=25.0), ends="toy", watch=[], watcher=Ears())
    assert time.monotonic() - began > 2.5 / 25.0
    ending = run_composed(graph(Params()), ends="toy", watch=[], watcher=Ears())
    assert (ending.status, ending.reason) == ("stalled", "all is quiet, and toy has not finished")


def test_node_that_raises_ends_the_graph_with_its_words(modules: dict[str, Kept]):
    ears = Ears()
    ending = run_composed(graph(Params(fails=True)), ends="toy", watch=[], watcher=ears)
    place = take.__code__.co_firstlineno + 2
    assert ending.status == "died"
    assert ending.reason.startswith("toy handling /lines 2 from source: ValueError: a taxel came")
    assert ending.reason.endswith(f"test_running.py:{place} in take)")
    assert [one.level for one in ears.records[:2]] == ["error", "debug"]
    assert "Traceback" in ears.records[1].text and modules["sink"].missing == {}


class Launched:
    """A launcher, a publisher of lines and a receiver of answers about a node in a thread."""

    def __init__(self, folder: Path) -> None:
        self.place = addresses(folder, "source", "toy", "tester")
        self._kept = ExitStack()
        context = self._kept.enter_context(zmq.Context())
        self.launcher = ControlServer(context, self.place.control)
        self._kept.callback(self.launcher.close)
        self.words: list[dict[str, Any]] = []
        self.answers: list[Received] = []
        lines = {"/lines": ("toy",), "/worlds": ("toy",)}
        self.source = self.sockets("source", publications=lines)
        self.tester: Any = None
        self.listen("/out")
        self._thread: threading.Thread | None = None

    def listen(self, topic: str) -> None:
        """Receive the answers on a topic from now on."""
        self.answers.clear()
        if self.tester is not None:
            self.tester.close()
        self.tester = self.sockets("tester", subscriptions={"toy": [topic]})

    def sockets(self, name: str, **ends: Any) -> NodeSockets:
        made = NodeSockets(name, self.place, **{"subscriptions": {}, "publications": {}, **ends})
        self._kept.callback(made.close)
        return made

    def start(self, module: str = "a_toy", params: Any = None, epoch: int = 0, **more: Any) -> None:
        """Run a node in a thread; after its first start the graph is going."""
        instance = Params() if params is None else params
        seat = wiring("toy", msgspec.msgpack.encode(instance), module, **more)
        place = replace(self.place, epoch=epoch, going=epoch > 0)
        self.code: list[int] = []
        self._thread = threading.Thread(
            target=lambda: self.code.append(run_node(seat, place, lambda end: None))
        )
        self._thread.start()

    def until(self, condition: Any) -> None:
        """Turn all ends until something is so."""
        deadline = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < deadline, (self.words, texts(self.answers))
            self.source.wait(1)
            self.tester.wait(1)
            while (word := self.launcher.receive()) is not None:
                self.words.append(word[1])
            while (answer := self.tester.receive()) is not None:
                self.answers.append(answer)

    def heard(self, kind: str) -> list[dict[str, Any]]:
        return [word for word in self.words if word["kind"] == kind]

    def tell(self, kind: str, answer: str = "", **fields: Any) -> dict[str, Any]:
        """Send a word; with an answer, the first of that kind that follows."""
        had = len(self.heard(answer))
        assert self.launcher.send("toy", kind, **fields)
        self.until(lambda: not answer or len(self.heard(answer)) > had)
        return self.heard(answer)[-1] if answer else {}

    def go(self) -> None:
        self.until(lambda: self.heard("ready"))
        self.tell("go")

    def say(self, *said: str) -> None:
        for text in said:
            self.source.send("/lines", encode(line(text)), 0.0, schema_hash(LogRecord))

    def world(self) -> None:
        self.source.send("/worlds", encode(WORLD), 0.0, schema_hash(World))

    def hears(self, *wanted: str) -> None:
        self.until(lambda: len(self.answers) >= len(wanted))
        assert texts(self.answers) == list(wanted)
        assert [one.header.seq for one in self.answers] == list(range(len(wanted)))
        assert self.tester.subscriber.gaps == 0

    def stop(self) -> NodeStatus:
        self.tell("stop", "exiting")
        self.join()
        assert self.code == [0]
        return decode(NodeStatus, self.heard("exiting")[-1]["status"])

    def join(self) -> None:
        if self._thread is not None:
            self._thread.join(20.0)
            assert not self._thread.is_alive()

    def close(self) -> None:
        if self._thread is not None and self._thread.is_alive():
            self.launcher.send("toy", "stop")
        self.join()
        self._kept.close()


@pytest.fixture
def launched(tmp_path: Path, modules: dict[str, Kept]) -> Iterator[Launched]:
    made = Launched(tmp_path)
    yield made
    made.close()


def test_node_over_sockets_answers_counts_and_takes_parameters(launched: Launched):
    launched.start(params=Params(expects=3))
    launched.until(lambda: launched.heard("ready"))
    refused = launched.tell("set", "refused", param="least", value="5", ticket=1)
    assert (refused["ticket"], refused["again"]) == (1, True)
    launched.go()
    launched.hears("started")
    assert launched.tell("count", "count", round=1)["waits"] == ["/worlds"]
    launched.world()
    launched.say("a")
    launched.hears("started", "a 0")
    refused = launched.tell("set", "refused", param="least", value='"x"', ticket=2)
    assert (refused["ticket"], refused["again"]) == (2, False)
    assert launched.tell("set", "acknowledged", param="least", value="5", ticket=3)["ticket"] == 3
    typed = {"topic": "/out", "body": encode(line("typed"))}
    launched.tell("publish", "acknowledged", **typed, ticket=4)
    launched.say("long", "c")
    launched.hears("started", "a 0", "typed", "long 5", "late 2", "c 5")
    assert [one.header.outside for one in launched.answers] == [False] * 2 + [True] + [False] * 3
    launched.until(lambda: launched.heard("finished"))
    assert launched.heard("finished") == [{"kind": "finished", "reason": "all came"}]
    count = launched.tell("count", "count", round=7)
    assert (count["round"], count["waits"], count["can_publish"]) == (7, [], False)
    assert count["sent"] == {"/out": 6, "/toy/parameter_events": 1}
    assert count["consumed"] == [("source", "/lines", 3), ("source", "/worlds", 1)]
    status = launched.stop()
    assert (status.node, status.state, status.messages, status.sent) == ("toy", "ending", 4, 7)
    assert {"toy", "late"} <= set(status.steps) and launched.heard("alive")


def test_node_that_is_started_again_goes_on_without_gap_or_repetition(launched: Launched):
    launched.start()
    launched.go()
    launched.world()
    launched.say("a")
    launched.hears("started", "a 0")
    launched.tell("set", "acknowledged", param="least", value="5", ticket=1)
    typed = {"topic": "/out", "body": encode(line("typed"))}
    launched.tell("publish", "acknowledged", **typed, ticket=2)
    launched.say("long")
    before = ["started", "a 0", "typed", "long 5", "late 2"]
    launched.hears(*before)
    launched.stop()
    for epoch in (1, 2):
        more = [f"b{epoch}", f"c{epoch}"]
        launched.start(epoch=epoch)
        launched.say(*more)
        before += [f"{text} 5" for text in more]
        launched.hears(*before)
        launched.stop()


def test_message_of_a_tool_keeps_its_place_between_parameters(launched: Launched):
    topic, least = "/toy/parameter_events", {"param": "least", "topic": "/lines", "after": 0}
    typed = encode(ParameterEvent(value="0", **least))
    for epoch in (0, 1):  # the second start publishes anew for a tester that has heard nothing
        launched.listen(topic)
        launched.start(epoch=epoch, subscribers={topic: ("tester",)})
        if epoch == 0:
            launched.go()
            launched.tell("set", "acknowledged", param="least", value="5", ticket=1)
            launched.tell("publish", "acknowledged", topic=topic, body=typed, ticket=2)
            launched.tell("set", "acknowledged", param="least", value="6", ticket=3)
        launched.world()
        launched.say("a")
        launched.until(lambda: len(launched.answers) == 3)
        values = [decode(ParameterEvent, one.body).value for one in launched.answers]
        assert values == ["5", "0", "6"]
        launched.stop()


def test_node_that_acts_handles_nothing_twice(launched: Launched):
    launched.start("an_actor", Params(expects=2), persistent=True)
    launched.go()
    launched.world()
    launched.say("a", "b")
    launched.hears("started", "a 0", "b 0")
    launched.until(lambda: launched.heard("finished"))
    launched.stop()
    launched.start("an_actor", Params(expects=2), epoch=1, persistent=True)
    launched.until(lambda: len(launched.heard("finished")) == 2)  # it tells its end again
    launched.say("c")
    launched.hears("started", "a 0", "b 0", "c 0")
    assert launched.stop().messages == 2  # what it needs, and what is new


def test_node_that_fails_tells_where_and_of_what(launched: Launched):
    launched.start(params=Params(fails=True))
    launched.go()
    launched.world()
    launched.say("a", "b", "c")
    launched.until(lambda: launched.heard("failed"))
    launched.join()
    [failed] = launched.heard("failed")
    assert failed["text"].startswith("handling /lines 2 from source: ValueError: a taxel came off")
    assert "Traceback" in failed["trace"] and launched.code == [3]


def test_source_over_sockets_pauses_steps_and_goes_on_where_it_was(launched: Launched):
    paced = SOURCE.params(period=0.002, paused=True)
    ends = {"inputs": (), "outputs": {"/lines": "/out", "/worlds": "/worlds"}}
    launched.start("a_source", paced, **ends)
    launched.go()
    launched.hears("0")
    launched.tell("step", "acknowledged", number=1, ticket=1)
    launched.hears("0", "1")
    assert launched.tell("count", "count", round=1)["can_publish"]
    launched.stop()
    launched.words.clear()
    launched.start("a_source", paced, epoch=1, **ends)
    launched.until(lambda: launched.heard("alive"))
    launched.tell("resume", "acknowledged", ticket=2)
    launched.hears(*LINES)
    launched.until(lambda: launched.heard("finished"))
    assert launched.heard("finished")[0]["reason"] == "read"
    assert not launched.tell("count", "count", round=2)["can_publish"]
    launched.stop()


def test_sink_over_sockets_writes_what_comes_and_cannot_go_on_if_started_again(
    launched: Launched, modules
):
    launched.start("a_sink", inputs=wiring("toy").inputs[:1], outputs={})
    launched.go()
    launched.say("a", "b")
    launched.until(lambda: len(modules["sink"].entries) == 2)
    launched.say("c")
    launched.until(lambda: len(modules["sink"].entries) == 3)
    launched.source.publisher.past.add("/lines", b"lost")
    launched.say("d")
    launched.stop()
    kept = modules["sink"]
    assert [(topic, seq) for topic, seq, _ in kept.entries] == [("/lines", n) for n in range(3)]
    assert kept.missing in ({"/lines": 2}, {})
    assert [decode(LogRecord, body).text for *_, body in kept.entries] == ["a", "b", "c"]
    launched.start("a_sink", inputs=wiring("toy").inputs[:1], outputs={}, epoch=1)
    launched.until(lambda: launched.heard("failed"))
    launched.join()
    assert "toy cannot continue its earlier file" in launched.heard("failed")[0]["text"]
    assert launched.code == [3]
