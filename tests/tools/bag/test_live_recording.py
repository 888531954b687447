from types import SimpleNamespace
from typing import Any

import pytest

from palpate.messages.bus.node_sockets import PAST_BATCH
from palpate.messages.codec import Header
from palpate.tools.bag import live_recording
from palpate.tools.bag.live_recording import PastRequests, RecordedGraph, TopicOrder, recorded_text


def header(seq, run=7):
    return Header(run, 0, seq, 0, 0.0, 0)


def numbers(order):
    return [found.seq for found, _ in order.take()]


def test_messages_are_put_into_the_order_of_their_numbers_each_once():
    order = TopicOrder()
    for seq in (2, 0, 0, 3):
        order.put(header(seq), b"")
    assert numbers(order) == [0]
    assert order.lacks
    for seq in (0, 1, 2):
        order.put(header(seq), b"")
    assert numbers(order) == [1, 2, 3]
    order.answered(3)
    assert (order.lacks, order.lost, order.whole) == (False, 0, True)


def test_more_is_asked_for_while_an_answer_is_full():
    order = TopicOrder()
    order.answered(PAST_BATCH)
    assert not order.whole
    order.answered(0)
    assert order.whole


def test_what_nobody_has_any_more_is_counted_and_passed_over():
    order = TopicOrder()
    order.put(header(4), b"")
    order.answered(0)
    assert (numbers(order), order.lost) == ([4], 4)
    order.put(header(6), b"")
    assert order.lacks
    order.answered(0)
    assert (numbers(order), order.lost) == ([6], 5)


def test_one_topic_is_asked_for_after_the_other_and_again_if_no_answer_comes(monkeypatch):
    now, asked, come = [0.0], list[Any](), list[Any]()
    monkeypatch.setattr(live_recording.time, "monotonic", lambda: now[0])
    reader: Any = SimpleNamespace(
        ask=lambda *what: asked.append(what), receive=lambda: come.pop(0) if come else None
    )
    orders = {"/a": TopicOrder(), "/b": TopicOrder()}
    requests = PastRequests(reader, 7, orders)
    requests.turn()
    requests.turn()
    assert asked == [("/a", 0)]
    now[0] += 2 * live_recording.PATIENCE
    come += [("/a", (header(0), b"")), ("/a", (header(1, run=6), b""))]
    requests.turn()
    assert asked == [("/a", 0), ("/a", 0)]
    assert numbers(orders["/a"]) == [0]
    come += [("/a", (header(1), b"")), ("/a", None)]
    requests.turn()
    assert asked[2:] == [("/b", 0)]
    come.append(("/b", None))
    requests.turn()
    assert all(one.whole for one in orders.values())
    assert len(asked) == 3


def test_what_was_recorded_is_told_in_a_line(tmp_path):
    done = RecordedGraph(tmp_path / "a.mcap", {"/a": 3, "/b": 0}, {})
    assert recorded_text(done).endswith("a.mcap: 3 messages on 1 topics")
    assert recorded_text(done._replace(lost={"/a": 2})).endswith("; not recorded: 2 of /a")


@pytest.mark.parametrize("topic", ["/log", "/node/status"])
def test_what_may_be_lost_for_good_is_refused(topic, tmp_path):
    what: Any = SimpleNamespace(name=topic)
    with pytest.raises(ValueError, match=f"{topic} cannot be recorded"):
        live_recording.record_graph(SimpleNamespace(), [what], tmp_path / "a", echo=print)
    assert not list(tmp_path.iterdir())
