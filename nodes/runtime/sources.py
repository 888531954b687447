"""A running source: messages at their times, with pauses, or by steps."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from palpate.messages import codec_of, decode, encode
from palpate.messages.bus import ControlMessage, Received, SourceProgress
from palpate.nodes.runtime import work
from palpate.nodes.runtime.node import Finished, Source, Timed, Wiring

_END: Any = object()


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceSettings:
    """Times of the messages of a source."""

    poll_period: float = 0.01  # after which a source without a message is asked again [s]
    spin_time: float = 1.5e-3  # final part of a wait without poll(), which resolves 1 ms [s]
    sleep_overshoot: float = 3e-4  # by which a sleep may be too long; busy-waited at its end [s]
    max_batch: int = 64  # due messages that are published before control messages are read


class SourceWork:
    """A running source."""

    def __init__(
        self,
        source: Source,
        params: Any,  # instance of the source's parameter type
        wiring: Wiring,
        tally: SourceProgress | None = None,  # with messages of earlier starts; None: not counted
        settings: SourceSettings = SourceSettings(),
    ) -> None:
        self._settings = settings
        self.name = wiring.name
        self.latency = work.Latency()  # of making its messages
        self.steps, self._step = work.CpuSteps(), source.step  # processor time of that
        self.consumed: dict[work.Edge, int] = {}
        self.waits: list[str] = []
        paused = source.paused(params) if tally is None or tally.paused is None else tally.paused
        self.pace = PlaybackClock(paused=paused)  # times of publishing
        self._source, self._params, self._wires = source, params, wiring.outputs
        self._types = source.outputs(params)
        self._tally = tally
        self._published: Iterator[Timed | Finished | None] = iter(())
        self._next: Timed | Finished | None = None
        self.doing = "starting"  # last activity, in words

    @property
    def can_publish(self) -> bool:
        """Whether it may still publish a message."""
        return self._next is not _END

    def begin(self) -> Iterator[work.Outgoing | Finished]:
        """Open the source; messages of an earlier start are published again at once."""
        self._published = iter(self._source.open(self._params))
        messages = (item for item in self._published if isinstance(item, Timed))
        due = 0.0
        for published in islice(messages, self._tally.number if self._tally else 0):
            due = published.due
            yield self._pack(published)
        self.pace.start(due, time.monotonic())

    def wait(self) -> float | None:
        """Time until its next message [s]; None while it is paused, or at its end."""
        if self._next is None:
            self.doing = "reading the next message"
            began = time.perf_counter_ns()
            with self.steps(self._step):
                self._next = next(self._published, _END)
            if isinstance(self._next, Timed):
                self.latency.add(time.perf_counter_ns() - began)
        if self._next is None:
            return self._settings.poll_period
        if self._next is _END:
            return None
        due = self._next.due if isinstance(self._next, Timed) else 0.0
        return self.pace.wait(due, time.monotonic())

    def timeout_ms(self, idle_ms: int) -> int:
        """Time for which the sockets can be polled, at most `idle_ms` [ms]."""
        left = self.wait()
        if left is None:
            return idle_ms
        return min(idle_ms, int(1000.0 * max(0.0, left - self._settings.spin_time)))

    def publish_due(self) -> Iterator[work.Outgoing | Finished]:
        """Publish messages that are due now or within the spin time."""
        for _ in range(self._settings.max_batch):
            left = self.wait()
            if left is None or left > self._settings.spin_time or self._next is None:
                return
            _wait(left, self._settings.sleep_overshoot)
            yield self.publish_next()

    def publish_next(self) -> work.Outgoing | Finished:
        """Publish the next message at once."""
        published, self._next = self._next, None
        if isinstance(published, Finished):
            return published
        assert published is not None
        self.doing = f"publishing {published.topic}"
        self.pace.published(published.due, time.monotonic())
        packed = self._pack(published)
        if self._tally is not None:
            self._tally.increment()
        return packed

    def all(self) -> Iterator[work.Outgoing | Finished]:
        """Publish all messages, without waiting for their times."""
        while self.can_publish:
            self.wait()
            if self._next is not None and self._next is not _END:
                yield self.publish_next()

    def obey(self, word: ControlMessage) -> list[work.Outgoing | Finished]:
        """Carry out the request of a tool: pause, resume, step, or publish a message.

        Raises CodecError for a message of another type, which tool and launcher have refused
        before.
        """
        now = time.monotonic()
        match word["kind"]:
            case "pause":
                self.pace.pause(now)
            case "resume":
                self.pace.resume(now)
            case "step":
                self.pace.step(int(word["number"]))
            case "publish" if not self._source.repeats:
                local = next(name for name, wire in self._wires.items() if wire == word["topic"])
                decode(self._types[local], word["body"])
                return [self._pack(Timed(0.0, local, word["body"]))]
        if self._tally is not None:
            self._tally.set_paused(self.pace.paused)
        return []

    def take(self, arrival: Received) -> list[work.Outgoing | Finished]:
        """Raise ContractError: a source receives no messages."""
        raise work.ContractError(
            f"{self.name} subscribes to nothing, and has received {arrival.topic}"
        )

    def close(self) -> None:
        """Close the file that it reads."""
        getattr(self._published, "close", lambda: None)()

    def _pack(self, published: Timed) -> work.Outgoing:
        topic, body, robot_time = published.topic, published.message, 0.0
        kind = self._types.get(topic, object) if isinstance(body, bytes) else type(body)
        work.check_declared(self.name, self._types, topic, kind)
        if not isinstance(body, bytes):
            robot_time = float(getattr(body, "robot_time", 0.0))
            body = encode(body)
        return work.Outgoing(self._wires[topic], body, robot_time, codec_of(kind).hash)


Work = work.NodeWork | SourceWork | work.SinkWork


def _wait(seconds: float, sleep_overshoot: float) -> None:
    """Sleep, and busy-wait for the final part, since a sleep may be too long."""
    end = time.monotonic() + seconds
    if seconds > sleep_overshoot:
        time.sleep(seconds - sleep_overshoot)
    while time.monotonic() < end:
        pass


class RobotPace:
    """Delays messages until their robot time."""

    def __init__(self, rate: float) -> None:
        self.rate = rate  # robot time per wall time; 0: no delay
        self._began: float | None = None  # monotonic time at robot time 0 [s]

    def start(self, now: float) -> None:
        """Set robot time to 0 at the monotonic time `now` [s]."""
        self._began = now

    def wait(self, published: Iterable[object], now: float) -> float:
        """Time until the latest robot time of messages [s]; before `start` they are due now."""
        times = (item.robot_time for item in published if isinstance(item, work.Outgoing))
        due = max(times, default=0.0) / self.rate
        if self._began is None:
            self._began = now - due
        return max(0.0, self._began + due - now)


class PlaybackClock:
    """The clock of one source."""

    def __init__(self, *, paused: bool = False) -> None:
        self.paused = paused
        self._place = self._when = 0.0  # time of the source, and monotonic time then [s]
        self._steps = 0

    def start(self, place: float, now: float) -> None:
        """Begin at the time `place` of the source, at the monotonic time `now` [s]."""
        self._place, self._when = place, now

    def wait(self, due: float, now: float) -> float | None:
        """Time until a message that is due may be published [s]; None while it is paused before."""
        if due <= self._place or self._steps:
            return 0.0
        return None if self.paused else max(0.0, due - self._at(now))

    def published(self, due: float, now: float) -> None:
        """Take note that a message was published."""
        if self._steps and due > self._place:
            self._steps -= 1
            self.start(due, now)

    def pause(self, now: float) -> None:
        """Stop the clock."""
        self.start(self._at(now), now)
        self.paused = True

    def resume(self, now: float) -> None:
        """Continue from the current time."""
        self.start(self._at(now), now)
        self.paused, self._steps = False, 0

    def step(self, number: int) -> None:
        """Publish the next `number` messages at once, if it is paused."""
        if self.paused:
            self._steps += number

    def _at(self, now: float) -> float:
        return self._place if self.paused else self._place + now - self._when
