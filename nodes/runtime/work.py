"""What a node does between two messages: the part of the runtime that has no socket.

A message is held back until the node's latched needs have come, decoded, handed to its handler,
and what the handler publishes is checked and encoded. The same steps serve a node in a process
of its own and one that is composed with others.
"""

from __future__ import annotations

import math
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from palpate.core.plugins import code_place
from palpate.messages import codec_of, decode, encode
from palpate.messages.bus import Received
from palpate.messages.types import LogRecord, ParameterEvent
from palpate.nodes.runtime.node import (
    Deferred,
    Finished,
    Node,
    Sink,
    SinkWriter,
    Wiring,
    with_parameter,
)

if TYPE_CHECKING:
    from palpate.messages.recording import RecordedMessage

Edge = tuple[str, str]  # Publisher and topic on the wire
Output = tuple[str, object] | Finished
OutputT = TypeVar("OutputT")
MAX_FAILURE_CHARS = 1000  # Longest sentence that tells of a failure, its place aside
PIECE_CHARS = 4000  # Of a longer trace that stand in one line of the log
MAX_TRACE_CHARS = 20_000  # Longest trace that is kept of one, characters
_LOG_BIN_WIDTH = math.log(1.05)
_BINS = 512


class Outgoing(NamedTuple):
    """A message that is ready to be sent."""

    topic: str  # Topic on the wire
    body: bytes  # The message, encoded
    robot_time: float  # Robot time in the message, s; 0 if it has none
    schema: int  # Hash of the message type's schema
    outlives: bool = False  # Whether it took long, and is not made again by a next start
    outside: bool = False  # Whether a tool had the node publish it


class Promise(NamedTuple):
    """A message that had been sent before, and is made once more only if somebody lacks it."""

    topic: str  # Topic on the wire
    make: Callable[[], bytes]  # Makes the message, encoded
    schema: int  # Hash of the message type's schema


class ContractError(RuntimeError):
    """A node did what its own declaration does not allow."""


class NodeWork:
    """One node in the course of its run.

    Raises ContractError if the wiring names an input or output that the node does not declare.
    """

    def __init__(
        self,
        node: Node,
        params: Any,  # Instance of the node's parameter type
        wiring: Wiring,
        # Parameters that an earlier run or start of it had set: they are set at the same places
        changes: Iterable[ParameterEvent] = (),
    ) -> None:
        unknown = [one.local for one in wiring.inputs if one.local not in node.inputs]
        unknown += [local for local in wiring.outputs if local not in node.outputs]
        if unknown:
            text = f"{wiring.name} is wired to {unknown[0]}, which it does not declare"
            raise ContractError(text)
        self.name, self.has_side_effects = wiring.name, node.has_side_effects
        self.latency = Latency()  # Time of its handlers
        self.steps = CpuSteps()  # Processor time of its work
        # Messages handled, by publisher and topic
        self.consumed: dict[Edge, int] = {(one.publisher, one.topic): 0 for one in wiring.inputs}
        self._node, self._params, self._state = node, params, None
        self._step = node.step or wiring.name
        self._wires = wiring.outputs
        self._received = {one.topic: node.inputs[one.local] for one in wiring.inputs}
        self._locals = {one.topic: one.local for one in wiring.inputs}
        self._handled = Counter[str]()  # Messages by the topic as the node calls it
        self._changes = [*changes]  # Parameters that are still to be set
        self._current: Received | None = None
        self._begun = False
        self._missing = {one.topic for one in wiring.inputs if one.local in node.needs}
        self._held: list[Received] = []

    @property
    def doing(self) -> str:
        """What it was last busy with, in words."""
        return "starting" if self._current is None else _handling(self._current)

    @property
    def waits(self) -> list[str]:
        """Topics without whose first message nothing else is handled."""
        return sorted(self._missing)

    def leave_out(self, handled: Mapping[Edge, int]) -> dict[str, int]:
        """Messages of each topic that an earlier start has handled, and that are not handled again.

        What it needs before all else is: its state is a fresh one.
        """
        left_out = {edge: n for edge, n in handled.items() if edge[1] not in self._missing}
        self.consumed |= left_out
        return {topic: number for (_, topic), number in left_out.items()}

    def begin(self) -> list[Outgoing | Finished]:
        """Start the node, and return what it publishes."""
        with self.steps(self._step):
            self._state, outputs = self._node.start(self._params)
            self._begun = True
            return [*(self._pack(output) for output in outputs), *self._set_due(self._pack)]

    def change(self, param: str, value: str) -> ParameterEvent:
        """That a settable parameter is set, to a value in JSON, before the next message.

        Raises ValueError if the node refuses it.
        """
        made = with_parameter(self._params, param, value)
        if self._begun:
            self._node.check_set(made, self._state)
        topic = self._node.settable[param]
        return ParameterEvent(param=param, value=value, topic=topic, after=self._handled[topic])

    def set(self, change: ParameterEvent) -> list[Outgoing | Finished]:
        """Set a parameter, as soon as the node has started; what it publishes of that."""
        self._changes.append(change)
        return self._set_due(self._pack) if self._begun else []

    def outside(self, topic: str, body: bytes) -> Outgoing:
        """A message, on a topic on the wire, that a tool has the node publish.

        Raises CodecError if it is not of the topic's type.
        """
        local = next(one for one, wire in self._wires.items() if wire == topic)
        cls = self._node.outputs[local]
        time_s = float(getattr(decode(cls, body), "robot_time", 0.0))
        return Outgoing(topic, body, time_s, codec_of(cls).hash, outside=True)

    def _set_due(self, pack: Callable[[Output], OutputT]) -> list[OutputT]:
        """Set what is to be set at this place, each told of in one message."""
        due = [one for one in self._changes if one.after <= self._handled[one.topic]]
        self._changes = [one for one in self._changes if one not in due]
        for one in due:
            self._params = with_parameter(self._params, one.param, one.value)
        return [pack((self._node.event_topic or "", one)) for one in due]

    def take(self, arrival: Received) -> list[Outgoing | Finished]:
        """Handle one message, or hold it until the needs are met; return what the node publishes.

        Raises CodecError if the message, or one of the outputs, is not of its type; ContractError
        if the handler publishes what the node does not declare.
        """
        return [*self.each(arrival)]

    def each(self, arrival: Received) -> Iterable[Outgoing | Finished]:
        """The same one by one: what takes no time need not wait for what does."""
        return self._take(arrival, self._pack)

    def replay(self, arrival: Received) -> list[Outgoing | Promise | Finished]:
        """The same for a message that had been handled before: what takes long is only promised."""
        return [*self._take(arrival, self._promise)]

    def close(self) -> None:
        """Nothing to put away."""

    def _take(self, arrival: Received, pack: Callable[[Output], OutputT]) -> Iterable[OutputT]:
        if not self._missing:
            return self._handle(arrival, pack)
        if arrival.topic not in self._missing:
            self._held.append(arrival)
            return ()
        return self._take_need(arrival, pack)

    def _take_need(self, arrival: Received, pack: Callable[[Output], OutputT]) -> Iterator[OutputT]:
        yield from self._handle(arrival, pack)
        self._missing.discard(arrival.topic)
        if not self._missing:
            for held in self._held:
                yield from self._handle(held, pack)
            self._held.clear()

    def _handle(self, arrival: Received, pack: Callable[[Output], OutputT]) -> Iterable[OutputT]:
        self._current = arrival
        cls, handler = self._received[arrival.topic]
        if arrival.header.schema != codec_of(cls).hash:
            raise ContractError(f"{arrival.topic} is not a {cls.__name__} of this version")
        message: object = decode(cls, arrival.body)
        began = time.perf_counter_ns()
        with self.steps(self._step):
            self._state, outputs = handler(self._params, self._state, message)
            ready = list[OutputT]()
            for output in outputs:
                if not isinstance(output, Finished) and isinstance(output[1], Deferred):
                    break
                ready.append(pack(output))
        spent = time.perf_counter_ns() - began
        if len(ready) < len(outputs):
            return chain(ready, self._long(arrival, outputs[len(ready) :], pack, spent))
        self._count(arrival, spent)
        return [*ready, *self._set_due(pack)] if self._changes else ready

    def _long(
        self,
        arrival: Received,
        outputs: Sequence[Output],
        pack: Callable[[Output], OutputT],
        spent: int,  # On the message so far, ns
    ) -> Iterator[OutputT]:
        """Outputs that take long, one by one."""
        for output in outputs:
            began = time.perf_counter_ns()
            with self.steps(self._step):
                packed = pack(output)
            spent += time.perf_counter_ns() - began
            yield packed
        self._count(arrival, spent)
        yield from self._set_due(pack)

    def _count(self, arrival: Received, spent: int) -> None:
        self.latency.add(spent)
        self.consumed[arrival.publisher, arrival.topic] += 1
        self._handled[self._locals[arrival.topic]] += 1

    def _promise(self, output: Output) -> Outgoing | Promise | Finished:
        if isinstance(output, Finished):
            return output
        local, later = output
        if not isinstance(later, Deferred):
            return self._pack(output)
        wire = self._wire(local, later.cls)
        return Promise(wire, lambda: encode(self._made(local, later)), codec_of(later.cls).hash)

    def _pack(self, output: Output) -> Outgoing | Finished:
        if isinstance(output, Finished):
            return output
        local, message = output
        outlives = isinstance(message, Deferred)
        if isinstance(message, Deferred):
            message = self._made(local, message)
        wire = self._wire(local, type(message))
        time_s = float(getattr(message, "robot_time", 0.0))
        return Outgoing(wire, encode(message), time_s, codec_of(type(message)).hash, outlives)

    def _made(self, local: str, later: Deferred) -> object:
        message = later.make(self.steps)
        check_declared(self.name, self._node.outputs, local, type(message))
        return message

    def _wire(self, local: str, cls: type) -> str:
        if self._node.outputs.get(local) is not cls:
            check_declared(self.name, self._node.outputs, local, cls)
        if local not in self._wires:
            raise ContractError(
                f"{self.name} published {local}, which another finger's node publishes"
            )
        return self._wires[local]


def recorded_changes(
    messages: Iterable[RecordedMessage], node: Node, wiring: Wiring
) -> list[ParameterEvent]:
    """Parameters that were set, according to a recording, while a node ran."""
    topic = wiring.outputs.get(node.event_topic or "")
    own = (one for one in messages if one.topic == topic and not one.outside)
    return [decode(ParameterEvent, one.body) for one in own]


def check_declared(name: str, declared: Mapping[str, type], local: str, cls: type) -> None:
    """ContractError if a node does not declare a topic that it publishes on, or its type."""
    if local not in declared:
        known = ", ".join(declared) or "nothing"
        raise ContractError(
            f"{name} published {local}, which it does not declare; it declares {known}"
        )
    if declared[local] is not cls:
        raise ContractError(
            f"{name} published a {cls.__name__} on {local}, declared as {declared[local].__name__}"
        )


class SinkWork:
    """A sink in its run, which writes all it receives; ContractError if it cannot go on."""

    def __init__(
        self,
        sink: Sink,
        params: Any,  # Instance of the sink's parameter type
        wiring: Wiring,
        *,
        again: bool = False,  # Whether an earlier start of it has written already
    ) -> None:
        self.doing = "opening"  # What it was last busy with, in words
        self.latency, self.steps, self._step = Latency(), CpuSteps(), sink.step
        self.consumed: dict[Edge, int] = {(one.publisher, one.topic): 0 for one in wiring.inputs}
        self.waits: list[str] = []
        types = {one.topic: one.type for one in wiring.inputs}
        # Messages that were sent and never came, by topic; whoever listens reports it
        self.missing: Mapping[str, int] = {}
        self.unwritten = False  # Whether it has received something since it was last flushed
        # Messages of each topic that an earlier start of it has kept
        self.had: Mapping[str, int] = {}
        if not again:
            self._writer: SinkWriter = sink.open(params, types)
            return
        if sink.resume is None:
            raise ContractError(f"{wiring.name} cannot go on with what it had written")
        self._writer, self.had = sink.resume(params, types)
        for publisher, topic in self.consumed:
            self.consumed[publisher, topic] = self.had.get(topic, 0)

    def begin(self) -> list[Outgoing | Finished]:
        """Nothing to publish."""
        return []

    def take(self, arrival: Received) -> list[Outgoing | Finished]:
        """Write one message."""
        self.doing = _handling(arrival)
        began = time.perf_counter_ns()
        with self.steps(self._step):
            self._writer.write(arrival.topic, arrival.header, arrival.body)
        self.unwritten = True
        self.latency.add(time.perf_counter_ns() - began)
        self.consumed[arrival.publisher, arrival.topic] += 1
        return []

    def flush(self) -> None:
        """Nothing has come for a while: have what was written put away."""
        self.unwritten = False
        with self.steps(self._step):
            self._writer.flush()

    def close(self) -> None:
        """Close the writer, so that all that was written can be read."""
        self.doing = "closing"
        with self.steps(self._step):
            self._writer.close(self.missing)


def failure_text(doing: str, error: Exception) -> str:
    """What a node was doing, what went wrong, and where: in the user's code, or else in palpate."""
    what, place = next(iter(str(error).splitlines()), ""), code_place(error)
    text = f"{doing}: {type(error).__name__}: {what}"[:MAX_FAILURE_CHARS]
    if place is None:
        return text
    file, here = Path(place.file), Path.cwd()
    shown = file.relative_to(here) if file.is_relative_to(here) else file
    return f"{text} ({place._replace(file=str(shown))})"


def failure_trace(error: Exception) -> str:
    """The trace of an error, its end if it is very long."""
    return "".join(traceback.format_exception(error))[-MAX_TRACE_CHARS:]


def failure_records(name: str, text: str, trace: str) -> list[LogRecord]:
    """Lines for the log about a node that failed: the sentence, and its trace in pieces."""
    pieces = [trace[i : i + PIECE_CHARS] for i in range(0, len(trace), PIECE_CHARS)]
    return [
        LogRecord(node=name, level="error", text=text, robot_time=0.0),
        *(LogRecord(node=name, level="debug", text=one, robot_time=0.0) for one in pieces),
    ]


def _handling(arrival: Received) -> str:
    return f"handling {arrival.topic} {arrival.header.seq} from {arrival.publisher}"


class CpuSteps:
    """Counts this thread's processor time by steps; one within another interrupts it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}  # By name of the step, s
        # Called before each step: what is made for long is no reason not to answer others
        self.before_each: Callable[[], None] = lambda: None
        self._open: list[str] = []
        self._since = 0.0

    def __call__(self, name: str) -> CpuSteps:
        """Begin a step, which lasts to the end of the ``with`` that it is called for."""
        self.before_each()
        self._add()
        self._open.append(name)
        return self

    def __enter__(self) -> None:
        """The step has begun."""

    def __exit__(self, *_: object) -> None:
        self._add()
        self._open.pop()

    def _add(self) -> None:
        """Count the time since the last change for the step that is open, if one is."""
        before, self._since = self._since, time.thread_time()
        for name in self._open[-1:]:
            self.seconds[name] = self.seconds.get(name, 0.0) + self._since - before


class Latency:
    """Counts durations in bins that grow by 5 %, so that a quantile is right to 2.5 %."""

    def __init__(self) -> None:
        self.count = 0  # Durations counted so far
        self._bins = [0] * _BINS

    def add(self, nanoseconds: int) -> None:
        """Count one duration."""
        micro = nanoseconds * 1e-3
        place = int(math.log(micro) / _LOG_BIN_WIDTH) + 1 if micro > 1.0 else 0
        self._bins[min(place, _BINS - 1)] += 1
        self.count += 1

    def quantile(self, share: float) -> float:
        """Duration that this share of all stays below, us; 0 if there is none yet."""
        rest = share * self.count
        for place, number in enumerate(self._bins):
            rest -= number
            if number and rest <= 0:
                return math.exp((place - 0.5) * _LOG_BIN_WIDTH)
        return 0.0
