"""A source in the course of its run: what it says, each at its time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import islice
from typing import Any

from palpate.messages.bus.journal import Tally
from palpate.messages.bus.subscriber import Arrival
from palpate.messages.bus.words import Word
from palpate.messages.codec import codec_of, decode, encode
from palpate.nodes.node import Finished, Said, Source
from palpate.nodes.runtime_latency import Latency
from palpate.nodes.runtime_pace import Pace
from palpate.nodes.runtime_work import ContractError, Edge, Parcel
from palpate.nodes.wiring import Wiring

SOON = 0.01
"""A source that has nothing to say is asked again after this long, s."""
SPIN = 1.5e-3
"""The last of a wait is not spent on the sockets, s: a poll is no more exact than that."""
LATE = 3e-4
"""A sleep may be late by so much, s."""
BATCH = 64
"""Messages that are said before others are heard again."""


class SourceWork:
    """One source in the course of its run.

    Parameters
    ----------
    source : Source
        What it does.
    params : object
        Instance of the source's parameter type.
    wiring : Wiring
        Its place in the graph.
    tally : Tally, optional
        How much an earlier start of it has said, and will be counted; None counts for itself.
    """

    def __init__(
        self, source: Source, params: Any, wiring: Wiring, tally: Tally | None = None
    ) -> None:
        self.name = wiring.name
        self.latency = Latency()
        """Time of making its messages."""
        self.consumed: dict[Edge, int] = {}
        self.waits: list[str] = []
        paused = source.paused(params) if tally is None or tally.paused is None else tally.paused
        self.pace = Pace(paused=paused)
        """When it says what it has to say."""
        self._source, self._params, self._wires = source, params, wiring.outputs
        self._types = source.outputs(params)
        self._tally = tally
        self._said: Iterator[Said | Finished | None] = iter(())
        self._next: Said | Finished | None = None
        self._doing = "starting"

    @property
    def doing(self) -> str:
        """What it was last busy with, in words."""
        return self._doing

    @property
    def speaks(self) -> bool:
        """Whether it may say something yet."""
        return self._next is not _END

    def begin(self) -> Iterator[Parcel | Finished]:
        """Open the source; what an earlier start of it had said is said at once."""
        self._said = iter(self._source.open(self._params))
        words = (one for one in self._said if isinstance(one, Said))
        due = 0.0
        for said in islice(words, self._tally.number if self._tally else 0):
            due = said.due
            yield self._pack(said)
        self.pace.start(due, time.monotonic())

    def wait(self) -> float | None:
        """Time until it has something to say, s; None while it stands still or is at its end."""
        if self._next is None:
            self._doing = "looking for what comes next"
            began = time.perf_counter_ns()
            self._next = next(self._said, _END)
            if isinstance(self._next, Said):
                self.latency.add(time.perf_counter_ns() - began)
        if self._next is None:
            return SOON
        if self._next is _END:
            return None
        return self.pace.wait(_due(self._next), time.monotonic())

    def patience(self, idle_ms: int) -> int:
        """Time for which it has nothing to do, whole ms; the rest of it is spun away."""
        left = self.wait()
        return idle_ms if left is None else min(idle_ms, int(1000.0 * max(0.0, left - SPIN)))

    def say_due(self) -> Iterator[Parcel | Finished]:
        """Say what is due, and what is due before anything else could be done."""
        for _ in range(BATCH):
            left = self.wait()
            if left is None or left > SPIN or self._next is None:
                return
            _wait(left)
            yield self.say()

    def say(self) -> Parcel | Finished:
        """Say what comes next, at once."""
        said, self._next = self._next, None
        if isinstance(said, Finished):
            return said
        assert said is not None
        self._doing = f"saying {said.topic}"
        self.pace.gone(said.due, time.monotonic())
        packed = self._pack(said)
        if self._tally is not None:
            self._tally.up()
        return packed

    def all(self) -> Iterator[Parcel | Finished]:
        """All that it says, at once: nobody waits for the time of anything."""
        while self.speaks:
            self.wait()
            if self._next is not None and self._next is not _END:
                yield self.say()

    def obey(self, word: Word) -> list[Parcel | Finished]:
        """Do what a tool asks for: pause, resume, step, or publish a message.

        A message that is not the topic's is refused by the tool and the launcher: here it is a
        fault.
        """
        now = time.monotonic()
        match word["kind"]:
            case "pause":
                self.pace.pause(now)
            case "resume":
                self.pace.resume(now)
            case "step":
                self.pace.step(int(word["number"]))
            case "publish" if self._source.outside:
                local = next(one for one, wire in self._wires.items() if wire == word["topic"])
                decode(self._types[local], word["body"])
                return [self._pack(Said(0.0, local, word["body"]))]
        if self._tally is not None:
            self._tally.stand(self.pace.paused)
        return []

    def take(self, arrival: Arrival) -> list[Parcel | Finished]:
        """Refuse what it never asked for.

        Raises
        ------
        ContractError
            Always.
        """
        raise ContractError(f"{self.name} hears nothing, and has heard {arrival.topic}")

    def close(self) -> None:
        """Let go of what it reads."""
        close = getattr(self._said, "close", None)
        if close is not None:
            close()

    def _pack(self, said: Said) -> Parcel:
        cls = self._types.get(said.topic)
        if cls is None:
            known = ", ".join(self._types) or "nothing"
            raise ContractError(
                f"{self.name} published {said.topic}, which it does not declare; "
                f"it declares {known}"
            )
        body, robot_time = said.message, 0.0
        if not isinstance(body, bytes):
            if type(body) is not cls:
                raise ContractError(
                    f"{self.name} published a {type(body).__name__} on {said.topic}, "
                    f"declared as {cls.__name__}"
                )
            robot_time = float(getattr(body, "robot_time", 0.0))
            body = encode(body)
        return Parcel(self._wires[said.topic], body, robot_time, codec_of(cls).hash)


def _wait(seconds: float) -> None:
    """Sleep, but not to the end: a sleep is late, spinning is not."""
    end = time.monotonic() + seconds
    if seconds > LATE:
        time.sleep(seconds - LATE)
    while time.monotonic() < end:
        pass


def _due(said: Said | Finished) -> float:
    return said.due if isinstance(said, Said) else 0.0


_END: Any = object()
