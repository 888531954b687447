"""Handling of messages by a node, without sockets.

A message is held until the node's needs have arrived, then decoded and handled; the outputs of the
handler are checked and encoded. The same steps are used in processes and in composed graphs.
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

Edge = tuple[str, str]  # publisher and topic on the wire
Output = tuple[str, object] | Finished
OutputT = TypeVar("OutputT")


class Outgoing(NamedTuple):
    """An encoded message."""

    topic: str  # on the wire
    body: bytes  # encoded
    robot_time: float  # of the message [s]; 0 if it has none
    schema: int  # hash of the message type's schema
    outlives: bool = False  # whether it took long, so that the next start does not make it again
    outside: bool = False  # whether a tool requested it


class Promise(NamedTuple):
    """A message of an earlier start, which is made again only if a subscriber lacks it."""

    topic: str  # on the wire
    make: Callable[[], bytes]  # returns the encoded message
    schema: int  # hash of the message type's schema


class ContractError(RuntimeError):
    """A node violates its own declaration."""


class NodeWork:
    """A running node.

    Raises ContractError if the wiring names an input or output that the node does not declare.
    """

    def __init__(
        self,
        node: Node,
        params: Any,  # instance of the node's parameter type
        wiring: Wiring,
        changes: Iterable[ParameterEvent] = (),  # of an earlier run or start, which are repeated
    ) -> None:
        unknown = [edge.local for edge in wiring.inputs if edge.local not in node.inputs]
        unknown += [local for local in wiring.outputs if local not in node.outputs]
        if unknown:
            text = f"{wiring.name} is wired to {unknown[0]}, which it does not declare"
            raise ContractError(text)
        self.name, self.has_side_effects = wiring.name, node.has_side_effects
        self.latency = Latency()  # of its handlers
        self.steps = CpuSteps()  # processor time of its work
        # Numbers of handled messages by publisher and topic.
        self.consumed: dict[Edge, int] = {(x.publisher, x.topic): 0 for x in wiring.inputs}
        self._node, self._params, self._state = node, params, None
        self._step = node.step or wiring.name
        self._wires = wiring.outputs
        self._received = {edge.topic: node.inputs[edge.local] for edge in wiring.inputs}
        self._locals = {edge.topic: edge.local for edge in wiring.inputs}
        self._handled = Counter[str]()  # numbers of messages by the node's names of topics
        self._changes = [*changes]  # that are still to be made
        self._current: Received | None = None
        self._begun = False
        self._missing = {edge.topic for edge in wiring.inputs if edge.local in node.needs}
        self._held: list[Received] = []

    @property
    def doing(self) -> str:
        """Last activity, in words."""
        return "starting" if self._current is None else _handling(self._current)

    @property
    def waits(self) -> list[str]:
        """Needed topics that have not arrived, before which no other message is handled."""
        return sorted(self._missing)

    def leave_out(self, handled: Mapping[Edge, int]) -> dict[str, int]:
        """Numbers of messages of an earlier start that are not handled again, by topic.

        Needed topics are handled again, since the state is new.
        """
        left_out = {edge: n for edge, n in handled.items() if edge[1] not in self._missing}
        self.consumed |= left_out
        return {topic: number for (_, topic), number in left_out.items()}

    def begin(self) -> list[Outgoing | Finished]:
        """Start the node; returns its first outputs."""
        with self.steps(self._step):
            self._state, outputs = self._node.start(self._params)
            self._begun = True
            return [*(self._pack(output) for output in outputs), *self._set_due(self._pack)]

    def change(self, param: str, value: str) -> ParameterEvent:
        """The event of setting a parameter to a value in JSON before the next message.

        Raises ValueError if the node refuses it.
        """
        params = with_parameter(self._params, param, value)
        if self._begun:
            self._node.check_set(params, self._state)
        topic = self._node.settable[param]
        return ParameterEvent(param=param, value=value, topic=topic, after=self._handled[topic])

    def set(self, change: ParameterEvent) -> list[Outgoing | Finished]:
        """Set a parameter, after the start of the node; returns the outputs about it."""
        self._changes.append(change)
        return self._set_due(self._pack) if self._begun else []

    def outside(self, topic: str, body: bytes) -> Outgoing:
        """A message on a topic on the wire that a tool requests.

        Raises CodecError if it is not of the topic's type.
        """
        local = next(name for name, wire in self._wires.items() if wire == topic)
        cls = self._node.outputs[local]
        time_s = float(getattr(decode(cls, body), "robot_time", 0.0))
        return Outgoing(topic, body, time_s, codec_of(cls).hash, outside=True)

    def _set_due(self, pack: Callable[[Output], OutputT]) -> list[OutputT]:
        """Set the parameters that are due after the messages so far, with an event for each."""
        due = [change for change in self._changes if change.after <= self._handled[change.topic]]
        self._changes = [change for change in self._changes if change not in due]
        for change in due:
            self._params = with_parameter(self._params, change.param, change.value)
        return [pack((self._node.event_topic or "", change)) for change in due]

    def take(self, arrival: Received) -> list[Outgoing | Finished]:
        """Handle one message, or hold it until the needs are met; returns the outputs.

        Raises CodecError if the message, or one of the outputs, is not of its type; ContractError
        if the handler publishes what the node does not declare.
        """
        return [*self.outputs_of(arrival)]

    def outputs_of(self, arrival: Received) -> Iterable[Outgoing | Finished]:
        """The same, one by one: fast outputs come before slow ones are made."""
        return self._take(arrival, self._pack)

    def replay(self, arrival: Received) -> list[Outgoing | Promise | Finished]:
        """The same for a message of an earlier start: slow outputs are only promised."""
        return [*self._take(arrival, self._promise)]

    def close(self) -> None:
        """Do nothing: there are no files."""

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
            return chain(ready, self._slow_outputs(arrival, outputs[len(ready) :], pack, spent))
        self._count(arrival, spent)
        return [*ready, *self._set_due(pack)] if self._changes else ready

    def _slow_outputs(
        self,
        arrival: Received,
        outputs: Sequence[Output],
        pack: Callable[[Output], OutputT],
        spent: int,  # time on the message so far [ns]
    ) -> Iterator[OutputT]:
        """Slow outputs, one by one."""
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
        local, slow = output
        if not isinstance(slow, Deferred):
            return self._pack(output)
        wire = self._wire(local, slow.cls)
        return Promise(wire, lambda: encode(self._made(local, slow)), codec_of(slow.cls).hash)

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

    def _made(self, local: str, slow: Deferred) -> object:
        message = slow.make(self.steps)
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
    """Changes of a node's parameters in a recording."""
    topic = wiring.outputs.get(node.event_topic or "")
    own = (item for item in messages if item.topic == topic and not item.outside)
    return [decode(ParameterEvent, item.body) for item in own]


def check_declared(name: str, declared: Mapping[str, type], local: str, cls: type) -> None:
    """Raise ContractError if a node does not declare the topic of an output, or its type."""
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
    """A running sink, which writes its messages; ContractError if it cannot be restarted."""

    def __init__(
        self,
        sink: Sink,
        params: Any,  # instance of the sink's parameter type
        wiring: Wiring,
        *,
        again: bool = False,  # whether it was restarted
    ) -> None:
        self.doing = "opening"  # last activity, in words
        self.latency, self.steps, self._step = Latency(), CpuSteps(), sink.step
        self.consumed: dict[Edge, int] = {(x.publisher, x.topic): 0 for x in wiring.inputs}
        self.waits: list[str] = []
        types = {edge.topic: edge.type for edge in wiring.inputs}
        self.missing: Mapping[str, int] = {}  # numbers of missing messages by topic
        self.unwritten = False  # whether messages have come since the last flush
        self.had: Mapping[str, int] = {}  # numbers of messages of earlier starts by topic
        if not again:
            self._writer: SinkWriter = sink.open(params, types)
            return
        if sink.resume is None:
            raise ContractError(f"{wiring.name} cannot continue its earlier file")
        self._writer, self.had = sink.resume(params, types)
        for publisher, topic in self.consumed:
            self.consumed[publisher, topic] = self.had.get(topic, 0)

    def begin(self) -> list[Outgoing | Finished]:
        """No outputs."""
        return []

    def take(self, arrival: Received) -> list[Outgoing | Finished]:
        """Write a message."""
        self.doing = _handling(arrival)
        began = time.perf_counter_ns()
        with self.steps(self._step):
            self._writer.write(arrival.topic, arrival.header, arrival.body)
        self.unwritten = True
        self.latency.add(time.perf_counter_ns() - began)
        self.consumed[arrival.publisher, arrival.topic] += 1
        return []

    def flush(self) -> None:
        """Save the messages so far, after a while without new ones."""
        self.unwritten = False
        with self.steps(self._step):
            self._writer.flush()

    def close(self) -> None:
        """Close the writer, which completes the file."""
        self.doing = "closing"
        with self.steps(self._step):
            self._writer.close(self.missing)


def failure_text(doing: str, error: Exception, max_chars: int = 1000) -> str:
    """The activity of a node, its error, and the line of code, of the user or else of palpate."""
    reason, place = next(iter(str(error).splitlines()), ""), code_place(error)
    text = f"{doing}: {type(error).__name__}: {reason}"[:max_chars]
    if place is None:
        return text
    file, folder = Path(place.file), Path.cwd()
    shown = file.relative_to(folder) if file.is_relative_to(folder) else file
    return f"{text} ({place._replace(file=str(shown))})"


def failure_trace(error: Exception, max_chars: int = 20_000) -> str:
    """The end of the trace of an error."""
    return "".join(traceback.format_exception(error))[-max_chars:]


def failure_records(name: str, text: str, trace: str, piece_chars: int = 4000) -> list[LogRecord]:
    """Log records about a node that failed: the text, and its trace in pieces."""
    pieces = [trace[i : i + piece_chars] for i in range(0, len(trace), piece_chars)]
    return [
        LogRecord(node=name, level="error", text=text, robot_time=0.0),
        *(LogRecord(node=name, level="debug", text=piece, robot_time=0.0) for piece in pieces),
    ]


def _handling(arrival: Received) -> str:
    return f"handling {arrival.topic} {arrival.header.seq} from {arrival.publisher}"


class CpuSteps:
    """Counts this thread's processor time by steps; an inner step interrupts the outer one."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}  # by name of the step [s]
        # Called before each step, so that other nodes are answered during long work.
        self.before_each: Callable[[], None] = lambda: None
        self._open: list[str] = []
        self._since = 0.0

    def __call__(self, name: str) -> CpuSteps:
        """Begin a step, which lasts to the end of its ``with`` block."""
        self.before_each()
        self._add()
        self._open.append(name)
        return self

    def __enter__(self) -> None:
        """Do nothing: the step has begun."""

    def __exit__(self, *_: object) -> None:
        self._add()
        self._open.pop()

    def _add(self) -> None:
        """Add the time since the last change to the open step, if any."""
        before, self._since = self._since, time.thread_time()
        for name in self._open[-1:]:
            self.seconds[name] = self.seconds.get(name, 0.0) + self._since - before


class Latency:
    """Counts durations in bins that grow by 5 %, so that quantiles are exact to 2.5 %."""

    def __init__(self, bin_ratio: float = 1.05, n_bins: int = 512) -> None:
        self.count = 0  # number of durations
        self._log_width, self._bins = math.log(bin_ratio), [0] * n_bins

    def add(self, nanoseconds: int) -> None:
        """Count one duration."""
        micro = nanoseconds * 1e-3
        place = int(math.log(micro) / self._log_width) + 1 if micro > 1.0 else 0
        self._bins[min(place, len(self._bins) - 1)] += 1
        self.count += 1

    def quantile(self, share: float) -> float:
        """Quantile of the durations [us]; 0 if there are none."""
        rest = share * self.count
        for place, number in enumerate(self._bins):
            rest -= number
            if number and rest <= 0:
                return math.exp((place - 0.5) * self._log_width)
        return 0.0
