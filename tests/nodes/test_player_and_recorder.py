"""Player and recorder: a recording is published again at its times, and kept with its graph."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import pytest

import palpate
from palpate.messages import Header, decode, encode, schema_hash
from palpate.messages.recording import RecordingWriter, open_recording
from palpate.messages.types import Clock, LogRecord, Probe, World
from palpate.nodes import player, recorder
from palpate.nodes.runtime.node import (
    Finished,
    Input,
    Timed,
    Wiring,
    publishers_of,
    recorded_nodes,
    schemas_of,
    with_description,
)
from palpate.nodes.runtime.testing import example
from tests.messages.cases import cases

TYPES: Mapping[str, type] = {"/world": World, "/log": LogRecord, "/clock": Clock}
Entry = tuple[float, str, object]
LOG = [(0.1 * n, "/log", example(LogRecord, level="info", text=str(n))) for n in range(1, 11)]
WORLDS = [(0.0, "/world", example(World, seed=1)), (0.05, "/world", example(World, seed=2))]


def record(path: Path, entries: Sequence[Entry], types: Mapping[str, type] = TYPES) -> Path:
    """A recording of messages, each sent at a time [s]."""
    names = {topic: cls.__name__ for topic, cls in types.items()}
    writer = RecordingWriter(path, names, {}, {"version": "1"})
    seqs: dict[str, int] = {}
    for when, topic, message in entries:
        seq = seqs[topic] = seqs.get(topic, -1) + 1
        sent_ns = 7_000_000_000 + round(1e9 * when)
        header = Header(1, 0, seq, sent_ns, 0.0, schema_hash(type(message)))
        writer.write(topic, header, encode(message))
    writer.close()
    return path


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return record(tmp_path / "bag.mcap", [*WORLDS, *LOG])


def played(bag: Path, **params: Any) -> list[tuple[float, str, Any]]:
    """Time, topic and number of what is published before it has finished."""
    found = player.SOURCE.open(player.Params(path=str(bag), **params))
    return [(round(one.due, 9), one.topic, _number(one)) for one in found if isinstance(one, Timed)]


def _number(timed: Timed) -> Any:
    if isinstance(timed.message, Clock):
        return round(timed.message.time, 9)
    message: Any = decode(TYPES.get(timed.topic, Probe), timed.message)  # type: ignore[arg-type]
    values = (getattr(message, name, None) for name in ("time", "seed", "text", "id"))
    return next(int(value) for value in values if value is not None)


WHOLE = [(0.0, "/world", 1), (0.05, "/world", 2), *((n / 10, "/log", n) for n in range(1, 11))]


@cases(
    "params, wanted",
    ({}, WHOLE),
    ({"rate": 2.0}, [(due / 2.0, topic, n) for due, topic, n in WHOLE]),
    # What was latched before the offset is published first, and only that.
    (
        {"start_offset": 0.55},
        [(0.0, "/world", 2), *((round(n / 10 - 0.55, 9), "/log", n) for n in range(6, 11))],
    ),
    ({"start_offset": 9.0}, [(0.0, "/world", 2)]),
    ({"until": 0.25}, WHOLE[:4]),
    ({"topics": ("/log",)}, WHOLE[2:]),
    ({"topics": ("/world",), "until": 0.01}, WHOLE[:1]),
)
def test_messages_are_published_at_their_times(bag: Path, params: dict[str, Any], wanted: Any):
    assert played(bag, **params) == wanted
    parsed = player.Params(path=str(bag), **params)
    assert list(player.SOURCE.open(parsed))[-1] == Finished(f"played {len(wanted)} messages")
    assert [*player.outputs(parsed)] == sorted(params.get("topics", ("/log", "/world")))


def test_latched_messages_come_first_loops_begin_anew_and_clocks_tick(tmp_path: Path, bag: Path):
    entries = [(0.1 * n, "/probe/traced", example(Probe, id=n)) for n in range(5)]
    probes = record(tmp_path / "p.mcap", entries, {"/probe/traced": Probe})
    found = played(probes, start_offset=0.35)
    assert [(due, n) for due, _, n in found] == [(0.0, n) for n in range(4)] + [(0.05, 4)]
    params = player.Params(path=str(bag), loop=True, rate=2.0)
    dues = [one.due for one in islice(player.play(params), 25)]
    assert (dues[12], dues[24]) == (pytest.approx(1.0), pytest.approx(2.0))
    nothing = player.Params(path=str(bag), loop=True, topics=("/log",), until=0.05)
    assert list(player.play(nothing)) == [Finished("played 0 messages")]
    found = played(bag, clock=10.0, rate=2.0, start_offset=0.15, until=0.85)
    ticks = [(due, time) for due, topic, time in found if topic == "/clock"]
    assert ticks == [(0.0, 0.15), (0.1, 0.35), (0.2, 0.55), (0.3, 0.75)]
    assert player.outputs(player.Params(path=str(bag), clock=10.0))["/clock"] is Clock
    recorded = record(tmp_path / "c.mcap", [(0.0, "/clock", Clock(time=99.0)), *LOG[:1]])
    for clock, times in ((1.0, [0.0]), (0.0, [99])):  # a recorded clock gives way to its own
        assert [n for _, topic, n in played(recorded, clock=clock) if topic == "/clock"] == times


def test_recording_that_cannot_be_played_is_refused(bag: Path, tmp_path: Path):
    with pytest.raises(ValueError, match=r"has no topic '/lag'; it has /log, /world"):
        player.outputs(player.Params(path=str(bag), topics=("/lag",)))
    with pytest.raises(ValueError, match="cannot be read: No such file"):
        player.outputs(player.Params(path=str(tmp_path / "none.mcap")))
    writer = RecordingWriter(tmp_path / "old.mcap", {"/log": "LogRecord"}, {}, {"version": "1"})
    writer.write("/log", Header(1, 0, 0, 5, 0.0, 0xBAD), b"\x80")
    writer.close()
    with pytest.raises(ValueError, match="recorded with another version of LogRecord"):
        player.outputs(player.Params(path=str(tmp_path / "old.mcap")))


@cases(
    "params, words",
    ({"rate": 0.0}, "> 0.0"),
    ({"start_offset": -1.0}, ">= 0.0"),
    ({"start_offset": 2.0, "until": 1.0}, "until must be later than start_offset 2 s, got 1"),
    ({"speed": 2.0}, "unknown field"),
)
def test_parameters_of_the_player_out_of_range_are_refused(params: dict[str, Any], words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert({"path": "a", **params}, player.Params)


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    mesh: bytes
    size: tuple[float, float]


SIMULATOR = Wiring(
    name="simulator",
    module="palpate.nodes.simulator",
    params=Settings(mesh=b"\0\xff", size=(0.1, 1e-300)),
    inputs=(Input("tracer", "/f1/goal", "/goal", "TouchGoal"),),
    outputs={"/world": "/f1/world"},
    subscribers={"/f1/world": ("recorder",)},
    schemas={"Own": "{}"},
)


def test_recorder_keeps_messages_with_the_graph_they_came_from(tmp_path: Path):
    path = tmp_path / "topics.mcap"
    own = Wiring(
        name="recorder",
        module="palpate.nodes.recorder",
        params=recorder.Params(path=str(path)),
        inputs=(Input("simulator", "/f1/world", "/f1/world", "World"),),
        outputs={},
        subscribers={},
    )
    first, described = with_description([SIMULATOR, own], {"seed": "7"})
    assert first is SIMULATOR and described.params.about == {"seed": "7"}
    writer = recorder.SINK.open(described.params, {"/f1/world": "World"})
    body = encode(example(World, seed=3))
    writer.write("/f1/world", Header(1, 0, 0, 5, 0.0, schema_hash(World)), body)
    writer.close({})
    bag = open_recording(path)
    assert bag.version == palpate.__version__ and bag.about["seed"] == "7"
    assert [(kept.body, kept.publisher) for kept in bag.messages()] == [(body, "simulator")]
    node, recorder_node = recorded_nodes(bag.graph)
    assert (node.name, recorder_node.name) == ("simulator", "recorder")
    back = node.wiring(Settings)
    names = ("name", "module", "params", "inputs", "outputs", "schemas")
    assert all(getattr(back, name) == getattr(SIMULATOR, name) for name in names)
    assert publishers_of(bag.graph) == {"/f1/world": "simulator"}
    assert schemas_of(bag.graph) == {"Own": "{}"} and schemas_of(b"") == {}
    with pytest.raises(ValueError, match="the recorded parameters of simulator do not fit"):
        node.wiring(recorder.Params)


def test_text_that_describes_no_graph_or_file_is_refused(tmp_path: Path):
    assert publishers_of(b"") == {}
    with pytest.raises(ValueError, match="this is no description of a graph"):
        recorded_nodes(b"{]")
    for path in ("", "runs/"):
        with pytest.raises(ValueError, match="path must name a file, got"):
            recorder.Params(path=path)
    with pytest.raises(msgspec.ValidationError, match="unknown field `colour`"):
        msgspec.convert({"path": "a", "colour": 1}, recorder.Params)
    recorder.SINK.open(recorder.Params(path=str(tmp_path / "a")), {}).close({})
    assert open_recording(tmp_path / "a").graph == b""
