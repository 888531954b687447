"""The one loop that every node runs in: receive, handle, publish, and answer the launcher."""

from __future__ import annotations

import gc
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path

import msgspec

from palpate.messages.bus.journal import Consumed, Journal
from palpate.messages.bus.place import Place
from palpate.messages.bus.station import Station
from palpate.messages.bus.subscriber import Arrival
from palpate.messages.codec import encode
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.node import Finished, Node
from palpate.nodes.runtime_order import Order
from palpate.nodes.runtime_work import NodeWork, Parcel, SinkWork, Work, sources_of
from palpate.nodes.wiring import Wiring, load_node

FAILED = 3
"""Exit code of a node that has told the launcher why it failed."""
BEAT = 0.25
"""A node gives a sign of life this often, s."""
LAST_WORDS = 1.0
"""A sink that is told to end still writes what has arrived, for at most this long, s."""
MAX_TRACE = 20_000
"""Longest trace that is sent to the launcher, characters."""

Protect = Callable[[Callable[[], None]], None]
"""Takes what is to be called when the process is asked to end, instead of dying at once."""


def run(wiring: Wiring, place: Place, protect: Protect) -> int:
    """Run one node until the launcher says stop.

    Parameters
    ----------
    wiring : Wiring
        The node's place in the graph; its parameters as the bytes of a msgpack map.
    place : Place
        Addresses of the run.
    protect : callable
        Called for a sink before it opens its file.

    Returns
    -------
    int
        Exit code: 0, or `FAILED` after the launcher has been told why.
    """
    says = {topic: wiring.listeners.get(topic, ()) for topic in wiring.outputs.values()}
    station = Station(wiring.name, place, hears=sources_of(wiring.inputs), says=says)
    loop = Loop(wiring.name, station, going=place.going)
    try:
        with closing(_load(wiring, place, loop, protect)) as work, ExitStack() as kept:
            loop.run(work, _journal(work, wiring, place, kept))
        loop.say_bye()
    except Exception as error:  # The edge of the process: whatever it was must be told in words.
        loop.say_failed(error)
        return FAILED
    finally:
        station.close()
    return 0


def _load(wiring: Wiring, place: Place, loop: Loop, protect: Protect) -> Work:
    node = load_node(wiring.module)
    params: object = msgspec.msgpack.decode(wiring.params, type=node.params)
    if isinstance(node, Node):
        loop.work = NodeWork(node, params, wiring)
        return loop.work
    protect(loop.end)
    loop.work = SinkWork(node, params, wiring, again=place.epoch > 0)
    loop.skip(loop.work.had)
    return loop.work


def _journal(work: Work, wiring: Wiring, place: Place, stack: ExitStack) -> Journal | None:
    """The node's journal; none of a sink, whose file says itself what it has had."""
    if isinstance(work, SinkWork):
        return None
    edges = [(one.publisher, one.topic) for one in wiring.inputs]
    return stack.enter_context(closing(Journal(Path(place.journals[wiring.name]), edges)))


class Loop:
    """A node's loop over its station.

    Parameters
    ----------
    name : str
        Name of the node.
    station : Station
        Its sockets.
    going : bool
        Whether the graph had been started before: the node then goes through what it had done,
        unheard but by those who miss something of it.
    """

    def __init__(self, name: str, station: Station, *, going: bool = False) -> None:
        self.work: Work | None = None
        """What the node does; None until it is loaded."""
        self._name, self._station = name, station
        self._going, self._ended = going, False
        self._joined: bool | None = None
        self._next_beat = 0.0

    def end(self) -> None:
        """Leave the loop at the next occasion; may be called from a signal handler."""
        self._ended = True

    def skip(self, had: Mapping[str, int]) -> None:
        """Ask for no message of a topic before so many."""
        for topic, number in had.items():
            self._station.subscriber.skip(topic, number)

    def run(self, work: Work, journal: Journal | None) -> None:
        """Turn until the launcher says stop, or the process is asked to end."""
        station = self._station
        if self._going:
            self._rehearse(work, journal.before if journal else ())
        while not self._ended:
            busy = self._going and station.waiting
            heard, told = station.wait(0 if busy else int(BEAT * 500))
            if told:
                self._obey(work)
            if not self._going:
                self._join()
            elif heard or station.waiting:
                arrival = station.receive()
                if arrival is not None:
                    self._handle(work, journal, arrival)
            self._beat_if_due()
        if isinstance(work, SinkWork):
            self._take_the_rest(work)

    def say_bye(self) -> None:
        """Tell the launcher the last counters."""
        self._station.line.send("bye", status=encode(self._status("ending")))

    def say_failed(self, error: Exception) -> None:
        """Tell the launcher, and those who listen, what went wrong."""
        doing = self.work.doing if self.work else "loading"
        what = next(iter(str(error).splitlines()), "")
        text = f"{doing}: {type(error).__name__}: {what}"[:1000]
        trace = "".join(traceback.format_exception(error))[-MAX_TRACE:]
        self._station.line.send("failed", text=text, trace=trace)

    def _handle(self, work: Work, journal: Journal | None, arrival: Arrival) -> None:
        """Handle a message, once it is put down that it is."""
        if journal is not None:
            journal.note(arrival.publisher, arrival.topic, arrival.header.seq)
        self._publish(work.take(arrival))

    def _rehearse(self, work: Work, before: Sequence[Consumed]) -> None:
        """Do once more what an earlier start of this node has done, and go on from there."""
        station, order = self._station, Order(before)
        gc.freeze()
        self._publish(work.begin())
        while order.rehearsing and not self._ended:
            _, told = station.wait(0 if station.waiting else int(BEAT * 500))
            if told:
                self._obey(work)
            while (come := station.receive()) is not None:
                order.put(come)
            self._beat_if_due()
            while order.rehearsing and (arrival := order.take()) is not None:
                self._publish(work.take(arrival))
                self._beat_if_due()
        station.give_back(order.rest())
        station.publisher.go_live()

    def _join(self) -> None:
        """Take in what comes before the start, and report when all inputs are in step."""
        self._station.take_in()
        joined = self._station.subscriber.in_step
        if joined and not self._joined:
            self._station.line.send("ready")
        self._joined = joined

    def _obey(self, work: Work) -> None:
        line = self._station.line
        while (word := line.receive()) is not None:
            if word["kind"] == "go" and not self._going:
                self._going = True
                # What was imported stays; looking through it again would hold up messages.
                gc.freeze()
                self._publish(work.begin())
            elif word["kind"] == "count":
                consumed = [[*edge, number] for edge, number in work.consumed.items()]
                sent = self._station.publisher.sent
                waits = work.waits
                line.send("count", round=word["round"], sent=sent, consumed=consumed, waits=waits)
            elif word["kind"] == "stop":
                self._ended = True

    def _publish(self, said: Iterable[Parcel | Finished]) -> None:
        for one in said:
            if isinstance(one, Finished):
                self._station.line.send("finished", reason=one.reason)
                text = f"finished: {one.reason}"
                self._station.tap.say(
                    LogRecord(node=self._name, level="info", text=text, robot_time=0.0)
                )
            else:
                topic, body, robot_time, schema = one
                self._station.send(topic, body, robot_time=robot_time, schema=schema)

    def _beat_if_due(self) -> None:
        if time.monotonic() < self._next_beat:
            return
        self._next_beat = time.monotonic() + BEAT
        self._station.tap.refresh()
        self._station.tap.say(self._status("running" if self._going else "starting"))
        self._station.line.send("alive")

    def _status(self, state: str) -> NodeStatus:
        latency = self.work.latency if self.work else None
        subscriber, publisher = self._station.subscriber, self._station.publisher
        return NodeStatus(
            node=self._name,
            state=state,  # type: ignore[arg-type]
            messages=latency.count if latency else 0,
            sent=sum(publisher.sent.values()),
            gaps=subscriber.gaps,
            duplicates=subscriber.duplicates,
            p50=latency.quantile(0.5) if latency else 0.0,
            p99=latency.quantile(0.99) if latency else 0.0,
            cpu=time.process_time(),
        )

    def _take_the_rest(self, work: SinkWork) -> None:
        """When others have died, what they said last is worth the most."""
        deadline = time.monotonic() + LAST_WORDS
        while time.monotonic() < deadline and (arrival := self._station.receive()) is not None:
            work.take(arrival)
