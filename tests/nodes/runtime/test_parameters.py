"""Parameters that are set while a node runs: where, how they are told, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from msgspec import Struct, structs

from palpate.messages.bus.message_log import ParameterLog
from palpate.messages.bus.subscriber import Received
from palpate.messages.codec import Header, decode, encode, schema_hash
from palpate.messages.types.catalogue import LogRecord, ParameterEvent
from palpate.nodes import filter as filtering
from palpate.nodes.runtime.node import Input, Node, Outputs, lone_wiring, with_parameter
from palpate.nodes.runtime.work import NodeWork, Outgoing


class Params(Struct, frozen=True, kw_only=True):
    least: int = 0
    other: int = 0


def line(text: str) -> LogRecord:
    return LogRecord(node="n", level="info", text=text, robot_time=0.0)


def take(params: Params, state: None, message: LogRecord) -> tuple[None, Outputs]:
    return None, [("/out", line(f"{message.text} {params.least}"))]


NODE = Node(
    params=Params,
    start=lambda params: (None, [("/out", line(f"start {params.least}"))]),
    inputs={"/in": (LogRecord, take), "/aside": (LogRecord, take)},
    outputs={"/out": LogRecord, "/n/parameter_events": ParameterEvent},
    settable={"least": "/in"},
)
WIRING = lone_wiring(
    Params(), (Input("a", "/in", "/in", ""), Input("b", "/aside", "/aside", "")), NODE.outputs
)


def arrival(topic: str, number: int) -> Received:
    header = Header(1, 0, number, 0, 0.0, schema_hash(LogRecord))
    return Received("a" if topic == "/in" else "b", topic, header, encode(line(f"{number}")))


def told(published: list[Any]) -> list[str]:
    """What was published, in a word each: the texts, and parameters as they were set."""
    words = []
    for one in published:
        assert isinstance(one, Outgoing)
        if one.topic == "/out":
            words.append(decode(LogRecord, one.body).text)
        else:
            event = decode(ParameterEvent, one.body)
            words.append(f"{event.param}={event.value} after {event.after}")
    return words


def test_a_parameter_is_set_between_two_messages_and_told():
    work = NodeWork(NODE, Params(), WIRING)
    assert told(work.begin()) == ["start 0"]
    assert told(work.take(arrival("/in", 0))) == ["0 0"]
    assert told(work.set(work.change("least", "7"))) == ["least=7 after 1"]
    assert told(work.take(arrival("/in", 1))) == ["1 7"]


def test_what_is_set_before_the_start_counts_from_the_start_on():
    work = NodeWork(NODE, Params(), WIRING)
    assert work.set(work.change("least", "7")) == []
    assert told(work.begin()) == ["start 0", "least=7 after 0"]
    assert told(work.take(arrival("/in", 0))) == ["0 7"]


def test_it_is_set_at_the_same_message_again_in_whatever_order_others_come():
    work = NodeWork(NODE, Params(), WIRING)
    work.begin()
    live: list[Any] = work.take(arrival("/in", 0)) + work.take(arrival("/aside", 0))
    changes = [work.change("least", "7"), work.change("least", "8")]
    live += [one for change in changes for one in work.set(change)]
    live += work.take(arrival("/in", 1))
    again = NodeWork(NODE, Params(), WIRING, changes)
    published = again.begin()
    for one in (arrival("/in", 0), arrival("/in", 1), arrival("/aside", 0)):
        published += again.take(one)
    assert told(live) == ["0 0", "0 0", "least=7 after 1", "least=8 after 1", "1 8"]
    assert told(published) == ["start 0", "0 0", *told(live)[2:], "0 8"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"settable": {"least": "/no"}}, "'least' by '/no' is no parameter by an input"),
        ({"settable": {"most": "/in"}}, "'most' by '/in' is no parameter by an input"),
        ({"outputs": {"/out": LogRecord}}, "must publish ParameterEvent and act on nothing"),
        ({"has_side_effects": True}, "must publish ParameterEvent and act on nothing"),
    ],
)
def test_a_node_whose_run_could_not_be_repeated_is_refused(change: Any, words: str):
    with pytest.raises(ValueError, match=words):
        replace(NODE, **change)


def test_a_value_is_taken_as_a_launch_file_would():
    params = filtering.Params()
    assert with_parameter(params, "order", '"median"') == structs.replace(params, order="median")
    for value in ("0", "1", "null", '"x"', "[", "NaN"):
        with pytest.raises(ValueError, match="contact cannot be"):
            with_parameter(params, "contact", value)
    with pytest.raises(ValueError, match="2002 characters are too many"):
        with_parameter(params, "order", f'"{"x" * 2000}"')


def test_what_was_put_down_outlives_the_node_but_for_a_line_that_was_cut_off(tmp_path):
    journal = tmp_path / "j0"
    log = ParameterLog(journal)
    log.note(b"one")
    log.note(b"two")
    log.close()
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes() + b"thr")
    log = ParameterLog(journal)
    assert log.before == [b"one\n", b"two\n"]
    log.note(b"three")
    log.close()
    log = ParameterLog(journal)
    assert log.before == [b"one\n", b"two\n", b"three\n"]
    log.close()
