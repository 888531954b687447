"""Which faults a run meets, when and where: all of it follows from one number."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import cycle, islice, product
from typing import NamedTuple

ONE, SEVERAL, ENDING = ("kill", "stop", "recorder", "full"), ("neighbours",), ("ctrl_c", "launcher")
BESIDE = ("flood", "late")
KINDS = (*ONE, *SEVERAL, *BESIDE, *ENDING)
"""kill: kill -9 of a node; stop: SIGSTOP; recorder: kill -9 of it; full: no more room for its file;
neighbours: kill -9 of two nodes of which one hears the other; flood: a source of 100,000 messages
beside the others; late: a tool that joins late and is stopped; ctrl_c: SIGINT to all processes;
launcher: kill -9 of it."""
PHASES = ("start", "grasp", "tracing", "models", "end")
RECORDER = "recorder"
MOST = 3
"""Faults that one node meets in a run: more within 10 s would be a storm, which ends it."""
_MARKS = {
    "grasp": ("/hand/goal",),
    "tracing": ("/finger/goal",),
    "models": ("/model/goal", "/contour/traced"),
    "end": ("/plan/done", "/contour/traced"),
}
"""What is said in each phase; the second where a graph says nothing of the first."""
_LONGEST = {"start": 0.5, "grasp": 0.1, "tracing": 0.02, "models": 0.5, "end": 1.0}
"""A fault follows what was said by at most so many s."""


class Moment(NamedTuple):
    """When a fault is put in."""

    phase: str
    """One of `PHASES`."""
    topic: str
    """Topic by which the moment is known; empty for the launch itself."""
    seq: int
    """The message of that topic with which it comes."""
    delay: float
    """Time after it, s."""


class Fault(NamedTuple):
    """One fault."""

    kind: str
    """One of `KINDS`."""
    whom: tuple[str, ...]
    """The nodes that it hits; none for one that hits the launcher, or nobody."""
    moment: Moment

    def __str__(self) -> str:
        when = f"{self.moment.topic} {self.moment.seq}" if self.moment.topic else "the launch"
        whom = f" {' and '.join(self.whom)}" if self.whom else ""
        return f"{self.kind}{whom} {self.moment.delay:.3f} s after {when}"


class Known(NamedTuple):
    """What an undisturbed run has shown of a graph."""

    nodes: tuple[str, ...]
    """Names of its nodes."""
    pairs: tuple[tuple[str, str], ...]
    """Nodes of which one hears the other."""
    counts: Mapping[str, int]
    """Messages by topic."""


def draw(seed: int, known: Known, kinds: Sequence[str], number: int) -> tuple[Fault, ...]:
    """Faults of one run, in no order.

    Runs with seeds that follow each other go through every node in every phase.

    Parameters
    ----------
    seed : int
        From which all follows.
    known : Known
        The graph.
    kinds : sequence of str
        Of `KINDS`, which may be drawn.
    number : int
        How many; a run that a fault is to end meets that one alone.
    """
    rng = random.Random(f"palpate chaos {seed}")
    ending = [kind for kind in kinds if kind in ENDING]
    lasting = [kind for kind in kinds if kind not in ENDING]
    if ending and (not lasting or seed % len(kinds) < len(ending)):
        kind = ending[seed % len(ending)]
        phase = PHASES[seed // len(ending) % len(PHASES)]
        return (Fault(kind, (), _moment(rng, phase, known)),)
    places = list(product(known.nodes, PHASES))
    random.Random(0).shuffle(places)
    faults: list[Fault] = []
    hit: Counter[str] = Counter()
    first = seed * number
    for place, kind in enumerate(islice(cycle(lasting), first % len(lasting), None)):
        if len(faults) == number or place > 10 * number:
            break
        name, phase = places[(first + place) % len(places)]
        whom = _whom(rng, kind, name, known)
        if kind == "flood" and any(one.kind == kind for one in faults):
            continue
        if any(hit[one] == MOST for one in whom):
            continue
        hit.update(whom)
        faults.append(Fault(kind, whom, _moment(rng, phase, known)))
    return tuple(faults)


def _whom(rng: random.Random, kind: str, name: str, known: Known) -> tuple[str, ...]:
    if kind in ("recorder", "full"):
        return (RECORDER,)
    if kind == "neighbours":
        return rng.choice([pair for pair in known.pairs if name in pair] or known.pairs)
    return () if kind in BESIDE else (name,)


def _moment(rng: random.Random, phase: str, known: Known) -> Moment:
    delay = rng.uniform(0.0, _LONGEST[phase])
    for mark in _MARKS.get(phase, ()):
        topics = sorted(topic for topic in known.counts if topic.endswith(mark))
        if topics:
            topic = rng.choice(topics)
            last = known.counts[topic] - 1
            return Moment(phase, topic, last if phase == "end" else rng.randint(0, last), delay)
    return Moment(phase, "", 0, delay)
