from __future__ import annotations

from typing import Any

import zmq

from palpate.messages.bus.message_log import MessageLog
from palpate.messages.bus.node_sockets import (
    LOG_TOPIC,
    PAST_BATCH,
    STATUS_TOPIC,
    TAP_DEPTH,
    PastReader,
    Tap,
    TapReader,
)
from palpate.messages.codec import Header, decode, pack_frame
from palpate.messages.types.catalogue import LogRecord

FRAME = pack_frame("/touch/raw", Header(1, 0, 0, 0, 0.0, 0), b"body")
LINE = LogRecord(node="filter", level="info", text="hello", robot_time=1.5)


def pair(context: zmq.Context[Any], *topics: str) -> tuple[Tap, TapReader]:
    tap = Tap(context, "inproc://tap", run=1, epoch=0)
    reader = TapReader(context, ["inproc://tap"], topics)
    tap.socket.poll(1000)
    tap.refresh()
    return tap, reader


def close(*ends: Tap | TapReader) -> None:
    for end in ends:
        end.close()


def test_a_node_is_received_by_who_listens_to_its_tap(bench: Any):
    tap, reader = pair(bench.context, LOG_TOPIC)
    tap.publish(LINE)
    received = reader.receive()
    assert received is not None
    topic, header, body = received
    assert (topic, header.seq, header.robot_time) == (LOG_TOPIC, 0, 1.5)
    assert decode(LogRecord, body).text == "hello"
    assert reader.receive() is None
    close(tap, reader)


def test_nothing_is_copied_while_only_the_nodes_own_words_are_wanted(bench: Any):
    tap, reader = pair(bench.context, STATUS_TOPIC, LOG_TOPIC)
    tap.mirror(FRAME)
    assert not tap._mirroring
    assert reader.receive() is None
    close(tap, reader)


def test_a_frame_is_copied_for_who_wants_its_topic(bench: Any):
    tap, reader = pair(bench.context, "/touch/raw")
    tap.mirror(FRAME)
    tap.mirror(FRAME.replace(b"raw", b"raw_not_wanted", 1))
    received = reader.receive()
    assert received is not None and received[2] == b"body"
    assert reader.receive() is None
    close(tap, reader)


def test_copying_ends_with_the_last_who_wants_it(bench: Any):
    tap, reader = pair(bench.context, "/touch/raw")
    assert tap._mirroring
    reader.close()
    assert tap.socket.poll(1000)
    tap.refresh()
    assert not tap._mirroring
    tap.close()


def test_a_subscriber_that_does_not_listen_holds_nobody_up(bench: Any):
    tap, reader = pair(bench.context, LOG_TOPIC)
    for _ in range(10 * TAP_DEPTH):
        tap.publish(LINE)
    seqs = []
    while (received := reader.receive()) is not None:
        seqs.append(received[1].seq)
    assert seqs[0] == 0
    assert len(seqs) < 10 * TAP_DEPTH
    close(tap, reader)


def latched(number: int) -> bytes:
    return pack_frame("/world", Header(1, 0, number, 0, 0.0, 0), b"%d" % number)


def late(tap: Tap, context: zmq.Context[Any], *, wants: bool = True) -> TapReader:
    reader = TapReader(context, ["inproc://tap"], ["/world"], latched=wants)
    assert tap.socket.poll(1000)
    while tap.socket.poll(100):
        tap.refresh()
    return reader


def bodies(reader: TapReader) -> list[bytes]:
    found = []
    while reader.socket.poll(100) and (received := reader.receive()) is not None:
        found.append(received[2])
    return found


def test_who_comes_late_gets_as_many_latched_messages_as_count(bench: Any):
    tap = Tap(bench.context, "inproc://tap", run=1, epoch=0, latched={"/world": 2})
    for number in range(3):
        tap.mirror(latched(number))
    tap.mirror(FRAME)
    first = late(tap, bench.context)
    assert bodies(first) == [b"1", b"2"]
    second = late(tap, bench.context)
    assert bodies(second) == [b"1", b"2"]
    tap.mirror(latched(3))
    assert bodies(second) == [b"3"]
    close(tap, first, second)


def test_who_measures_rates_is_not_sent_what_was_latched(bench: Any):
    tap = Tap(bench.context, "inproc://tap", run=1, epoch=0, latched={"/world": 1})
    tap.mirror(latched(0))
    reader = late(tap, bench.context, wants=False)
    tap.mirror(latched(1))
    assert bodies(reader) == [b"1"]
    close(tap, reader)


def answers(tap: Tap, reader: PastReader) -> list[int | None]:
    """Numbers of the messages that are sent once more, and the mark behind them."""
    while tap.socket.poll(100):
        tap.refresh()
    found: list[int | None] = []
    while reader.socket.poll(100) and (came := reader.receive()) is not None:
        assert came[0] == "/world"
        found.append(came[1] and came[1][0].seq)
    return found


def test_what_was_published_is_sent_once_more_a_little_at_a_time(bench: Any, tmp_path: Any):
    past = MessageLog(tmp_path / "p", ["/world"])
    for number in range(PAST_BATCH + 3):
        past.add("/world", latched(number))
    tap = Tap(bench.context, "inproc://tap", run=1, epoch=0, past=past)
    reader = PastReader(bench.context, "inproc://tap", ["/world"])
    reader.ask("/world", 0)
    assert answers(tap, reader) == [*range(PAST_BATCH), None]
    for _ in range(2):
        reader.ask("/world", PAST_BATCH)
        assert answers(tap, reader) == [*range(PAST_BATCH, PAST_BATCH + 3), None]
    reader.ask("/world", 999)
    assert answers(tap, reader) == [None]
    close(tap)
    reader.close()
    past.close()


def test_a_request_that_is_none_is_passed_over(bench: Any, tmp_path: Any):
    tap = Tap(bench.context, "inproc://tap", run=1, epoch=0, past=MessageLog(tmp_path / "p", []))
    reader = PastReader(bench.context, "inproc://tap", ["/world"])
    for words in (b"", b"/world", b"/world\0", b"/world\0x", b"/world\0-1", b"\xff\0", b"\0" * 9):
        reader.socket.subscribe(b"\x03" + words)
    reader.socket.subscribe(b"\x03/world\0" + b"9" * 40)
    assert answers(tap, reader) == []
    reader.ask("/world", 0)
    assert answers(tap, reader) == [None]
    close(tap)
    reader.close()
