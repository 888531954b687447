from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.steps import Steps
from palpate.messages.bus.subscriber import Received
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.world import World
from palpate.nodes.runtime import work
from palpate.nodes.runtime.node import Deferred, Finished, Input, Node, Outputs, Sink, Wiring
from palpate.nodes.runtime.work import (
    ContractError,
    CpuSteps,
    Latency,
    NodeWork,
    Outgoing,
    Promise,
    SinkWork,
)


class Params(msgspec.Struct, frozen=True):
    publications: Any = None


def line(text: str) -> LogRecord:
    return LogRecord(node="n", level="info", text=text, robot_time=2.5)


def on_line(params: Params, received: list[str], message: LogRecord) -> tuple[list[str], Outputs]:
    return [*received, message.text], list(params.publications or [])


NODE = Node(
    params=Params,
    start=lambda params: ([], [("/out", line("started"))]),
    inputs={"/in": (LogRecord, on_line), "/need": (LogRecord, on_line)},
    outputs={"/out": LogRecord, "/flat": World},
    needs=("/need",),
)
WORLD = World(platform=0.0, reach=0.1, fingers=1, seed=1)
WIRING = Wiring(
    name="node",
    module="",
    params=b"",
    inputs=(
        Input("other", "/a/in", "/in", "LogRecord"),
        Input("needed", "/a/need", "/need", "LogRecord"),
    ),
    outputs={"/out": "/a/out", "/flat": "/a/flat"},
    subscribers={},
)
ALONE = WIRING.inputs[:1]


def arrival(publisher: str, topic: str, text: str, seq: int = 0, schema: int = 0) -> Received:
    header = Header(1, 0, seq, 0, 0.0, schema or schema_hash(LogRecord))
    return Received(publisher, topic, header, encode(line(text)))


def frame(text: str, seq: int = 0) -> Received:
    return arrival("other", "/a/in", text, seq)


def need(text: str) -> Received:
    return arrival("needed", "/a/need", text)


def started(*publications: object) -> NodeWork:
    work = NodeWork(NODE, Params(list(publications)), WIRING)
    work.begin()
    return work


def test_what_a_node_publishes_goes_to_its_topic_on_the_wire():
    [parcel] = NodeWork(NODE, Params(), WIRING).begin()
    assert parcel == Outgoing("/a/out", encode(line("started")), 2.5, schema_hash(LogRecord))


def test_a_message_without_robot_time_carries_zero():
    [parcel] = started(("/flat", WORLD)).take(need("n"))
    assert isinstance(parcel, Outgoing) and parcel.robot_time == 0.0


def test_nothing_is_handled_before_what_is_needed_has_come():
    work = started(("/out", line("x")))
    assert work.take(frame("1", 0)) == [] and work.take(frame("2", 1)) == []
    assert work.consumed["other", "/a/in"] == 0
    assert work.waits == ["/a/need"]
    assert len(work.take(need("n"))) == 3
    assert work._state == ["n", "1", "2"]
    assert work.waits == []
    assert work.consumed == {("other", "/a/in"): 2, ("needed", "/a/need"): 1}
    assert work.latency.count == 3


def test_a_need_that_is_not_wired_is_not_waited_for():
    wiring = Wiring(
        name="node", module="", params=b"", inputs=ALONE, outputs=WIRING.outputs, subscribers={}
    )
    work = NodeWork(NODE, Params(), wiring)
    work.begin()
    work.take(frame("1"))
    assert work._state == ["1"]


def test_finished_is_handed_on_in_its_place():
    published = started(("/out", line("a")), Finished("done")).take(need("n"))
    assert published[1] == Finished("done")


@pytest.mark.parametrize(
    ("output", "words"),
    [
        (("/nowhere", WORLD), "node published /nowhere, which it does not declare; it declares "),
        (("/out", WORLD), "node published a World on /out, declared as LogRecord"),
    ],
)
def test_an_output_that_is_not_declared_is_refused(output: object, words: str):
    with pytest.raises(ContractError, match=words):
        started(output).take(need("n"))


def test_an_output_that_another_fingers_node_publishes_is_refused():
    wiring = replace(WIRING, outputs={"/flat": "/a/flat"})
    with pytest.raises(ContractError, match="node published /out, which another finger's node"):
        NodeWork(NODE, Params(), wiring).begin()


def test_a_message_of_another_schema_is_refused():
    with pytest.raises(ContractError, match="/a/need is not a LogRecord of this version"):
        started().take(arrival("needed", "/a/need", "n", schema=77))


def test_a_wiring_that_names_no_input_of_the_node_is_refused():
    strange = Input("other", "/a/in", "/strange", "LogRecord")
    wiring = Wiring(
        name="node", module="", params=b"", inputs=(strange,), outputs={}, subscribers={}
    )
    with pytest.raises(ContractError, match="node is wired to /strange, which it does not"):
        NodeWork(NODE, Params(), wiring)


def test_what_a_node_was_doing_is_known_when_it_fails():
    work = started()
    with pytest.raises(ValueError, match="not a LogRecord"):
        work.take(need("n")._replace(body=b"\x80"))
    assert work.doing == "handling /a/need 0 from needed"


class Kept:
    def __init__(self, _: Params, topics: Mapping[str, str]) -> None:
        self.topics = dict(topics)
        self.entries: list[tuple[str, int, bytes]] = []
        self.closed = False

    def write(self, topic: str, header: Header, body: bytes) -> None:
        self.entries.append((topic, header.seq, body))

    def flush(self) -> None:
        self.entries.append(("flush", 0, b""))

    def close(self, missing: Mapping[str, int]) -> None:
        self.closed, self.missing = True, dict(missing)


def test_a_sink_writes_what_it_receives_undecoded():
    made: list[Kept] = []

    def open_kept(params: Params, topics: Mapping[str, str]) -> Kept:
        made.append(Kept(params, topics))
        return made[0]

    work = SinkWork(Sink(params=Params, open=open_kept), Params(), WIRING)
    assert work.begin() == [] and work.take(frame("1", 4)) == []
    assert work.unwritten
    work.flush()
    assert not work.unwritten
    work.missing = {"/a/in": 2}
    work.close()
    [kept] = made
    assert kept.topics == {"/a/in": "LogRecord", "/a/need": "LogRecord"}
    assert kept.entries == [("/a/in", 4, encode(line("1"))), ("flush", 0, b"")]
    assert kept.closed
    assert kept.missing == {"/a/in": 2}
    assert work.consumed["other", "/a/in"] == 1


def later_work(made: list[int], cls: type = LogRecord) -> NodeWork:
    def make(_: object) -> object:
        made.append(1)
        return line("late")

    work = NodeWork(NODE, Params([("/out", Deferred(cls, make))]), replace(WIRING, inputs=ALONE))
    work.begin()
    return work


def test_a_message_that_takes_long_is_made_at_once():
    made: list[int] = []
    [parcel] = later_work(made).take(frame("1"))
    assert isinstance(parcel, Outgoing) and made == [1]
    assert (parcel.body, parcel.robot_time) == (encode(line("late")), 2.5)


def test_what_takes_no_time_does_not_wait_for_what_does():
    made: list[int] = []
    later = Deferred(LogRecord, lambda _: made.append(1) or line("late"))
    work = started(("/out", line("now")), ("/out", later))
    parcels = work.each(need("1"))
    assert next(parcels).body == encode(line("now")) and made == []  # type: ignore[union-attr]
    assert next(parcels).body == encode(line("late")) and made == [1]  # type: ignore[union-attr]
    assert list(parcels) == [] and work.latency.count == 1


def test_one_that_had_been_published_is_only_promised():
    made: list[int] = []
    [promise] = later_work(made).replay(frame("1"))
    assert isinstance(promise, Promise) and made == []
    assert (promise.topic, promise.schema) == ("/a/out", schema_hash(LogRecord))
    assert promise.make() == encode(line("late")) and made == [1]


def test_a_promise_of_another_type_is_refused():
    with pytest.raises(ContractError, match="published a World on /out, declared as LogRecord"):
        later_work([], World).replay(frame("1"))
    work = NodeWork(
        NODE, Params([("/out", Deferred(LogRecord, lambda _: 7))]), replace(WIRING, inputs=ALONE)
    )
    work.begin()
    with pytest.raises(ContractError, match="published a int on /out, declared as LogRecord"):
        work.take(frame("1"))


def test_processor_time_is_counted_by_steps_and_one_within_another_interrupts_it(
    monkeypatch: pytest.MonkeyPatch,
):
    times = iter([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    monkeypatch.setattr(work.time, "thread_time", lambda: next(times))
    steps = CpuSteps()
    with steps("casting"):
        with steps("ends"):
            pass
        with pytest.raises(ValueError, match="no end"), steps("ends"):
            raise ValueError("no end")
    assert steps.seconds == {"casting": 1.0 + 4.0 + 16.0, "ends": 2.0 + 8.0}


def test_a_node_and_what_it_makes_later_tell_their_steps():
    def make(step: Steps) -> object:
        with step("lattice"):
            return line("late")

    work = started(("/out", Deferred(LogRecord, make)))
    work.take(need("1"))
    assert set(work.steps.seconds) == {WIRING.name, "lattice"}
    assert set(later_work([]).steps.seconds) == {WIRING.name}


def test_without_durations_every_quantile_is_zero():
    assert Latency().quantile(0.5) == 0.0


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_quantiles_are_right_to_the_width_of_a_bin(share: float):
    micro = np.random.default_rng(1).lognormal(3.0, 1.0, 20_000) + 1.0
    latency = Latency()
    for value in micro:
        latency.add(int(value * 1000))
    assert latency.count == 20_000
    assert latency.quantile(share) == pytest.approx(np.quantile(micro, share), rel=0.03)


def test_the_longest_durations_share_the_last_bin():
    latency = Latency()
    latency.add(10**18)
    assert latency.quantile(0.5) > 1e9
