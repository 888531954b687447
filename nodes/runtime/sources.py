"""A source in the course of its run: each message at its time, with pauses, or by steps."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from palpate.messages import codec_of, decode, encode
from palpate.messages.bus import ControlMessage, Received, SourceProgress
from palpate.nodes.runtime import work
from palpate.nodes.runtime.node import Finished, Source, Timed, Wiring

POLL_PERIOD = 0.01  # A source that has nothing to publish is asked again after this long, s
SPIN_TIME = 1.5e-3  # The last of a wait is not spent on the sockets, s: a poll is no more exact
SLEEP_OVERSHOOT = 3e-4  # A sleep may be late by so much, s
BATCH = 64  # Messages that are published before others are received again
_END: Any = object()


class SourceWork:
    """One source in the course of its run."""

    def __init__(
        self,
        source: Source,
        params: Any,  # Instance of the source's parameter type
        wiring: Wiring,
        # How much an earlier start of it has published, and will be counted; None counts for itself
        tally: SourceProgress | None = None,
    ) -> None:
        self.name = wiring.name
        self.latency = work.Latency()  # Time of making its messages
        self.steps, self._step = work.CpuSteps(), source.step  # Processor time of that
        self.consumed: dict[work.Edge, int] = {}
        self.waits: list[str] = []
        paused = source.paused(params) if tally is None or tally.paused is None else tally.paused
        self.pace = PlaybackClock(paused=paused)  # When it publishes what it has
        self._source, self._params, self._wires = source, params, wiring.outputs
        self._types = source.outputs(params)
        self._tally = tally
        self._published: Iterator[Timed | Finished | None] = iter(())
        self._next: Timed | Finished | None = None
        self.doing = "starting"  # What it was last busy with, in words

    @property
    def can_publish(self) -> bool:
        """Whether it may publish something yet."""
        return self._next is not _END

    def begin(self) -> Iterator[work.Outgoing | Finished]:
        """Open the source; what an earlier start of it had published is published at once."""
        self._published = iter(self._source.open(self._params))
        messages = (one for one in self._published if isinstance(one, Timed))
        due = 0.0
        for published in islice(messages, self._tally.number if self._tally else 0):
            due = published.due
            yield self._pack(published)
        self.pace.start(due, time.monotonic())

    def wait(self) -> float | None:
        """Time until it has something to publish, s; None while it is paused or at its end."""
        if self._next is None:
            self.doing = "looking for what comes next"
            began = time.perf_counter_ns()
            with self.steps(self._step):
                self._next = next(self._published, _END)
            if isinstance(self._next, Timed):
                self.latency.add(time.perf_counter_ns() - began)
        if self._next is None:
            return POLL_PERIOD
        if self._next is _END:
            return None
        due = self._next.due if isinstance(self._next, Timed) else 0.0
        return self.pace.wait(due, time.monotonic())

    def patience(self, idle_ms: int) -> int:
        """Time for which it has nothing to do, whole ms; the rest of it is spun away."""
        left = self.wait()
        return idle_ms if left is None else min(idle_ms, int(1000.0 * max(0.0, left - SPIN_TIME)))

    def publish_due(self) -> Iterator[work.Outgoing | Finished]:
        """Publish what is due, and what is due before anything else could be done."""
        for _ in range(BATCH):
            left = self.wait()
            if left is None or left > SPIN_TIME or self._next is None:
                return
            _wait(left)
            yield self.publish_next()

    def publish_next(self) -> work.Outgoing | Finished:
        """Publish what comes next, at once."""
        published, self._next = self._next, None
        if isinstance(published, Finished):
            return published
        assert published is not None
        self.doing = f"publishing {published.topic}"
        self.pace.gone(published.due, time.monotonic())
        packed = self._pack(published)
        if self._tally is not None:
            self._tally.increment()
        return packed

    def all(self) -> Iterator[work.Outgoing | Finished]:
        """All that it publishes, at once: nobody waits for the time of anything."""
        while self.can_publish:
            self.wait()
            if self._next is not None and self._next is not _END:
                yield self.publish_next()

    def obey(self, word: ControlMessage) -> list[work.Outgoing | Finished]:
        """Do what a tool asks for: pause, resume, step, or publish a message.

        A message that is not the topic's is refused by tool and launcher: here it is a fault.
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
                local = next(one for one, wire in self._wires.items() if wire == word["topic"])
                decode(self._types[local], word["body"])
                return [self._pack(Timed(0.0, local, word["body"]))]
        if self._tally is not None:
            self._tally.set_paused(self.pace.paused)
        return []

    def take(self, arrival: Received) -> list[work.Outgoing | Finished]:
        """Refuse what it never asked for. Raises ContractError always."""
        raise work.ContractError(
            f"{self.name} subscribes to nothing, and has received {arrival.topic}"
        )

    def close(self) -> None:
        """Let go of what it reads."""
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


def _wait(seconds: float) -> None:
    """Sleep, but not to the end: a sleep is late, spinning is not."""
    end = time.monotonic() + seconds
    if seconds > SLEEP_OVERSHOOT:
        time.sleep(seconds - SLEEP_OVERSHOOT)
    while time.monotonic() < end:
        pass


class RobotPace:
    """Says how long what a robot has done is held back, so that it is published at its time."""

    def __init__(self, rate: float) -> None:
        self.rate = rate  # Robot time that passes in a second; 0: as fast as can be
        self._began: float | None = None  # Monotonic time at which robot time was 0

    def start(self, now: float) -> None:
        """Robot time begins now, a monotonic time, s."""
        self._began = now

    def wait(self, published: Iterable[object], now: float) -> float:
        """Time until the latest of these, s; where nobody has said when it began, it is due now."""
        times = (one.robot_time for one in published if isinstance(one, work.Outgoing))
        due = max(times, default=0.0) / self.rate
        if self._began is None:
            self._began = now - due
        return max(0.0, self._began + due - now)


class PlaybackClock:
    """The clock of one source."""

    def __init__(self, *, paused: bool = False) -> None:
        self.paused = paused  # Whether it stands still
        self._place = self._when = 0.0
        self._steps = 0

    def start(self, place: float, now: float) -> None:
        """Begin at a time of the source, s, at a monotonic time, s."""
        self._place, self._when = place, now

    def wait(self, due: float, now: float) -> float | None:
        """Time until what is due may be published, s; None while it stands still before that."""
        if due <= self._place or self._steps:
            return 0.0
        return None if self.paused else max(0.0, due - self._at(now))

    def gone(self, due: float, now: float) -> None:
        """What was due has been published."""
        if self._steps and due > self._place:
            self._steps -= 1
            self.start(due, now)

    def pause(self, now: float) -> None:
        """Stand still."""
        self.start(self._at(now), now)
        self.paused = True

    def resume(self, now: float) -> None:
        """Go on from where it stands."""
        self.start(self._at(now), now)
        self.paused, self._steps = False, 0

    def step(self, number: int) -> None:
        """Publish the next so many at once, if it stands still."""
        if self.paused:
            self._steps += number

    def _at(self, now: float) -> float:
        return self._place if self.paused else self._place + now - self._when
