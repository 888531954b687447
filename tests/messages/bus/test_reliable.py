"""Reliable topics: every message once and in order, across late joins, full queues and deaths."""

from pathlib import Path
from typing import Any

import pytest

from palpate.messages import Header, bus, pack_frame, split_frame
from palpate.messages.bus import MessageLog, SendTimes, SocketSettings
from tests.messages.cases import cases

TOPICS = ["/talk", "/more"]
CALL = bus.join_call("finger_1/filter", 2, "simulator")


def test_messages_before_during_and_after_joining_come_once_in_order(wires: Any):
    publisher = wires.publisher()
    wires.publish(publisher, b"one", b"two")
    subscriber = wires.subscriber("/talk", "/more")
    for number in range(40):
        wires.publish(publisher, b"%d" % number)
        publisher.serve()
        wires.receive()
    wires.turn(lambda: subscriber.in_step)
    wires.publish(publisher, bytes(1 << 20))
    wires.publish(publisher, b"c", topic="/more")
    wires.turn(lambda: len(wires.heard["hearer"]) == 44)
    *talk, more = wires.heard["hearer"]
    assert [one.body for one in talk[:3]] == [b"one", b"two", b"0"]
    assert talk[-1].body == bytes(1 << 20)
    assert [one.header.seq for one in talk] == list(range(43))
    assert (more.publisher, more.topic, more.header.seq) == ("talker", "/more", 0)
    assert (subscriber.gaps, subscriber.duplicates, subscriber.missing) == (0, 0, {})
    assert publisher.sent == {"/talk": 43, "/more": 1}


def test_header_and_time_of_a_message(wires: Any):
    publisher, _ = wires.joined(epoch=3, ahead_ns=1 << 60)
    publisher.send("/talk", b"body", robot_time=2.5, schema=9, outside=True)
    publisher.send("/talk", b"body", robot_time=2.5, schema=9)
    assert wires.seqs() == [0, 1]
    first, second = (arrival.header for arrival in wires.heard["hearer"])
    assert first._replace(sent_ns=0) == Header(1, 3, 0, 0, 2.5, 9, True)
    assert second.sent_ns > first.sent_ns > 1 << 60
    with pytest.raises(KeyError, match="/elsewhere"):
        wires.publish(publisher, b"", topic="/elsewhere")


def test_message_that_comes_twice_is_dropped_and_lost_ones_are_gaps_of_their_topic(wires: Any):
    publisher, subscriber = wires.joined("/talk", "/more")
    wires.publish(publisher, b"zero")
    publisher.socket.send(next(publisher.past.since("/talk", 0)))
    wires.publish(publisher, b"one")
    assert wires.seqs() == [0, 1]
    assert (subscriber.gaps, subscriber.duplicates) == (0, 1)
    publisher.past.add("/talk", b"lost")
    wires.publish(publisher, b"three", b"four")
    assert wires.seqs() == [0, 1]
    assert (subscriber.missing, subscriber.gaps, subscriber.duplicates) == ({"/talk": 3}, 3, 1)


def test_message_before_its_past_is_early_and_comes_again_in_order(wires: Any):
    publisher = wires.publisher()
    wires.publish(publisher, b"0", b"1")
    subscriber = wires.subscriber()
    publisher.socket.poll(1000)
    publisher.serve()
    wires.publish(publisher, b"2")
    wires.turn(lambda: subscriber.in_step)
    assert wires.seqs() == [0, 1, 2]
    assert (subscriber.early, subscriber.gaps, subscriber.duplicates) == (1, 0, 0)


def test_cursor_of_an_earlier_start_is_not_answered(wires: Any):
    publisher = wires.publisher(epoch=2)
    wires.publish(publisher, b"0")
    subscriber = wires.subscriber()
    call = bus.join_call("hearer", 0, "talker")
    subscriber.socket.subscribe(bus.join_cursor(call, 1, "/talk", 0))
    wires.turn(lambda: subscriber.in_step)
    assert wires.seqs() == [0] and subscriber.duplicates == 0


def test_queue_that_stays_full_names_who_blocks_it(wires: Any):
    publisher, _ = wires.joined(depth=1, settings=SocketSettings(send_timeout=0.1))
    with pytest.raises(RuntimeError, match=r"talker could not send /talk for 0.1 s: hearer does"):
        wires.publish(publisher, *[b"x"] * 4000)
    assert publisher.blocked == 1


@cases(
    "frame, words",
    (pack_frame("/talk", Header(2, 0, 0, 0, 0.0, 0), b""), "hearer received /talk of run 2, "),
    (b"/talk\0too short", "not a frame"),
)
def test_frame_of_another_run_or_form_is_refused(frame: bytes, words: str, wires: Any):
    publisher, subscriber = wires.joined()
    publisher.socket.send(frame)
    with pytest.raises(ValueError, match=words):
        subscriber.receive()


def after_death(wires: Any, folder: Path) -> tuple[str, Any]:
    """Address of a publisher that has died, and who has received two messages of it."""
    endpoint = f"ipc://{folder / 'talker'}"
    first = wires.publisher(endpoint=endpoint)
    subscriber = wires.subscriber(endpoints={"talker": endpoint})
    wires.turn(lambda: subscriber.in_step)
    wires.publish(first, b"0", b"1")
    wires.turn(lambda: len(wires.heard["hearer"]) == 2)
    first.close(0)
    return endpoint, subscriber


def test_publisher_that_starts_again_is_taken_up_without_gap(wires: Any, tmp_path: Path):
    endpoint, subscriber = after_death(wires, tmp_path)
    second = wires.publisher(endpoint=endpoint, epoch=1)
    wires.publish(second, b"0", b"1", b"2")
    wires.turn(lambda: len(wires.heard["hearer"]) == 3)
    wires.publish(second, b"3")
    wires.turn(lambda: len(wires.heard["hearer"]) == 4)
    assert wires.seqs() == [0, 1, 2, 3]
    assert (subscriber.gaps, subscriber.duplicates) == (0, 0)


def test_publisher_that_repeats_its_past_sends_each_what_it_lacks(wires: Any, tmp_path: Path):
    endpoint, early = after_death(wires, tmp_path)
    second = wires.publisher(endpoint=endpoint, epoch=1, again=True)
    late = wires.subscriber(name="late", endpoints={"talker": endpoint})
    wires.publish(second, b"0")
    wires.turn(lambda: not early.in_step and len(wires.heard["late"]) == 1)
    wires.publish(second, b"1", b"2")
    wires.turn(lambda: (len(wires.heard["hearer"]), len(wires.heard["late"])) == (3, 3))
    assert not early.in_step and not late.in_step
    second.go_live()
    wires.publish(second, b"3")
    wires.turn(lambda: (len(wires.heard["hearer"]), len(wires.heard["late"])) == (4, 4))
    assert wires.seqs() == wires.seqs("late") == [0, 1, 2, 3]
    assert early.in_step and late.in_step
    assert (early.gaps, late.gaps, early.duplicates, late.duplicates) == (0, 0, 0, 0)


def test_message_that_nobody_lacks_is_not_made_again(wires: Any, tmp_path: Path):
    endpoint, early = after_death(wires, tmp_path)
    times = SendTimes(tmp_path / "before", "talker", TOPICS)
    for sent_ns in (100, 200):  # its first life had sent two
        times.note("/talk", sent_ns)
    times.close()
    times = SendTimes(tmp_path / "before", "talker", TOPICS)
    past = MessageLog(tmp_path / "past", TOPICS)
    second = wires.publisher(endpoint=endpoint, epoch=1, again=True, times=times, past=past)
    made: list[int] = []

    def promised(number: int) -> bytes:
        made.append(number)
        return b"%d" % number

    had = []
    for number in range(3):
        had.append(second.was_published("/talk"))
        second.promise("/talk", lambda number=number: promised(number), 5)
    second.go_live()
    wires.turn(lambda: len(wires.heard["hearer"]) == 3)
    assert (had, made, early.gaps) == ([True, True, False], [2], 0)
    late = wires.subscriber(name="late", endpoints={"talker": endpoint})
    wires.turn(lambda: late.in_step)
    assert (sorted(made), wires.seqs("late")) == ([0, 1, 2], [0, 1, 2])
    assert [one.header.sent_ns for one in wires.heard["late"][:2]] == [100, 200]
    assert [one.body for one in wires.heard["late"]] == [b"0", b"1", b"2"]


def test_repeated_message_keeps_its_time_and_new_ones_are_later(wires: Any, tmp_path: Path):
    headers = []
    for epoch in range(2):
        times = SendTimes(tmp_path / "published", "talker", TOPICS)
        talker = wires.publisher(f"talker_{epoch}", epoch=epoch, times=times, again=epoch > 0)
        frames = [
            talker.send(topic, b"", robot_time=0.0, schema=5)
            for topic in ("/talk", "/more", "/talk", *(["/more"] if epoch else []))
        ]
        headers.append([split_frame(frame)[1] for frame in frames])
    first, again = headers
    assert [one._replace(epoch=1) for one in first] == again[:3]
    assert again[3].sent_ns > again[2].sent_ns


@pytest.mark.parametrize("latest", [0, 1 << 62])
def test_message_after_kept_ones_has_a_later_time(latest: int, wires: Any, tmp_path: Path):
    kept = MessageLog(tmp_path / "past", TOPICS, persistent=True)
    kept.add("/talk", pack_frame("/talk", Header(1, 0, 0, latest, 0.0, 5), b""))
    kept.close()
    past = MessageLog(tmp_path / "past", TOPICS, persistent=True, epoch=1)
    talker = wires.publisher(past=past)
    assert split_frame(talker.send("/talk", b"", robot_time=0.0, schema=5))[1].sent_ns > latest


@cases(
    "notice, request_",
    (b"\x01" + CALL, ("finger_1/filter", CALL, "simulator", None, "", 0)),
    (
        b"\x01" + bus.join_cursor(CALL, 3, "/touch/raw", 17),
        ("finger_1/filter", CALL, "simulator", 3, "/touch/raw", 17),
    ),
    *(
        (wrong, None)
        for wrong in (
            b"",
            b"\x00" + CALL,
            b"\x01/touch/raw\0",
            b"\x01@a b",
            b"\x01@a x b ",
            b"\x01@a 0 b x /t 1",
            b"\x01@a 0 b 0 /t x",
            b"\x01@\xff\xfe",
            b"\x01@a " + b"9" * 5000 + b" b ",  # more digits than Python takes for a number
            b"\x01@a 0 b 0 /t " + b"9" * 20,
            "\x01@a \u0661 b ".encode(),
            b"\x01@" + b"a" * 5000 + b" 0 b ",
        )
    ),
    ids=lambda one: repr(one)[:20],
)
def test_request_is_read_as_sent_and_nothing_else_is_one(notice: bytes, request_: Any):
    assert bus.read_request(notice) == request_


@cases(
    "read, data, words",
    *(
        (bus.read_reply, frame, "not an answer")
        for frame in (b"@a 0 b ", b"@a 0\0H", CALL + b"\0X", CALL + b"\0")
    ),
    (bus.read_reply, b"@a 0 \xff \0H", "the name of its publisher is not Unicode"),
    (bus.read_epoch, b"x", "a greeting must hold 4 bytes, got 1"),
    *(
        (bus.check_node_name, name, "a node's name must be printable")
        for name in ("", "a b", "@a", "a\n")
    ),
)
def test_answer_or_name_of_another_form_is_refused(read: Any, data: Any, words: str):
    with pytest.raises(ValueError, match=words) as caught:
        read(data)
    assert type(caught.value) is ValueError
    assert bus.check_node_name("finger_1/filter") == "finger_1/filter"
