"""The process of one node, and its loop: receive, handle, publish.

The process ends with its launcher. A restarted node replays its journal, then continues: it
receives all messages again from its publishers, in any order; the journal has the order in which it
had handled them.
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
from dataclasses import dataclass
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

NOT_STARTED = 4  # exit code of a process that cannot reach the launcher
FAILED = 3  # exit code of a node that has reported its failure to the launcher
# Takes a function that is called when the process is asked to end, instead of its end.
OnTerminate = Callable[[Callable[[], None]], None]
Publication = Outgoing | Promise | Finished


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopSettings:
    """Times of the loop of a node."""

    heartbeat_period: float = 0.25  # between signs of life; larger: hanging is noticed later [s]
    busy_period: float = 0.02  # between answers to joining nodes during long work [s]
    flush_ms: int = 20  # without messages, after which a sink writes its buffer [ms]
    drain_time: float = 1.0  # that a sink may spend at its end on messages that have arrived [s]

    @property
    def idle_ms(self) -> int:
        """Longest wait for messages, half the heartbeat period [ms]."""
        return int(self.heartbeat_period * 500)


def enter_process(wiring: bytes, place: bytes) -> None:
    """Run one node in this process, then exit.

    `wiring` is a `Wiring` with encoded parameters, `place` are `Addresses`, both in msgpack.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    _close_parent_pipe()
    _die_with_parent(signal.SIGKILL)
    decoded = msgspec.msgpack.decode(wiring, type=Wiring)
    os.nice(decoded.nice)
    try:
        code = run_node(decoded, msgspec.msgpack.decode(place, type=bus.Addresses), _protect)
    except Exception as error:  # the launcher cannot be reached
        print(f"{decoded.name}: {type(error).__name__}: {error}", file=sys.stderr)
        code = NOT_STARTED
    sys.exit(code)


def _close_parent_pipe() -> None:
    """Close the pipe that keeps the parent, the fork server, alive.

    The fork server ends when the far end of its pipe is closed, and all children inherit that end.
    With an open end neither would end when the launcher is killed.
    """
    server = getattr(forkserver, "_forkserver", None)
    descriptor = getattr(server, "_forkserver_alive_fd", None)
    if server is not None and descriptor is not None:
        os.close(descriptor)
        server._forkserver_alive_fd = None


def run_node(wiring: Wiring, place: bus.Addresses, protect: OnTerminate) -> int:
    """Run one node until the launcher stops it; `protect` is called before a sink opens its file.

    The parameters in the wiring are encoded in msgpack. Returns the exit code: 0, or `FAILED` after
    the failure was reported to the launcher.
    """
    subscriptions: dict[str, list[str]] = {}
    for edge in wiring.inputs:
        subscriptions.setdefault(edge.publisher, []).append(edge.topic)
    station = bus.NodeSockets(
        wiring.name,
        place,
        subscriptions=subscriptions,
        publications={t: wiring.subscribers.get(t, ()) for t in wiring.outputs.values()},
        persistent=wiring.persistent,
        types=wiring.types,
    )
    loop = NodeLoop(wiring.name, station, going=place.going, rate=wiring.rate)
    try:
        with ExitStack() as kept:
            loop.run(_load(wiring, place, loop, protect, kept))
        loop.send_exiting()
    except Exception as error:  # any exception is reported
        loop.send_failed(error)
        return FAILED
    finally:
        station.close()
    return 0


def _load(
    wiring: Wiring, place: bus.Addresses, loop: NodeLoop, protect: OnTerminate, kept: ExitStack
) -> Work:
    """The work of the node; its files are closed with the stack."""
    node = load_node(wiring.module)
    import_module(wiring.module)
    params: object = msgspec.msgpack.decode(wiring.params, type=node.params)
    file = Path(place.journals[wiring.name])
    if isinstance(node, Node):
        if not node.has_side_effects:
            edges = [(edge.publisher, edge.topic) for edge in wiring.inputs]
            loop.journal = kept.enter_context(closing(bus.Journal(file, edges)))
            loop.outside = kept.enter_context(closing(OutsideMessages(file)))
        if node.settable:
            loop.changes = kept.enter_context(closing(bus.ParameterLog(file)))
        lines = loop.changes.before if loop.changes else ()
        changes = [msgspec.json.decode(line, type=ParameterEvent) for line in lines]
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
    """Call `end` when the process is asked to end, or its launcher dies."""
    signal.signal(signal.SIGTERM, lambda *_: end())
    _die_with_parent(signal.SIGTERM)


def _die_with_parent(number: signal.Signals) -> None:
    """Let the kernel send a signal when the parent process dies."""
    if sys.platform != "linux":
        return
    before = os.getppid()
    signal_at_parent_death(number)
    launcher = multiprocessing.parent_process()
    # The parent may have died before the call.
    if os.getppid() != before or (launcher is not None and not launcher.is_alive()):
        os._exit(NOT_STARTED)


class NodeLoop:
    """The loop of a node.

    `going`: the graph was running already. The node then repeats its earlier work, and sends
    messages only to subscribers that lack them. `rate`: as of `Wiring`.
    """

    def __init__(
        self,
        name: str,
        station: bus.NodeSockets,
        *,
        going: bool = False,
        rate: float = 0.0,
        settings: LoopSettings = LoopSettings(),
    ) -> None:
        self._settings = settings
        self.work: Work | None = None  # None until the node is loaded
        self.journal: bus.Journal | None = None  # of handled messages; None of persistent nodes
        self.changes: bus.ParameterLog | None = None  # of parameters, if any can be set
        self.outside: OutsideMessages | None = None  # requested by tools; None if persistent
        self._requests: list[bus.ControlMessage] = []  # carried out between two messages
        self._name, self._station = name, station
        station.while_blocked = self._beat_if_due
        self._going, self._ended = going, False
        self._joined = False
        self._state = "starting"
        self._next_beat = self._next_look = 0.0
        self._looking = False
        self._pace = RobotPace(rate)
        self._held: list[Publication] = []  # published at their robot time

    def end(self) -> None:
        """End the loop soon; may be called from a signal handler."""
        self._ended = True

    def skip(self, counts: Mapping[str, int]) -> None:
        """Request no messages before a number, by topic."""
        for topic, number in counts.items():
            self._station.subscriber.skip(topic, number)

    def run(self, work: Work) -> None:
        """Run until the launcher stops the node, or the process is asked to end."""
        station = self._station
        work.steps.before_each = self._serve_during_work
        if self._going:
            self._state = "rebuilding"
            unsent = self._repeat_earlier_work(work)
            self._state, self._next_beat = "running", 0.0
            self._beat_if_due()
            self._publish(unsent)
            self._publish_outside()
        while not self._ended:
            has_messages, has_control = station.wait(self._timeout_ms(work))
            self._next_look = time.monotonic() + self._settings.busy_period
            if has_control:
                self._obey(work)
            if not self._going:
                self._join()
            elif self._held:
                self._publish_at_pace(self._held)
            elif self._requests:
                for word in self._take_requests():
                    self._carry_out(work, word)
            elif has_messages or station.waiting:
                arrival = station.receive()
                if arrival is not None:
                    self._handle(work, arrival)
            elif isinstance(work, SinkWork) and work.unwritten:
                work.flush()
            elif isinstance(work, SourceWork):
                self._publish(work.publish_due())
            self._beat_if_due()
        if isinstance(work, SinkWork):
            self._drain(work)
            work.missing = station.subscriber.missing

    def send_exiting(self) -> None:
        """Send the last counters to the launcher."""
        self._station.line.send("exiting", status=encode(self._status("ending")))

    def send_failed(self, error: Exception) -> None:
        """Send the failure to the launcher."""
        doing = self.work.doing if self.work else "loading"
        text, trace = failure_text(doing, error), failure_trace(error)
        self._station.line.send("failed", text=text, trace=trace)

    def _timeout_ms(self, work: Work) -> int:
        """Longest wait for messages [ms]."""
        if self._going:
            if self._station.waiting or self._held:
                return 0
            if isinstance(work, SourceWork):
                return work.timeout_ms(self._settings.idle_ms)
            if isinstance(work, SinkWork) and work.unwritten:
                return self._settings.flush_ms
        return self._settings.idle_ms

    def _handle(self, work: Work, arrival: bus.Received) -> None:
        """Handle a message that is in the journal; a persistent node keeps its answers first."""
        publisher, topic, seq = arrival.publisher, arrival.topic, arrival.header.seq
        if isinstance(work, NodeWork) and work.has_side_effects:
            published = work.take(arrival)
            ends = [output for output in published if isinstance(output, Finished)]
            outgoing = [output for output in published if isinstance(output, Outgoing)]
            cause = bus.Cause(publisher, topic, seq, ends[0].reason if ends else "")
            self._station.answer([output[:4] for output in outgoing], cause)
            self._publish(ends)
            return
        if self.journal is not None:
            self.journal.note(publisher, topic, seq)
        outputs = work.outputs_of(arrival) if isinstance(work, NodeWork) else work.take(arrival)
        self._publish_at_pace(outputs)

    def _publish_at_pace(self, published: Iterable[Publication]) -> None:
        """Publish outputs; with a rate of robot time, hold them until their robot time."""
        if self._pace.rate:
            published = [*published]
            left = self._pace.wait(published, time.monotonic())
            self._held = published if left > 0.0 else []
            if self._held:
                time.sleep(min(left, self._settings.busy_period))
                return
        self._publish(published)
        self._publish_outside()

    def _repeat_earlier_work(self, work: Work) -> list[Publication]:
        """Repeat the work of an earlier start; returns outputs that it had not published."""
        station, unsent = self._station, list[Publication]()
        gc.freeze()
        if isinstance(work, NodeWork) and work.has_side_effects:
            past = station.publisher.past
            self.skip(work.leave_out(past.handled))
            self._publish(unpublished(work.begin(), past.counts))
            return [Finished(past.finished)] if past.finished else []
        self._publish(work.begin())
        self._publish_outside()
        if isinstance(work, NodeWork) and self.journal is not None:
            unsent += self._replay(work, self.journal.before)
        station.publisher.go_live()
        return unsent

    def _replay(self, work: NodeWork, before: Sequence[bus.Consumed]) -> list[Publication]:
        """Handle the messages of an earlier start again, in the order of the journal.

        Returns outputs that it had not published, as a message that was being made when it died,
        and new ones after it.
        """
        station, order, unsent = self._station, JournalOrder(before), list[Publication]()
        while order.replaying and self._wait_in_replay(work):
            while (received := station.receive()) is not None:
                order.put(received)
            while order.replaying and (arrival := order.take()) is not None:
                unsent += self._republish(work.replay(arrival), behind=bool(unsent))
                if not unsent:
                    self._publish_outside()
                self._beat_if_due()
        station.give_back(order.rest())
        return unsent

    def _republish(self, published: Sequence[Publication], *, behind: bool) -> list[Publication]:
        """Publish outputs again; returns unpublished slow ones, and new ones after them.

        If the node is `behind` already, all new outputs are returned.
        """
        unsent = list[Publication]()
        for output in published:
            was_sent = not isinstance(output, Finished) and self._station.publisher.was_published(
                output.topic
            )
            if was_sent or not (behind or unsent or isinstance(output, Promise)):
                self._publish([output])
            else:
                unsent.append(output)
        return unsent

    def _wait_in_replay(self, work: Work) -> bool:
        """Wait for messages during the replay, and obey the launcher; False if it must end."""
        idle_ms = 0 if self._station.waiting else self._settings.idle_ms
        _, has_control = self._station.wait(idle_ms)
        if has_control:
            self._obey(work)
        self._beat_if_due()
        return not self._ended

    def _join(self) -> None:
        """Receive messages before the start, and report when all inputs are in step."""
        self._station.take_in()
        is_joined = self._station.subscriber.in_step
        if is_joined and not self._joined:
            self._station.line.send("ready")
        self._joined = is_joined

    def _obey(self, work: Work) -> None:
        line = self._station.line
        while (word := line.receive()) is not None:
            if word["kind"] == "go" and not self._going:
                self._going, self._state = True, "running"
                # Searching imported modules for garbage again would delay messages.
                gc.freeze()
                self._publish(work.begin())
                self._pace.start(time.monotonic())
            elif word["kind"] == "count":
                if self._held:  # the launcher asks again
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
                self._requests.append(word)
            elif isinstance(work, NodeWork):
                text = f"{self._name} has not begun yet"
                line.send("refused", ticket=word["ticket"], text=text, again=True)
            elif isinstance(work, SourceWork):
                self._publish(work.obey(word))
                line.send("acknowledged", ticket=word["ticket"])

    def _publish_outside(self) -> None:
        """Publish messages that tools requested of an earlier start, when they are next."""
        if self.outside is not None and self.outside.left:
            self._publish(self.outside.due(self._station.publisher.past.count))

    def _take_requests(self) -> list[bus.ControlMessage]:
        words, self._requests = self._requests, []
        return words

    def _carry_out(self, work: Work, word: bus.ControlMessage) -> None:
        """Carry out the request of a tool between two messages."""
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
        """Write a change of a parameter, then set it before the next message."""
        assert isinstance(work, NodeWork) and self.changes is not None
        try:
            change = work.change(word["param"], word["value"])
        except ValueError as error:
            text, again = f"{self._name}: {error}", isinstance(error, NotReadyError)
            self._station.line.send("refused", ticket=word["ticket"], text=text, again=again)
            return
        self.changes.note(msgspec.json.encode(change))
        self._publish(work.set(change))
        self._station.line.send("acknowledged", ticket=word["ticket"])

    def _publish(self, published: Iterable[Publication]) -> None:
        for output in published:
            if isinstance(output, Promise):
                self._station.publisher.promise(*output)
            elif isinstance(output, Finished):
                self._station.line.send("finished", reason=output.reason)
                text = f"finished: {output.reason}"
                record = LogRecord(node=self._name, level="info", text=text, robot_time=0.0)
                self._station.tap.publish(record)
            else:
                self._publish_outside()  # each message keeps its number on its topic
                self._station.send(*output)

    def _serve_during_work(self) -> None:
        """During long work, answer nodes that join, and send signs of life.

        An answer may itself need long work, during which this does nothing.
        """
        now = time.monotonic()
        if now < self._next_look or self._looking:
            return
        self._looking, self._next_look = True, now + self._settings.busy_period
        try:
            self._station.publisher.serve()
            self._beat_if_due()
        finally:
            self._looking = False

    def _beat_if_due(self) -> None:
        if time.monotonic() < self._next_beat:
            return
        self._next_beat = time.monotonic() + self._settings.heartbeat_period
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

    def _drain(self, work: SinkWork) -> None:
        """Write messages that have arrived, as the last ones of nodes that died."""
        deadline = time.monotonic() + self._settings.drain_time
        while time.monotonic() < deadline and (arrival := self._station.receive()) is not None:
            work.take(arrival)
