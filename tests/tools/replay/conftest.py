import sys
from types import ModuleType

import msgspec
import pytest

from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.nodes.runtime.node import Input, Node, Wiring, describe_wirings


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    gain: float = 2.0
    copies: int = 1  # How often it says what it says
    late: int = 0  # For so many inputs it is silent, and then says all at once
    fails_at: float = -1.0


def log(value):
    return LogRecord(node="x", level="info", text="", robot_time=value)


def pass_on(params, state, record):
    if record.robot_time == params.fails_at:
        raise ArithmeticError("no\nmore")
    state = (*state, params.gain * record.robot_time)
    if len(state) <= params.late:
        return state, []
    return (), [("/out", log(value)) for value in state for _ in range(params.copies)]


NODE = Node(
    params=Params,
    start=lambda params: ((), []),
    inputs={"/in": (LogRecord, pass_on)},
    outputs={"/out": LogRecord},
)


@pytest.fixture
def chain(monkeypatch):
    """Two nodes: the first doubles ``/a`` into ``/b``, the second doubles ``/b`` into ``/c``."""
    made = ModuleType("links")
    made.NODE = NODE
    monkeypatch.setitem(sys.modules, "links", made)
    places = (("first", "source", "/a", "/b"), ("second", "first", "/b", "/c"))
    return [
        Wiring(
            name=name,
            module="links",
            params=Params(),
            inputs=(Input(publisher, received, "/in", "LogRecord"),),
            outputs={"/out": published},
            subscribers={},
        )
        for name, publisher, received, published in places
    ]


@pytest.fixture
def record_chain(tmp_path, chain):
    """Writes topics and values into a recording of the two nodes, in the order of sending."""

    def write(published):
        path = tmp_path / "topics.mcap"
        about = {"graph": describe_wirings(chain).decode()}
        writer = RecordingWriter(path, dict.fromkeys(("/a", "/b", "/c"), "LogRecord"), {}, about)
        counts: dict[str, int] = {}
        for place, (topic, value) in enumerate(published):
            seq = counts.get(topic, 0)
            counts[topic] = seq + 1
            header = Header(1, 0, seq, place, 0.0, schema_hash(LogRecord))
            writer.write(topic, header, encode(log(value)))
        writer.close()
        return path

    return write
