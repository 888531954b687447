"""Player node: publishes the messages of a recording at their times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from palpate.messages.recording import Recording, open_recording
from palpate.messages.types import ALL_KEPT, LATCHED, TYPES, Clock
from palpate.nodes.runtime.node import Finished, Source, Timed

CLOCK_TOPIC = "/clock"


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    path: str  # of the recording
    topics: tuple[str, ...] = ()  # to play; empty: all
    # Time of the recording per wall time; larger plays faster.
    rate: Annotated[float, Meta(gt=0, le=1e6)] = 1.0
    loop: bool = False  # whether it is played again at its end
    # Start time after the first message [s]; earlier latched messages are published first.
    start_offset: Annotated[float, Meta(ge=0, description="s")] = 0.0
    # End time after the first message [s]; null: the end of the recording.
    until: Annotated[float, Meta(gt=0, description="s")] | None = None
    # Rate of messages with the recording's time on ``/clock`` [Hz]; 0: none.
    clock: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    paused: bool = False  # whether it is paused at the beginning

    def __post_init__(self) -> None:
        if self.until is not None and self.until <= self.start_offset:
            raise ValueError(
                f"until must be later than start_offset {self.start_offset:g} s, got {self.until:g}"
            )


def outputs(params: Params) -> Mapping[str, type]:
    """Types of the played messages by topic.

    Raises ValueError if it cannot be read, has no such topic, or types of another version.
    """
    recording = open_recording(Path(params.path))
    for topic in params.topics:
        if topic not in recording.counts:
            known = ", ".join(sorted(recording.counts)) or "none"
            raise ValueError(f"recording {params.path} has no topic {topic!r}; it has {known}")
    published = {topic: recording.type_of(topic) for topic in sorted(_played(params, recording))}
    return {**published, CLOCK_TOPIC: Clock} if params.clock else published


def play(params: Params, loop_pause: float = 1.0) -> Iterator[Timed | Finished]:
    """Publish latched messages from before the start, then the messages of the recording.

    Between two loops there is a pause of `loop_pause`, in time of the recording [s].
    """
    recording = open_recording(Path(params.path))
    played = _played(params, recording)
    number, begun = 0, 0.0
    for turn in count():
        end = begun
        for published in _with_clock(_turn(params, recording, played), params):
            end = begun + published.due / params.rate
            number += published.topic != CLOCK_TOPIC
            yield published._replace(due=end)
        if not params.loop or number == 0:
            yield Finished(f"played {number} messages" + (f" in {turn + 1} turns" if turn else ""))
            return
        begun = end + loop_pause / params.rate


def _played(params: Params, recording: Recording) -> frozenset[str]:
    wanted = frozenset(params.topics or recording.counts)
    return wanted - {CLOCK_TOPIC} if params.clock else wanted


def _turn(params: Params, recording: Recording, played: frozenset[str]) -> Iterator[Timed]:
    """The recording once; times are from its start, in time of the recording [s]."""
    before: dict[tuple[str, int], bytes] | None = {}
    first = latest = 0
    for kept in recording.messages():
        first = first or kept.sent_ns
        latest = max(latest, kept.sent_ns)
        time = 1e-9 * (latest - first)
        if params.until is not None and time > params.until:
            break
        if kept.topic not in played:
            continue
        if time < params.start_offset and before is not None:
            cls = TYPES.get(kept.type)
            if cls in LATCHED:  # the last message of its topic, or all
                before[kept.topic, kept.seq if cls in ALL_KEPT else 0] = kept.body
            continue
        yield from _latched(before)
        before = None
        yield Timed(time - params.start_offset, kept.topic, kept.body)
    yield from _latched(before)


def _latched(before: dict[tuple[str, int], bytes] | None) -> Iterator[Timed]:
    return (Timed(0.0, topic, body) for (topic, _), body in (before or {}).items())


def _with_clock(turn: Iterator[Timed], params: Params) -> Iterator[Timed]:
    """The messages, with those of the clock between them at the times of the player."""
    tick, period = 0, params.rate / params.clock if params.clock else 0.0
    for published in turn:
        while period and tick * period <= published.due:
            yield Timed(tick * period, CLOCK_TOPIC, Clock(time=params.start_offset + tick * period))
            tick += 1
        yield published


SOURCE = Source(params=Params, outputs=outputs, open=play, paused=lambda params: params.paused)
