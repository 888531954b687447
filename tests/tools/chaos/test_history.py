from collections.abc import Mapping
from typing import NamedTuple

import msgpack
import pytest

from palpate.messages.codec import Header
from palpate.messages.recording.writer import RecordingWriter
from palpate.tools.chaos.history import (
    Event,
    History,
    causality_violations,
    digests,
    read_history,
    violations_in,
)


class Line(NamedTuple):
    topic: str
    seq: int
    sent_ns: int
    body: Mapping[str, int]
    epoch: int = 0


PUBLISHERS = {
    "/contour/goal": "planner",
    "/plan/done": "planner",
    "/model/goal": "planner",
    "/finger/goal": "tracer",
    "/touch/raw": "simulator",
    "/model/shape": "reconstructor",
    "/finger_2/finger/goal": "tracer_2",
    "/finger_2/touch/image": "filter_2",
    "/finger_2/touch/raw": "simulator_2",
}
TYPES = dict.fromkeys(PUBLISHERS, "Clock")
GOOD = (
    Line("/contour/goal", 0, 10, {"id": 0}),
    Line("/finger/goal", 0, 20, {"goal": 0, "touch": 0}),
    Line("/touch/raw", 0, 30, {"goal": 0, "touch": 0}),
    Line("/finger/goal", 1, 40, {"goal": 0, "touch": 1}),
    Line("/touch/raw", 1, 50, {"goal": 0, "touch": 1}, 1),
    Line("/model/goal", 0, 60, {"number": 0}),
    Line("/model/shape", 0, 70, {"number": 0}),
    Line("/plan/done", 0, 80, {"number": 1}),
    Line("/model/shape", 1, 90, {"number": 1}),
    Line("/finger_2/finger/goal", 0, 92, {"goal": 0, "touch": 0}),
    Line("/finger_2/touch/raw", 0, 95, {"goal": 0, "touch": 0}),
    Line("/finger_2/touch/image", 0, 96, {"goal": 0, "touch": 0}),
)


def write(path, lines, *, closed=True):
    writer = RecordingWriter(path, TYPES, PUBLISHERS, {"version": "test"})
    for line in lines:
        header = Header(1, line.epoch, line.seq, line.sent_ns, 0.0, 7)
        writer.write(line.topic, header, msgpack.packb(line.body))
    writer.flush()
    held = path.read_bytes()
    writer.close()
    if not closed:
        path.write_bytes(held)
    return path


def events(lines):
    published = [
        Event(PUBLISHERS[one.topic], one.topic, one.epoch, one.seq, one.sent_ns, packed(one))
        for one in lines
    ]
    return History(tuple(published), closed=True)


def packed(line):
    body: bytes = msgpack.packb(line.body)
    return body


def changed(place, **fields):
    return tuple(
        line._replace(**fields) if number == place else line for number, line in enumerate(GOOD)
    )


def without(*places):
    return tuple(line for number, line in enumerate(GOOD) if number not in places)


def wrong(history):
    return [*violations_in(history), *causality_violations(history, whole=True)]


def test_a_history_without_a_fault_passes(tmp_path):
    history = read_history(write(tmp_path / "topics.mcap", GOOD))
    assert (len(history.events), history.closed, wrong(history)) == (len(GOOD), True, [])


def test_parts_are_read_as_one_though_the_first_was_never_closed(tmp_path):
    path = write(tmp_path / "topics.mcap", GOOD[:4], closed=False)
    write(tmp_path / "topics.1.mcap", GOOD[4:])
    history = read_history(path)
    assert history == read_history(write(tmp_path / "whole.mcap", GOOD))


@pytest.mark.parametrize("cut", [1, 9, 60])
def test_a_file_that_is_cut_off_is_read_as_far_as_it_is_whole(cut, tmp_path):
    path = write(tmp_path / "topics.mcap", GOOD, closed=False)
    path.write_bytes(path.read_bytes()[:-cut])
    history = read_history(path)
    assert not history.closed
    assert list(history.events) == list(events(GOOD).events)[: len(history.events)]


def test_a_file_that_is_damaged_is_read_up_to_the_damage(tmp_path):
    path = write(tmp_path / "topics.mcap", GOOD)
    data = bytearray(path.read_bytes())
    data[data.index(b"lz4") + 40] ^= 0xFF
    path.write_bytes(data)
    assert read_history(path) == History((), closed=False)


@pytest.mark.parametrize(
    ("lines", "law", "text"),
    [
        (without(1), "gap", "/finger/goal 0 of tracer is not there"),
        ((*GOOD, GOOD[3]), "twice", "/finger/goal 1 is there more than once"),
        ((*GOOD, GOOD[3]._replace(body={"goal": 9})), "bodies", "/finger/goal 1 holds two diff"),
        (
            (*GOOD, Line("/touch/raw", 2, 99, {"goal": 0, "touch": 1})),
            "epoch",
            "/touch/raw 2 has epoch 0, 1 had come before",
        ),
        (changed(3, sent_ns=20), "order", "/finger/goal 1 was sent no later than 0 before it"),
        (changed(3, sent_ns=19), "order", "/finger/goal 1 was sent no later than 0 before it"),
        (changed(5, sent_ns=10), "order", "/model/goal 0 was sent at the time of /contour/goal 0"),
        (changed(2, sent_ns=15), "cause", "/touch/raw 0 was sent before what it answers"),
        (changed(2, sent_ns=20), "cause", "/touch/raw 0 was sent before what it answers"),
        (without(0), "cause", "/finger/goal 0 answers goal 0, which nobody published"),
        (without(7), "cause", "/model/shape 1 answers number 1, which nobody published"),
        (without(10), "cause", "/finger_2/touch/image 0 answers goal 0, touch 0, which nobody"),
        (changed(2, body={"goal": 0, "touch": 7}), "cause", "/touch/raw 0 answers goal 0, touch 7"),
    ],
)
def test_each_law_fires(lines, law, text):
    assert any(one.law == law and one.text.startswith(text) for one in wrong(events(lines)))


def test_a_cause_may_lack_where_the_recording_has_no_end():
    assert not list(causality_violations(events(without(0)), whole=False))
    early = changed(2, sent_ns=15)
    assert [one.law for one in causality_violations(events(early), whole=False)] == ["cause"]


@pytest.mark.parametrize(
    "change",
    [lambda lines: lines[:-1], lambda lines: (*lines[:-1], lines[-1]._replace(body={"goal": 1}))],
)
def test_a_topic_has_another_digest_if_anything_in_it_is_another(change):
    one, other = digests(events(GOOD)), digests(events(change(GOOD)))
    different = {topic for topic in one if one[topic] != other.get(topic)}
    assert different == {"/finger_2/touch/image"}


def test_the_order_of_recording_does_not_change_a_digest():
    assert digests(events(GOOD)) == digests(events(GOOD[::-1]))
