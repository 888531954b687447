"""The process of one node, and the one loop in it: receive, handle, publish.

The process never outlives its launcher. A node that is started again replays its journal, and
goes on: it receives everything once more from its publishers, but in whatever order they answer;
the journal says in which order it had handled them.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from importlib import import_module
from multiprocessing import forkserver
from pathlib import Path

import msgspec

from palpate.messages import bus, encode
from palpate.messages.types import LogRecord, NodeStatus, ParameterEvent
from palpate.nodes.runtime.node import Finished, Node, NotReadyError, Source, Wiring, load_node
from palpate.nodes.runtime.repeating import JournalOrder, OutsideMessages, unpublished
from palpate.nodes.runtime.sources import RobotPace, SourceWork, Work
from palpate.nodes.runtime.work import (
    Latency,
    NodeWork,
    Outgoing,
    Promise,
    SinkWork,
    failure_text,
    failure_trace,
)
from palpate.preloading import signal_at_parent_death

NOT_STARTED = 4  # Exit code of a process that could not even reach the launcher
FAILED = 3  # Exit code of a node that has told the launcher why it failed
HEARTBEAT_PERIOD = 0.25  # A node gives a sign of life this often, s
IDLE_MS = int(HEARTBEAT_PERIOD * 500)
BUSY_PERIOD = 0.02  # A node that is busy for long looks this often who asks it for the past, s
FLUSH_MS = 20  # A sink to which nothing comes for so long puts away what it holds
DRAIN_TIME = 1.0  # A sink that is told to end still writes what has arrived, for so long, s
# Takes what is to be called when the process is asked to end, instead of dying at once.
OnTerminate = Callable[[Callable[[], None]], None]
Publication = Outgoing | Promise | Finished


def enter_process(wiring: bytes, place: bytes) -> None:
    """Run one node in this process, and leave the process.

    Given are a `Wiring` (its parameters once more as bytes) and `Addresses`, in msgpack.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    _let_go_of_parent()
    _die_with_parent(signal.SIGKILL)
    seat = msgspec.msgpack.decode(wiring, type=Wiring)
    os.nice(seat.nice)
    try:
        code = run_node(seat, msgspec.msgpack.decode(place, type=bus.Addresses), _protect)
    except Exception as error:  # The edge of the process, without a line to the launcher.
        print(f"{seat.name}: {type(error).__name__}: {error}", file=sys.stderr)
        code = NOT_STARTED
    sys.exit(code)


def _let_go_of_parent() -> None:
    """Close the line that would keep the parent, the server that forks the nodes, alive.

    It ends when nobody holds the far end of its line any more, and hands that end to every child:
    a child has to close it, or neither would end when the launcher is killed.
    """
    line = getattr(forkserver, "_forkserver", None)
    held = getattr(line, "_forkserver_alive_fd", None)
    if line is not None and held is not None:
        os.close(held)
        line._forkserver_alive_fd = None


def run_node(wiring: Wiring, place: bus.Addresses, protect: OnTerminate) -> int:
    """Run one node until the launcher says stop; `protect` is called before a sink opens its file.

    Parameters are the bytes of a msgpack map in the wiring. Returns the exit code: 0, or `FAILED`
    after the launcher has been told why.
    """
    subscriptions: dict[str, list[str]] = {}
    for one in wiring.inputs:
        subscriptions.setdefault(one.publisher, []).append(one.topic)
    station = bus.NodeSockets(
        wiring.name,
        place,
        subscriptions=subscriptions,
        publications={one: wiring.subscribers.get(one, ()) for one in wiring.outputs.values()},
        persistent=wiring.persistent,
        types=wiring.types,
    )
    loop = NodeLoop(wiring.name, station, going=place.going, rate=wiring.rate)
    try:
        with ExitStack() as kept:
            loop.run(_load(wiring, place, loop, protect, kept))
        loop.send_exiting()
    except Exception as error:  # The edge of the process: whatever it was must be told in words.
        loop.send_failed(error)
        return FAILED
    finally:
        station.close()
    return 0


def _load(
    wiring: Wiring, place: bus.Addresses, loop: NodeLoop, protect: OnTerminate, kept: ExitStack
) -> Work:
    """The node at work; what it holds is put away with the stack."""
    node = load_node(wiring.module)
    import_module(wiring.module)
    params: object = msgspec.msgpack.decode(wiring.params, type=node.params)
    file = Path(place.journals[wiring.name])
    if isinstance(node, Node):
        edges = [(one.publisher, one.topic) for one in wiring.inputs]
        if not node.has_side_effects:
            loop.journal = kept.enter_context(closing(bus.Journal(file, edges)))
        if not node.has_side_effects:
            loop.outside = kept.enter_context(closing(OutsideMessages(file)))
        if node.settable:
            loop.changes = kept.enter_context(closing(bus.ParameterLog(file)))
        had = loop.changes.before if loop.changes else ()
        changes = [msgspec.json.decode(one, type=ParameterEvent) for one in had]
        loop.work = NodeWork(node, params, wiring, changes)
    elif isinstance(node, Source):
        tally = kept.enter_context(closing(bus.SourceProgress(file))) if node.repeats else None
        loop.work = SourceWork(node, params, wiring, tally)
    else:
        protect(loop.end)
        loop.work = SinkWork(node, params, wiring, again=place.epoch > 0)
        loop.skip(loop.work.had)
    return kept.enter_context(closing(loop.work))


def _protect(end: Callable[[], None]) -> None:
    """Let the process close its file when it is asked to end, or its launcher dies."""
    signal.signal(signal.SIGTERM, lambda *_: end())
    _die_with_parent(signal.SIGTERM)


def _die_with_parent(number: signal.Signals) -> None:
    """Have the kernel send a signal when the parent process dies."""
    if sys.platform != "linux":
        return
    before = os.getppid()
    signal_at_parent_death(number)
    launcher = multiprocessing.parent_process()
    # The parent may have died before the kernel was told.
    if os.getppid() != before or (launcher is not None and not launcher.is_alive()):
        os._exit(NOT_STARTED)


class NodeLoop:
    """A node's loop over its station."""

    # `going`: whether the graph had been started before. The node then goes through what it had
    # done, and that is sent only to those who lack something of it.
    def __init__(
        self, name: str, station: bus.NodeSockets, *, going: bool = False, rate: float = 0.0
    ) -> None:
        self.work: Work | None = None  # What the node does; None until it is loaded
        # Where it puts down what it handles; only of nodes that could do it again
        self.journal: bus.Journal | None = None
        self.changes: bus.ParameterLog | None = None  # Where it puts down what is set, if it may be
        # What tools have it publish; only of nodes that publish again after a death
        self.outside: OutsideMessages | None = None
        self._unset: list[bus.ControlMessage] = []  # To be done between two messages
        self._name, self._station = name, station
        station.while_blocked = self._beat_if_due
        self._going, self._ended = going, False
        self._joined: bool | None = None
        self._state = "starting"
        self._next_beat = self._next_look = 0.0
        self._looking = False
        self._pace = RobotPace(rate)
        self._held: list[Publication] = []  # What is published at its robot time

    def end(self) -> None:
        """Leave the loop at the next occasion; may be called from a signal handler."""
        self._ended = True

    def skip(self, had: Mapping[str, int]) -> None:
        """Ask for no message of a topic before so many."""
        for topic, number in had.items():
            self._station.subscriber.skip(topic, number)

    def run(self, work: Work) -> None:
        """Turn until the launcher says stop, or the process is asked to end."""
        station = self._station
        work.steps.before_each = self._look_up
        if self._going:
            self._state = "rebuilding"
            owed = self._go_on(work)
            self._state, self._next_beat = "running", 0.0
            self._beat_if_due()
            self._publish(owed)
            self._publish_outside()
        while not self._ended:
            received, told = station.wait(self._patience(work))
            self._next_look = time.monotonic() + BUSY_PERIOD
            if told:
                self._obey(work)
            if not self._going:
                self._join()
            elif self._held:
                self._let_go(self._held)
            elif self._unset:
                for word in self._take_unset():
                    self._do(work, word)
            elif received or station.waiting:
                arrival = station.receive()
                if arrival is not None:
                    self._handle(work, arrival)
            elif isinstance(work, SinkWork) and work.unwritten:
                work.flush()
            elif isinstance(work, SourceWork):
                self._publish(work.publish_due())
            self._beat_if_due()
        if isinstance(work, SinkWork):
            self._take_the_rest(work)
            work.missing = station.subscriber.missing

    def send_exiting(self) -> None:
        """Tell the launcher the last counters."""
        self._station.line.send("exiting", status=encode(self._status("ending")))

    def send_failed(self, error: Exception) -> None:
        """Tell the launcher, and those who listen, what went wrong."""
        doing = self.work.doing if self.work else "loading"
        text, trace = failure_text(doing, error), failure_trace(error)
        self._station.line.send("failed", text=text, trace=trace)

    def _patience(self, work: Work) -> int:
        """Longest wait for something to arrive, ms."""
        if self._going:
            if self._station.waiting or self._held:
                return 0
            if isinstance(work, SourceWork):
                return work.patience(IDLE_MS)
            if isinstance(work, SinkWork) and work.unwritten:
                return FLUSH_MS
        return IDLE_MS

    def _handle(self, work: Work, arrival: bus.Received) -> None:
        """Handle a message, once it is put down that it is; if that acts on the world, after it."""
        publisher, topic, seq = arrival.publisher, arrival.topic, arrival.header.seq
        if isinstance(work, NodeWork) and work.has_side_effects:
            published = work.take(arrival)
            ends = [one for one in published if isinstance(one, Finished)]
            outgoing = [one for one in published if isinstance(one, Outgoing)]
            cause = bus.Cause(publisher, topic, seq, ends[0].reason if ends else "")
            self._station.answer([one[:4] for one in outgoing], cause)
            self._publish(ends)
            return
        if self.journal is not None:
            self.journal.note(publisher, topic, seq)
        self._let_go(work.each(arrival) if isinstance(work, NodeWork) else work.take(arrival))

    def _let_go(self, published: Iterable[Publication]) -> None:
        """Publish what was handled; what a robot has done is held back until its robot time."""
        if self._pace.rate:
            published = [*published]
            left = self._pace.wait(published, time.monotonic())
            self._held = published if left > 0.0 else []
            if self._held:
                time.sleep(min(left, BUSY_PERIOD))
                return
        self._publish(published)
        self._publish_outside()

    def _go_on(self, work: Work) -> list[Publication]:
        """Take up what an earlier start has done; returns what it had not come to publish."""
        station, owed = self._station, list[Publication]()
        gc.freeze()
        if isinstance(work, NodeWork) and work.has_side_effects:
            past = station.publisher.past
            self.skip(work.leave_out(past.handled))
            self._publish(unpublished(work.begin(), past.counts))
            return [Finished(past.finished)] if past.finished else []
        self._publish(work.begin())
        self._publish_outside()
        if isinstance(work, NodeWork) and self.journal is not None:
            owed += self._replay(work, self.journal.before)
        station.publisher.go_live()
        return owed

    def _replay(self, work: NodeWork, before: Sequence[bus.Consumed]) -> list[Publication]:
        """Do once more what an earlier start has done.

        Returns what it died over, or had not come to: it may have been making something that takes
        long, which is still to be made and sent, with all that is new after that.
        """
        station, order, owed = self._station, JournalOrder(before), list[Publication]()
        while order.replaying and self._turn_again(work):
            while (come := station.receive()) is not None:
                order.put(come)
            while order.replaying and (arrival := order.take()) is not None:
                owed += self._republish(work.replay(arrival), behind=bool(owed))
                if not owed:
                    self._publish_outside()
                self._beat_if_due()
        station.give_back(order.rest())
        return owed

    def _republish(self, published: Sequence[Publication], *, behind: bool) -> list[Publication]:
        """Publish it once more; returns what takes long and had not been, and what is new after it.

        All that is new, if the node is `behind` already: it had not come to all that it received.
        """
        owed = list[Publication]()
        for one in published:
            had = not isinstance(one, Finished) and self._station.publisher.was_published(one.topic)
            if had or not (behind or owed or isinstance(one, Promise)):
                self._publish([one])
            else:
                owed.append(one)
        return owed

    def _turn_again(self, work: Work) -> bool:
        """Wait for a moment while it is rebuilt, and obey; False if it is told to end."""
        _, told = self._station.wait(0 if self._station.waiting else IDLE_MS)
        if told:
            self._obey(work)
        self._beat_if_due()
        return not self._ended

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
                self._going, self._state = True, "running"
                # What was imported stays; looking through it again would hold up messages.
                gc.freeze()
                self._publish(work.begin())
                self._pace.start(time.monotonic())
            elif word["kind"] == "count":
                if self._held:  # it has more to say: whoever counts asks again
                    continue
                line.send(
                    "count",
                    round=word["round"],
                    sent=self._station.publisher.sent,
                    consumed=[[*edge, number] for edge, number in work.consumed.items()],
                    waits=work.waits,
                    can_publish=isinstance(work, SourceWork) and work.can_publish,
                )
            elif word["kind"] == "stop":
                self._ended = True
            elif isinstance(work, NodeWork) and self._going:
                self._unset.append(word)
            elif isinstance(work, NodeWork):
                told = {"text": f"{self._name} has not begun yet", "again": True}
                line.send("refused", ticket=word["ticket"], **told)
            elif isinstance(work, SourceWork):
                self._publish(work.obey(word))
                line.send("acknowledged", ticket=word["ticket"])

    def _publish_outside(self) -> None:
        """Publish what tools had an earlier start publish, where its turn has come."""
        if self.outside is not None and self.outside.left:
            self._publish(self.outside.due(self._station.publisher.past.count))

    def _take_unset(self) -> list[bus.ControlMessage]:
        words, self._unset = self._unset, []
        return words

    def _do(self, work: Work, word: bus.ControlMessage) -> None:
        """What a tool asks for between two messages."""
        if word["kind"] == "set":
            self._set(work, word)
            return
        assert isinstance(work, NodeWork)
        parcel = work.outside(word["topic"], word["body"])
        if self.outside is not None:
            self.outside.note(parcel, self._station.publisher.past.count(parcel.topic))
        self._publish([parcel])
        self._station.line.send("acknowledged", ticket=word["ticket"])

    def _set(self, work: Work, word: bus.ControlMessage) -> None:
        """Set a parameter before the next message, once it is put down that it is."""
        assert isinstance(work, NodeWork) and self.changes is not None
        try:
            change = work.change(word["param"], word["value"])
        except ValueError as error:
            told = {"text": f"{self._name}: {error}", "again": isinstance(error, NotReadyError)}
            self._station.line.send("refused", ticket=word["ticket"], **told)
            return
        self.changes.note(msgspec.json.encode(change))
        self._publish(work.set(change))
        self._station.line.send("acknowledged", ticket=word["ticket"])

    def _publish(self, published: Iterable[Publication]) -> None:
        for one in published:
            if isinstance(one, Promise):
                self._station.publisher.promise(*one)
            elif isinstance(one, Finished):
                self._station.line.send("finished", reason=one.reason)
                text = f"finished: {one.reason}"
                record = LogRecord(node=self._name, level="info", text=text, robot_time=0.0)
                self._station.tap.publish(record)
            else:
                self._publish_outside()  # each message keeps its number on its topic
                self._station.send(*one)

    def _look_up(self) -> None:
        """From work that takes long: answer those who ask for the past, and give a sign of life.

        What they ask for may have to be made itself: from there nobody looks up again.
        """
        now = time.monotonic()
        if now < self._next_look or self._looking:
            return
        self._looking, self._next_look = True, now + BUSY_PERIOD
        try:
            self._station.publisher.serve()
            self._beat_if_due()
        finally:
            self._looking = False

    def _beat_if_due(self) -> None:
        if time.monotonic() < self._next_beat:
            return
        self._next_beat = time.monotonic() + HEARTBEAT_PERIOD
        self._station.tap.refresh()
        self._station.tap.publish(self._status(self._state))
        self._station.line.send("alive")

    def _status(self, state: str) -> NodeStatus:
        subscriber, publisher = self._station.subscriber, self._station.publisher
        latency = self.work.latency if self.work else Latency()
        return NodeStatus(
            node=self._name,
            state=state,  # type: ignore[arg-type]
            messages=latency.count,
            sent=sum(publisher.sent.values()),
            gaps=subscriber.gaps,
            duplicates=subscriber.duplicates,
            p50=latency.quantile(0.5),
            p99=latency.quantile(0.99),
            cpu=time.process_time(),
            steps=dict(self.work.steps.seconds) if self.work else {},
        )

    def _take_the_rest(self, work: SinkWork) -> None:
        """When others have died, what they published last is worth the most."""
        deadline = time.monotonic() + DRAIN_TIME
        while time.monotonic() < deadline and (arrival := self._station.receive()) is not None:
            work.take(arrival)
