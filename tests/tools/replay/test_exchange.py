import tracemalloc
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from palpate.launch.graph import read_settings
from palpate.messages.codec import Header, schema_hash
from palpate.messages.recording.reader import RecordedMessage, open_recording
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.tools.replay.exchange import in_order_of_sending
from palpate.tools.replay.rerun import replay

PUBLISHED = [
    ("/a", 1.0),
    ("/b", 2.0),
    ("/c", 4.0),
    ("/a", 2.0),
    ("/b", 4.0),
    ("/c", 8.0),
    ("/a", 3.0),
]


PUBLISHED += [("/b", 6.0), ("/c", 12.0)]


BOTH = ["first", "second"]


def lines_of(bag, *settings, nodes=BOTH):
    """Exit code and lines of a replay; the cells of the table by single spaces."""
    lines: list[str] = []
    code = replay(bag, nodes, lines.append, settings=read_settings(settings))
    return code, [" ".join(line.split()) for line in lines]


def test_with_the_same_parameters_nothing_changes(record_chain):
    published = ["first: identical, 3 on /b", "second: identical, 3 on /c"]
    assert lines_of(record_chain(PUBLISHED)) == (0, published)


def test_subscribers_of_a_replayed_node_receive_what_it_publishes_now(record_chain):
    code, lines = lines_of(record_chain(PUBLISHED), "first.gain=3")
    assert code == 0
    assert lines[:2] == [
        "first: differs, /b 0 robot_time: recorded 2.0, now 3.0",
        "second: differs, /c 0 robot_time: recorded 4.0, now 6.0",
    ]
    assert lines[3:] == [
        "/b robot_time 3 3 0 3 2.16 s",  # 1, 2 and 3
        "/c robot_time 3 3 0 6 4.32 s",
    ]


def test_what_is_not_replayed_comes_from_the_recording(record_chain):
    bag = record_chain([(topic, value + (topic == "/b")) for topic, value in PUBLISHED])
    _, lines = lines_of(bag, nodes=["second"])
    assert lines[0] == "second: differs, /c 0 robot_time: recorded 4.0, now 6.0"


def test_if_a_node_publishes_fewer_its_subscriber_receives_no_more(record_chain):
    code, lines = lines_of(record_chain(PUBLISHED), "first.copies=0")
    assert code == 0
    assert lines == [
        "first: differs, /b 0: recorded, but not published again",
        "second: differs, /c 0: recorded, but not published again",
        "second: received 3 fewer messages on /b than recorded: first publishes no more",
        "topic field compared differ first largest rms unit",
        "/b messages 0 0 3 fewer than recorded",
        "/c messages 0 0 3 fewer than recorded",
    ]


def test_if_a_node_publishes_more_its_subscriber_receives_the_rest_in_the_end(record_chain):
    code, lines = lines_of(record_chain(PUBLISHED), "first.copies=2")
    # Said now: 2 2 4 4 6 6, of which the first three stand in the places of 2 4 6.
    assert code == 0
    assert lines == [
        "first: differs, /b 1 robot_time: recorded 4.0, now 2.0",
        "second: differs, /c 1 robot_time: recorded 8.0, now 4.0",
        "second: received 3 more messages on /b, after those recorded: first publishes more",
        "topic field compared differ first largest rms unit",
        "/b robot_time 3 2 1 2 2 s",
        "/b messages 3 3 3 more than recorded",
        "/c robot_time 3 2 1 4 4 s",
        "/c messages 3 3 3 more than recorded",
    ]


def test_what_is_published_later_than_it_was_is_received_then(record_chain):
    published = ["first: identical, 3 on /b", "second: identical, 3 on /c"]
    assert lines_of(record_chain(PUBLISHED), "first.late=2") == (0, published)


def test_a_message_that_was_recorded_before_its_cause_is_waited_for(record_chain):
    bag = record_chain([("/b", 2.0), ("/c", 4.0), ("/a", 1.0)])
    assert lines_of(bag) == (0, ["first: identical, 1 on /b", "second: identical, 1 on /c"])


def test_after_a_node_has_failed_nothing_more_of_it_is_received(record_chain):
    code, lines = lines_of(record_chain(PUBLISHED), "first.fails_at=2")
    assert code == 1
    failed, *lines = lines
    assert failed.startswith("first: fails, ArithmeticError handling /a 1 from source: no more (")
    assert lines == [
        "second: differs, /c 1: recorded, but not published again",
        "second: received 2 fewer messages on /b than recorded: first publishes no more",
        "topic field compared differ first largest rms unit",
        "/b messages 1 1 2 fewer than recorded",
        "/c messages 1 1 2 fewer than recorded",
    ]


BODY = bytes(100_000)
MANY = 200


def recorded(path, times, body=b"\x80"):
    writer = RecordingWriter(path, {"/log": "LogRecord"}, {}, {})
    for seq, sent in enumerate(times):
        writer.write("/log", Header(1, 0, seq, sent, 0.0, schema_hash(LogRecord)), body)
    writer.close()
    return open_recording(path)


def test_messages_come_by_the_time_at_which_they_were_sent(tmp_path):
    recording = recorded(tmp_path / "a.mcap", [5, 3, 9, 3, 1])
    found = [(kept.sent_ns, kept.seq) for kept in in_order_of_sending(recording)]
    assert found == [(1, 4), (3, 1), (3, 3), (5, 0), (9, 2)]


def test_a_recording_without_messages_has_no_order(tmp_path):
    assert list(in_order_of_sending(recorded(tmp_path / "a.mcap", []))) == []


def test_a_recording_is_not_held(tmp_path):
    # Each was received after the one that was sent after it, as of two publishers.
    times = [place ^ 1 for place in range(MANY)]
    recording = recorded(tmp_path / "a.mcap", times, BODY)
    plain, ordered = peak_of(recording.messages()), peak_of(in_order_of_sending(recording))
    # Beyond what any reading takes: one message that waits, one that is handed over, and times.
    assert ordered - plain < 3 * len(BODY)
    assert MANY * len(BODY) > 5 * ordered


def peak_of(messages):
    """Most bytes that are held while all messages are gone through."""
    tracemalloc.start()
    assert sum(1 for _ in messages) == MANY
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


@dataclass
class Shrinking:
    """A recording that has fewer messages when it is read again."""

    kept: RecordedMessage
    left: int = 3
    path: Path = Path("a.mcap")

    def messages(self):
        self.left -= 1
        yield from [self.kept] * self.left


def test_a_recording_that_shrinks_meanwhile_is_refused(tmp_path):
    [kept] = recorded(tmp_path / "a.mcap", [5]).messages()
    shrinking: Any = Shrinking(kept)
    with pytest.raises(ValueError, match=r"recording a\.mcap became shorter while it was read"):
        list(in_order_of_sending(shrinking))
