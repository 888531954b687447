"""What a node does when it is started again: it goes through what it had done, and goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from palpate.messages.bus.journal import Consumed
from palpate.messages.bus.station import Station
from palpate.nodes.node import Finished
from palpate.nodes.runtime_order import Order
from palpate.nodes.runtime_work import NodeWork, Parcel, Promise

Speech = Sequence[Parcel | Promise | Finished]
Publish = Callable[[Iterable[Parcel | Promise | Finished]], None]


def rehearse(
    work: NodeWork,
    before: Sequence[Consumed],
    station: Station,
    *,
    publish: Publish,
    turn: Callable[[], bool],
    beat: Callable[[], None],
) -> Speech:
    """Do once more what an earlier start of the node has done, unheard but by who lacks it.

    Parameters
    ----------
    work : NodeWork
        The node.
    before : sequence of Consumed
        What it had handled.
    station : Station
        Its sockets.
    publish : function
        Sends what it says.
    turn : function
        Waits for a moment, obeys the launcher, and says whether to go on.
    beat : function
        Gives a sign of life.

    Returns
    -------
    sequence
        What it died over: it may have been making something that takes long, which is still to be
        made and sent, with all that it said after that.
    """
    order, owed = Order(before), list[Parcel | Promise | Finished]()
    while order.rehearsing and turn():
        while (come := station.receive()) is not None:
            order.put(come)
        while order.rehearsing and (arrival := order.take()) is not None:
            owed = _said_again(work.rehearse(arrival), station, publish)
            beat()
    station.give_back(order.rest())
    return owed


def _said_again(
    said: Speech, station: Station, publish: Publish
) -> list[Parcel | Promise | Finished]:
    """Publish what had been said before; returns what takes long and had not, and all after it."""
    for place, one in enumerate(said):
        if isinstance(one, Promise) and not station.publisher.was_said(one.topic):
            return list(said[place:])
        publish([one])
    return []


def unsaid(
    said: Iterable[Parcel | Finished], counts: Mapping[str, int]
) -> Iterator[Parcel | Finished]:
    """What of it an earlier start had not come to say.

    Parameters
    ----------
    said : iterable
        What a node says at its start.
    counts : mapping of str to int
        Messages that it had said on each topic.
    """
    had = dict(counts)
    for one in said:
        if isinstance(one, Parcel) and had[one.topic]:
            had[one.topic] -= 1
        else:
            yield one
