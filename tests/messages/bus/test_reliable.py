from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from palpate.messages.bus import handshake as join
from palpate.messages.bus.message_log import SendTimes
from palpate.messages.bus.publisher import BlockedError
from palpate.messages.codec import Header, pack_frame


def seqs(arrivals: list[Any]) -> list[int]:
    return [arrival.header.seq for arrival in arrivals]


def test_what_was_published_before_anybody_listened_is_received(bench: Any):
    publisher = bench.publisher()
    bench.publish(publisher, b"one", b"two")
    subscriber = bench.subscriber()
    received = bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    assert [arrival.body for arrival in received] == [b"one", b"two"]
    assert (subscriber.gaps, subscriber.duplicates) == (0, 0)


def test_what_is_published_while_a_subscriber_joins_is_received_once(bench: Any):
    publisher = bench.publisher()
    bench.publish(publisher, b"0")
    subscriber = bench.subscriber()
    received = []
    for number in range(1, 50):
        bench.publish(publisher, b"%d" % number)
        publisher.serve()
        received += bench.receive(subscriber)
    received += bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    received += bench.receive(subscriber)
    assert seqs(received) == list(range(50))
    assert subscriber.gaps == 0


def test_topics_are_counted_apart(bench: Any):
    publisher = bench.publisher()
    subscriber = bench.subscriber("/talk", "/more")
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    bench.publish(publisher, b"a", b"b")
    bench.publish(publisher, b"c", topic="/more")
    received = bench.receive(subscriber)
    assert [(one.topic, one.header.seq) for one in received] == [
        ("/talk", 0),
        ("/talk", 1),
        ("/more", 0),
    ]
    assert publisher.sent == {"/talk": 2, "/more": 1}


def test_a_header_carries_what_the_receiver_checks(bench: Any):
    publisher = bench.publisher()
    subscriber = bench.subscriber()
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    publisher.send("/talk", b"body", robot_time=2.5, schema=9)
    [arrival] = bench.receive(subscriber)
    header = arrival.header
    assert (header.run, header.epoch, header.seq, header.robot_time, header.schema) == (
        1,
        0,
        0,
        2.5,
        9,
    )
    assert header.sent_ns > 0


def test_a_large_frame_arrives_whole(bench: Any):
    publisher = bench.publisher()
    subscriber = bench.subscriber()
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    bench.publish(publisher, bytes(1 << 20))
    assert bench.receive(subscriber)[0].body == bytes(1 << 20)


def test_a_topic_that_is_not_the_publishers_is_refused(bench: Any):
    with pytest.raises(KeyError, match="/elsewhere"):
        bench.publish(bench.publisher(), b"", topic="/elsewhere")


def test_a_frame_that_is_dropped_on_the_way_is_counted_as_a_gap(bench: Any):
    publisher = bench.publisher()
    subscriber = bench.subscriber()
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    bench.publish(publisher, b"zero")
    publisher.past.add("/talk", b"lost")
    bench.publish(publisher, b"two", b"three")
    assert seqs(bench.receive(subscriber)) == [0]
    assert subscriber.gaps == 3
    assert subscriber.duplicates == 0


def test_a_frame_that_comes_twice_is_counted_and_dropped(bench: Any):
    publisher = bench.publisher()
    subscriber = bench.subscriber()
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    bench.publish(publisher, b"zero")
    publisher.socket.send(next(publisher.past.since("/talk", 0)))
    bench.publish(publisher, b"one")
    assert seqs(bench.receive(subscriber)) == [0, 1]
    assert (subscriber.gaps, subscriber.duplicates) == (0, 1)


def test_a_frame_before_its_past_is_early_and_comes_again_in_order(bench: Any):
    publisher = bench.publisher()
    bench.publish(publisher, b"0", b"1")
    subscriber = bench.subscriber()
    publisher.socket.poll(1000)
    publisher.serve()
    bench.publish(publisher, b"2")
    received = bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    assert seqs(received) == [0, 1, 2]
    assert subscriber.early == 1
    assert (subscriber.gaps, subscriber.duplicates) == (0, 0)


def after_death(bench: Any, folder: Path) -> tuple[str, Any, list[Any]]:
    """Address of a publisher that has died, and who has received two messages of it."""
    endpoint = f"ipc://{folder / 'talker'}"
    first = bench.publisher(endpoint=endpoint)
    subscriber = bench.subscriber(endpoints={"talker": endpoint})
    bench.turn(first, subscriber, lambda: subscriber.in_step)
    bench.publish(first, b"0", b"1")
    received: list[Any] = []
    while len(received) < 2:
        assert subscriber.socket.poll(5000)
        received += bench.receive(subscriber)
    first.close(0)
    return endpoint, subscriber, received


def test_a_publisher_that_starts_again_is_taken_up_where_it_was_left(bench: Any, tmp_path: Path):
    endpoint, subscriber, received = after_death(bench, tmp_path)
    second = bench.publisher(endpoint=endpoint, epoch=1)
    bench.publish(second, b"0", b"1", b"2")
    received += bench.turn(
        second, subscriber, lambda: subscriber._greeted["talker"] == 1 and subscriber.in_step
    )
    bench.publish(second, b"3")
    assert subscriber.socket.poll(5000)
    received += bench.receive(subscriber)
    assert seqs(received) == [0, 1, 2, 3]
    assert (subscriber.gaps, subscriber.duplicates) == (0, 0)


def test_a_stale_cursor_is_not_answered(bench: Any):
    publisher = bench.publisher(epoch=2)
    bench.publish(publisher, b"0")
    subscriber = bench.subscriber()
    stale = join.join_cursor(join.join_call("hearer", 0, "talker"), 1, "/talk", 0)
    subscriber.socket.subscribe(stale)
    received = bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    assert seqs(received) == [0]
    assert subscriber.duplicates == 0


def test_a_sender_whose_queue_is_full_drains_and_names_who_blocks_it(bench: Any):
    drained: list[int] = []
    publisher = bench.publisher(depth=1, patience=0.2, drain=lambda: drained.append(1))
    subscriber = bench.subscriber(depth=1)
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    with pytest.raises(BlockedError, match=r"talker could not send /talk for 0.2 s: hearer does"):
        bench.publish(publisher, *[b"x"] * 100)
    assert drained
    assert publisher.blocked > 0


def test_a_full_queue_loses_nothing_once_it_is_drained(bench: Any):
    received: list[Any] = []
    publisher = bench.publisher(depth=1, drain=lambda: received.extend(bench.receive(subscriber)))
    subscriber = bench.subscriber(depth=1)
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    bench.publish(publisher, *[b"x"] * 1000)
    received += bench.receive(subscriber)
    assert seqs(received) == list(range(1000))
    assert publisher.blocked > 0


def test_a_frame_of_another_run_is_refused(bench: Any):
    publisher = bench.publisher()
    subscriber = bench.subscriber()
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    publisher.socket.send(pack_frame("/talk", Header(2, 0, 0, 0, 0.0, 0), b""))
    with pytest.raises(
        ValueError, match="hearer received /talk of run 2, to which it never subscribed"
    ):
        subscriber.receive()


def test_a_malformed_frame_is_refused(bench: Any):
    publisher = bench.publisher()
    subscriber = bench.subscriber()
    bench.turn(publisher, subscriber, lambda: subscriber.in_step)
    publisher.socket.send(b"/talk\0too short")
    with pytest.raises(ValueError, match="not a frame"):
        subscriber.receive()


def test_a_publisher_that_publishes_it_all_again_tells_each_subscriber_what_it_lacks(
    bench: Any, tmp_path: Path
):
    endpoint, early, received = after_death(bench, tmp_path)
    second = bench.publisher(endpoint=endpoint, epoch=1, again=True)
    late = bench.subscriber(name="late", endpoints={"talker": endpoint})
    bench.publish(second, b"0")
    received += bench.turn(second, early, lambda: early._greeted["talker"] == 1)
    told = bench.turn(second, late, lambda: "talker" in late._greeted)
    while len(second._lacks) < 2:
        second.socket.poll(10)
        second.serve()
    bench.publish(second, b"1", b"2")
    assert not early.in_step and not late.in_step
    second.go_live()
    bench.publish(second, b"3")
    received += bench.turn(
        second, early, lambda: early.in_step and early._edges["/talk"].wanted == 4
    )
    told += bench.turn(second, late, lambda: late.in_step and late._edges["/talk"].wanted == 4)
    assert (seqs(received), seqs(told)) == ([0, 1, 2, 3], [0, 1, 2, 3])
    assert (early.gaps, late.gaps, early.duplicates) == (0, 0, 0)


def test_what_nobody_lacks_is_not_made_once_more(bench: Any, tmp_path: Path):
    endpoint, early, received = after_death(bench, tmp_path)
    times = SendTimes(tmp_path / "before", "talker", ["/talk", "/more"])
    for sent_ns in (100, 200):  # its first life had sent two
        times.note("/talk", sent_ns)
    times.close()
    times = SendTimes(tmp_path / "before", "talker", ["/talk", "/more"])
    second = bench.publisher(endpoint=endpoint, epoch=1, again=True, times=times)
    had = early._edges["/talk"].wanted
    received += bench.turn(second, early, lambda: early._greeted["talker"] == 1)
    while not second._lacks:
        second.socket.poll(10)
        second.serve()
    made: list[int] = []

    def promised(number: int) -> bytes:
        made.append(number)
        return b"%d" % number

    for number in range(3):
        second.promise("/talk", lambda number=number: promised(number), 5)
    assert made == list(range(had, 3)) or made == [2]
    second.go_live()
    received += bench.turn(second, early, lambda: early._edges["/talk"].wanted == 3)
    late = bench.subscriber(name="late", endpoints={"talker": endpoint})
    told = bench.turn(second, late, lambda: late.in_step)
    assert sorted(made) == [0, 1, 2]
    assert (seqs(received), seqs(told)) == ([0, 1, 2], [0, 1, 2])
    assert [one.header.sent_ns for one in told[:2]] == [100, 200]
