from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.messages.codec import Header, decode, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import Clock, LogRecord
from palpate.messages.types.motion import Probe
from palpate.messages.types.world import World
from palpate.nodes.player import SOURCE, Params, outputs, play
from palpate.nodes.runtime.node import Finished, Timed

TYPES: Mapping[str, type] = {"/world": World, "/log": LogRecord, "/clock": Clock}


def world(seed: int) -> World:
    return World(platform=0.0, reach=0.3, fingers=1, seed=seed)


def log(number: int) -> LogRecord:
    return LogRecord(node="n", level="info", text=str(number), robot_time=0.0)


Entry = tuple[float, str, object]


def record(path: Path, entries: Sequence[Entry], types: Mapping[str, type] = TYPES) -> Path:
    """A recording of messages, each sent at a time, s."""
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
    entries: list[Entry] = [(0.0, "/world", world(1)), (0.05, "/world", world(2))]
    entries += [(0.1 * number, "/log", log(number)) for number in range(1, 11)]
    return record(tmp_path / "bag.mcap", entries)


def published(bag: Path, **params: Any) -> list[tuple[float, str, Any]]:
    """Time, topic and number of what is published before it has finished."""
    words = [one for one in play(Params(path=str(bag), **params)) if isinstance(one, Timed)]
    return [(round(one.due, 9), one.topic, _number(one)) for one in words]


def _number(one: Timed) -> Any:
    if isinstance(one.message, Clock):
        return round(one.message.time, 9)
    assert isinstance(one.message, bytes)
    if one.topic == "/clock":
        return decode(Clock, one.message).time
    if one.topic == "/world":
        return decode(World, one.message).seed
    return int(decode(LogRecord, one.message).text)


def test_everything_is_published_at_its_time(bag: Path):
    words = published(bag)
    assert words[:3] == [(0.0, "/world", 1), (0.05, "/world", 2), (0.1, "/log", 1)]
    assert words[-1] == (1.0, "/log", 10)
    assert len(words) == 12


def test_at_twice_the_rate_it_takes_half_the_time(bag: Path):
    assert published(bag, rate=2.0)[-1] == (0.5, "/log", 10)


def test_what_was_latched_before_the_offset_is_published_first_and_only_that(bag: Path):
    words = published(bag, start_offset=0.55)
    assert words[:3] == [(0.0, "/world", 2), (0.05, "/log", 6), (0.15, "/log", 7)]


def test_of_latched_topics_that_keep_all_all_are_published(tmp_path: Path):
    def probe(id_: int) -> Probe:
        zero = np.zeros(3)
        return Probe(
            id=id_, finger=1, outcome="hit", point=zero, normal=zero, touches=1, robot_time=0.0
        )

    entries: list[Entry] = [(0.1 * id_, "/probe/traced", probe(id_)) for id_ in range(5)]
    bag = record(tmp_path / "p.mcap", entries, {"/probe/traced": Probe})
    words = [
        one for one in play(Params(path=str(bag), start_offset=0.35)) if isinstance(one, Timed)
    ]
    assert [decode(Probe, one.message).id for one in words] == [0, 1, 2, 3, 4]  # type: ignore[arg-type]
    assert [round(one.due, 9) for one in words] == [0.0, 0.0, 0.0, 0.0, 0.05]


def test_an_offset_beyond_the_end_tells_what_is_latched(bag: Path):
    assert published(bag, start_offset=9.0) == [(0.0, "/world", 2)]


def test_it_ends_where_it_is_told_to(bag: Path):
    assert published(bag, until=0.25)[-1] == (0.2, "/log", 2)


def test_only_the_topics_that_are_asked_for_are_played(bag: Path):
    assert {topic for _, topic, _ in published(bag, topics=("/log",))} == {"/log"}
    assert list(outputs(Params(path=str(bag), topics=("/log",)))) == ["/log"]


def test_a_loop_begins_anew_after_a_pause(bag: Path):
    words = list(islice(play(Params(path=str(bag), loop=True, rate=2.0)), 25))
    assert not any(isinstance(one, Finished) for one in words)
    dues = [one.due for one in words if isinstance(one, Timed)]
    assert dues[12] == pytest.approx(0.5 + 0.5)
    assert dues[24] == pytest.approx(2.0)


def test_a_loop_over_nothing_ends(bag: Path):
    [end] = play(Params(path=str(bag), loop=True, topics=("/log",), until=0.05))
    assert end == Finished("played 0 messages")


def test_the_clock_ticks_in_the_recordings_time(bag: Path):
    words = published(bag, clock=10.0, rate=2.0, start_offset=0.15, until=0.85)
    ticks = [(due, time) for due, topic, time in words if topic == "/clock"]
    assert ticks == [(0.0, 0.15), (0.1, 0.35), (0.2, 0.55), (0.3, 0.75)]
    assert outputs(Params(path=str(bag), clock=10.0))["/clock"] is Clock


def test_a_recorded_clock_gives_way_to_its_own(tmp_path: Path):
    entries: list[Entry] = [(0.0, "/clock", Clock(time=99.0)), (0.1, "/log", log(1))]
    bag = record(tmp_path / "c.mcap", entries)
    assert [n for _, topic, n in published(bag, clock=1.0) if topic == "/clock"] == [0.0]
    assert [n for _, topic, n in published(bag) if topic == "/clock"] == [99.0]


def test_it_tells_how_much_it_has_played(bag: Path):
    assert list(play(Params(path=str(bag))))[-1] == Finished("played 12 messages")


def test_a_topic_that_was_not_recorded_is_refused(bag: Path):
    with pytest.raises(ValueError, match=r"has no topic '/lag'; it has /log, /world"):
        outputs(Params(path=str(bag), topics=("/lag",)))


def test_types_of_another_version_are_refused(tmp_path: Path):
    path = tmp_path / "old.mcap"
    writer = RecordingWriter(path, {"/log": "LogRecord"}, {}, {"version": "1"})
    writer.write("/log", Header(1, 0, 0, 5, 0.0, 0xBAD), b"\x80")
    writer.close()
    with pytest.raises(ValueError, match="recorded with another version of LogRecord"):
        outputs(Params(path=str(path)))


def test_a_missing_recording_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="cannot be read: No such file"):
        outputs(Params(path=str(tmp_path / "none.mcap")))


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"rate": 0.0}, "> 0.0"),
        ({"start_offset": -1.0}, ">= 0.0"),
        ({"start_offset": 2.0, "until": 1.0}, "until must be later than start_offset 2 s, got 1"),
        ({"speed": 2.0}, "unknown field"),
    ],
)
def test_parameters_out_of_range_are_refused(params: dict[str, Any], words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert({"path": "a", **params}, Params)


def test_it_stands_still_at_first_if_it_is_told_to(bag: Path):
    assert SOURCE.paused(Params(path=str(bag), paused=True))
    assert not SOURCE.paused(Params(path=str(bag)))
