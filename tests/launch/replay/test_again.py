from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import pytest

from palpate.launch.override import read_settings
from palpate.launch.replay.again import replay
from palpate.messages.codec import encode, schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types import LogRecord, World
from palpate.nodes.node import Finished, Node, Outputs
from palpate.nodes.recording import describe_wirings
from palpate.nodes.wiring import Input, Wiring

Message = tuple[str, int, object]
"""Topic, sequence and message, as the recorder heard it."""
Record = Callable[..., Path]
Lines = list[str]


class Params(msgspec.Struct, frozen=True, kw_only=True):
    factor: float = 2.0


def log(value: float, text: str = "sum") -> LogRecord:
    return LogRecord(node="adder", level="info", text=text, robot_time=value)


def world(seed: int) -> World:
    return World(platform=0.0, reach=1.0, fingers=1, seed=seed)


def add(params: Params, state: float, record: LogRecord) -> tuple[float, Outputs]:
    """The sum so far, in units of the world's seed; says nothing of negative numbers."""
    state += record.robot_time
    outputs: Outputs = [("/sum", log(state * params.factor))] if record.robot_time >= 0 else []
    if record.robot_time > 100.0:
        outputs.append(Finished("enough"))
    return state, outputs


def take_seed(params: Params, state: float, message: World) -> tuple[float, Outputs]:
    return state + message.seed, []


ADDER = Node(
    params=Params,
    start=lambda params: (0.0, [("/sum", log(params.factor, "start"))]),
    inputs={"/world": (World, take_seed), "/number": (LogRecord, add)},
    outputs={"/sum": LogRecord},
    needs=("/world",),
)

INPUTS = (
    Input("simulator", "/world", "/world", "World"),
    Input("source", "/number", "/number", "LogRecord"),
)
TYPES = {"/world": "World", "/number": "LogRecord", "/sum": "LogRecord"}

THREE = read_settings(["adder.factor=3"])

GOOD: list[Message] = [
    ("/sum", 0, log(2.0, "start")),
    ("/number", 0, log(1.0)),  # heard before the world, on which the adder waits
    ("/world", 0, world(10)),
    ("/sum", 1, log(22.0)),
    ("/number", 1, log(-1.0)),
    ("/number", 2, log(5.0)),
    ("/sum", 2, log(30.0)),
]


@pytest.fixture
def adder(monkeypatch: pytest.MonkeyPatch) -> str:
    """Puts the adder where it can be imported; gives the module's name."""
    made = ModuleType("adding")
    made.NODE = ADDER  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "adding", made)
    return "adding"


@pytest.fixture
def wiring(adder: str) -> Wiring:
    return Wiring(
        name="adder",
        module=adder,
        params=Params(),
        inputs=INPUTS,
        outputs={"/sum": "/sum"},
        listeners={},
    )


@pytest.fixture
def record(tmp_path: Path, wiring: Wiring) -> Record:
    """Writes messages into a recording of the adder."""

    def write(messages: list[Message], *, graph: bytes | None = None, schema: int = 0) -> Path:
        path = tmp_path / "topics.mcap"
        about = {"graph": (describe_wirings([wiring]) if graph is None else graph).decode()}
        path.unlink(missing_ok=True)
        writer = RecordingWriter(path, TYPES, {}, about)
        for topic, seq, message in messages:
            number = schema or schema_hash(type(message))
            writer.write(topic, Header(1, 0, seq, seq, 0.0, number), encode(message))
        writer.close()
        return path

    return write


def changed(place: int, message: Message) -> list[Message]:
    return [*GOOD[:place], message, *GOOD[place + 1 :]]


def test_a_node_that_says_the_same_is_identical(record: Record) -> None:
    lines: Lines = []

    code = replay(record(GOOD), ["adder"], lines.append)

    assert (code, lines) == (0, ["adder: identical, 3 on /sum"])


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        (
            changed(6, ("/sum", 2, log(31.0))),
            "adder: differs, /sum 2 robot_time: recorded 31.0, now 30.0",
        ),
        (
            changed(0, ("/sum", 0, log(2.0, "begin"))),
            "adder: differs, /sum 0 text: recorded 'begin', now 'start'",
        ),
        (
            changed(4, ("/number", 1, log(1.0))),
            "adder: differs, /sum 2 robot_time: recorded 30.0, now 24.0",
        ),
        (GOOD[:-1], "adder: differs, /sum 2: said now, but not recorded"),
        (
            [*GOOD, ("/sum", 3, log(30.0))],
            "adder: differs, /sum 3: recorded, but not said again",
        ),
    ],
)
def test_the_first_difference_is_shown(messages: list[Message], line: str, record: Record) -> None:
    lines: Lines = []

    code = replay(record(messages), ["adder"], lines.append)

    assert (code, lines[0]) == (1, line)
    assert lines[1].split()[:4] == ["topic", "field", "compared", "differ"]


def test_a_node_that_raises_now_has_failed_whatever_was_set(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(params: Params, state: float, message: LogRecord) -> tuple[float, Outputs]:
        raise ZeroDivisionError("the step is 0")

    inputs: Mapping[str, Any] = {**ADDER.inputs, "/number": (LogRecord, fail)}
    broken = Node(params=Params, start=ADDER.start, inputs=inputs, outputs=ADDER.outputs)
    monkeypatch.setattr(sys.modules["adding"], "NODE", broken)
    lines: Lines = []

    code = replay(record(GOOD), ["adder"], lines.append)

    assert code == 1
    where = "handling /number 0 from source"
    assert lines[0] == f"adder: fails, ZeroDivisionError {where}: the step is 0"
    assert replay(record(GOOD), ["adder"], lines.append, settings=THREE) == 1


def test_with_another_parameter_the_table_is_what_was_asked_for(record: Record) -> None:
    lines: Lines = []

    code = replay(record(GOOD), ["adder"], lines.append, settings=THREE)

    assert code == 0
    assert lines == [
        "adder: differs, /sum 0 robot_time: recorded 2.0, now 3.0",
        "topic  field       compared  differ  first  largest   rms  unit",
        "/sum   robot_time         3       3      0       15  10.8  s",  # by half of 2, 22 and 30
    ]


def test_the_folder_of_a_run_stands_for_its_recording(record: Record) -> None:
    assert replay(record(GOOD).parent, ["adder"], lambda line: None) == 0


def test_a_node_that_is_named_twice_runs_once(record: Record) -> None:
    lines: Lines = []

    assert replay(record(GOOD), ["adder", "adder"], lines.append) == 0
    assert len(lines) == 1


def test_finishing_is_not_compared(record: Record) -> None:
    more = [*GOOD, ("/number", 3, log(200.0)), ("/sum", 3, log(430.0))]

    assert replay(record(more), ["adder"], lambda line: None) == 0


def test_a_recording_that_was_never_closed_is_replayed_as_far_as_it_goes(
    tmp_path: Path, wiring: Wiring
) -> None:
    path = tmp_path / "topics.mcap"
    about = {"graph": describe_wirings([wiring]).decode()}
    writer = RecordingWriter(path, TYPES, {}, about)
    for place, (topic, seq, message) in enumerate(GOOD):
        sent = 10**9 * (1 + place)  # far apart: each is written at once
        header = Header(1, 0, seq, sent, 0.0, schema_hash(type(message)))
        if place < len(GOOD) - 1:
            writer.write(topic, header, encode(message))
    lines: Lines = []

    code = replay(path, ["adder"], lines.append)
    writer.close()

    assert code == 0
    assert lines[0].endswith("topics.mcap was never closed: replaying as far as it goes")
    assert lines[1] == "adder: identical, 2 on /sum"


def test_messages_are_handed_over_in_the_order_in_which_they_were_sent(
    tmp_path: Path, wiring: Wiring, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Without needs, the world must come before the number, though it was recorded after it.
    hasty = Node(
        params=Params, start=ADDER.start, inputs=ADDER.inputs, outputs=ADDER.outputs, needs=()
    )
    monkeypatch.setattr(sys.modules["adding"], "NODE", hasty)
    path = tmp_path / "topics.mcap"
    writer = RecordingWriter(path, TYPES, {}, {"graph": describe_wirings([wiring]).decode()})
    for (topic, seq, message), sent in zip(GOOD[:4], (1, 3, 2, 4), strict=True):
        header = Header(1, 0, seq, sent, 0.0, schema_hash(type(message)))
        writer.write(topic, header, encode(message))
    writer.close()

    assert replay(path, ["adder"], lambda line: None) == 0


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        (["planner"], r"has no node 'planner'; it has \['adder'\]"),
        ([], "has no node that can be replayed exactly"),  # the adder is not palpate's own
    ],
)
def test_a_node_that_cannot_be_chosen_is_refused(
    nodes: list[str], words: str, record: Record
) -> None:
    with pytest.raises(ValueError, match=words):
        replay(record(GOOD), nodes)


def test_a_recorder_cannot_be_replayed(record: Record) -> None:
    from palpate.nodes import recorder

    sink = Wiring(
        name="recorder",
        module="palpate.nodes.recorder",
        params=recorder.Params(path="a.mcap"),
        inputs=(),
        outputs={},
        listeners={},
    )

    with pytest.raises(ValueError, match="recorder is no node that hears and says"):
        replay(record(GOOD, graph=describe_wirings([sink])), ["recorder"])


def test_a_recording_that_does_not_name_its_nodes_is_refused(record: Record) -> None:
    with pytest.raises(ValueError, match="does not say which nodes made it"):
        replay(record(GOOD, graph=b""), ["adder"])


def test_a_module_that_is_not_there_is_named(record: Record, wiring: Wiring) -> None:
    graph = describe_wirings([wiring]).replace(b'"adding"', b'"gone_away"')

    with pytest.raises(ValueError, match="no module 'gone_away'"):
        replay(record(GOOD, graph=graph), ["adder"])


@pytest.mark.parametrize(
    ("then", "gone"), [('"local":"/number"', '"local":"/in"'), ('{"/sum":', '{"/in":')]
)
def test_a_node_that_has_other_topics_by_now_is_refused(
    then: str, gone: str, record: Record, wiring: Wiring
) -> None:
    graph = describe_wirings([wiring]).decode().replace(then, gone).encode()

    with pytest.raises(ValueError, match="adder is wired to /in, which it does not declare; it"):
        replay(record(GOOD, graph=graph), ["adder"])


def test_a_lost_message_is_named(record: Record) -> None:
    with pytest.raises(ValueError, match="lacks /number 1: it has 2 instead"):
        replay(record([*GOOD[:4], *GOOD[5:]]), ["adder"])


def test_messages_of_another_version_are_refused(record: Record) -> None:
    with pytest.raises(
        ValueError, match=r"/sum was recorded with another version of LogRecord \(schema 0000002a,"
    ):
        replay(record(GOOD, schema=42), ["adder"])


def test_a_recording_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="the recording does not exist"):
        replay(tmp_path / "none.mcap", ["adder"])
