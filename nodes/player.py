"""Player node: publishes again what a recording holds, each message when its time has come."""

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
LOOP_PAUSE = 1.0  # Pause before a recording begins anew, s of the recording


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    path: str  # The recording
    topics: tuple[str, ...] = ()  # Topics to play; all of them if there are none
    # Seconds of the recording that pass in a second.
    rate: Annotated[float, Meta(gt=0, le=1e6)] = 1.0
    loop: bool = False  # Whether it begins anew at its end
    # Begins so many s after the recording's first message; latched messages from before that are
    # published first.
    start_offset: Annotated[float, Meta(ge=0, description="s")] = 0.0
    # Ends so many s after the recording's first message.
    until: Annotated[float, Meta(gt=0, description="s")] | None = None
    # Publishes the recording's time on ``/clock`` so often in a second; 0 never does.
    clock: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    paused: bool = False  # Whether it waits at its beginning to be told to go on

    def __post_init__(self) -> None:
        if self.until is not None and self.until <= self.start_offset:
            raise ValueError(
                f"until must be later than start_offset {self.start_offset:g} s, got {self.until:g}"
            )


def outputs(params: Params) -> Mapping[str, type]:
    """Topics of the recording that are played, and their types.

    ValueError if it cannot be read, has no such topic, or types of another version.
    """
    recording = open_recording(Path(params.path))
    for topic in params.topics:
        if topic not in recording.counts:
            known = ", ".join(sorted(recording.counts)) or "none"
            raise ValueError(f"recording {params.path} has no topic {topic!r}; it has {known}")
    published = {topic: recording.type_of(topic) for topic in sorted(_played(params, recording))}
    return {**published, CLOCK_TOPIC: Clock} if params.clock else published


def play(params: Params) -> Iterator[Timed | Finished]:
    """Publish what the recording holds: what was latched before the beginning, then the rest."""
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
        begun = end + LOOP_PAUSE / params.rate


def _played(params: Params, recording: Recording) -> frozenset[str]:
    wanted = frozenset(params.topics or recording.counts)
    return wanted - {CLOCK_TOPIC} if params.clock else wanted


def _turn(params: Params, recording: Recording, played: frozenset[str]) -> Iterator[Timed]:
    """The recording once; due counts from its beginning, in s of the recording."""
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
            if cls in LATCHED:  # the last of its topic counts, or all of them
                before[kept.topic, kept.seq if cls in ALL_KEPT else 0] = kept.body
            continue
        yield from _latched(before)
        before = None
        yield Timed(time - params.start_offset, kept.topic, kept.body)
    yield from _latched(before)


def _latched(before: dict[tuple[str, int], bytes] | None) -> Iterator[Timed]:
    return (Timed(0.0, topic, body) for (topic, _), body in (before or {}).items())


def _with_clock(turn: Iterator[Timed], params: Params) -> Iterator[Timed]:
    """Ticks of the clock between the messages; it ticks in the player's own time."""
    tick, every = 0, params.rate / params.clock if params.clock else 0.0
    for published in turn:
        while every and tick * every <= published.due:
            yield Timed(tick * every, CLOCK_TOPIC, Clock(time=params.start_offset + tick * every))
            tick += 1
        yield published


SOURCE = Source(params=Params, outputs=outputs, open=play, paused=lambda params: params.paused)
