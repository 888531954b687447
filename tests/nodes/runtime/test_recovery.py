from __future__ import annotations

import pytest

from palpate.messages.bus.message_log import Consumed
from palpate.messages.bus.subscriber import Received
from palpate.messages.codec import Header
from palpate.nodes.runtime.loop import JournalOrder

BEFORE = (Consumed("a", "/x", 0), Consumed("b", "/y", 0), Consumed("a", "/x", 1))


def arrival(publisher: str, topic: str, seq: int) -> Received:
    return Received(publisher, topic, Header(1, 0, seq, 0, 0.0, 0), b"")


def test_arrivals_are_handed_out_in_the_order_of_the_journal():
    order = JournalOrder(BEFORE)
    for seq in (0, 1, 2):
        order.put(arrival("a", "/x", seq))
    assert order.take() == arrival("a", "/x", 0)
    assert order.take() is None and order.replaying
    order.put(arrival("b", "/y", 0))
    order.put(arrival("b", "/y", 1))
    assert [order.take(), order.take()] == [arrival("b", "/y", 0), arrival("a", "/x", 1)]
    assert not order.replaying
    assert order.rest() == [arrival("a", "/x", 2), arrival("b", "/y", 1)]


def test_a_publisher_that_sends_something_else_than_before_is_named():
    order = JournalOrder(BEFORE)
    order.put(arrival("a", "/x", 1))
    with pytest.raises(ValueError, match="/x 0 of a must come next, as before; got 1"):
        order.take()
