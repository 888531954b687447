"""Effects and their causes: no message may answer one that is not there, or is later."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgpack

from palpate.launch.chaos.history import Breach, Event, History


class Answer(NamedTuple):
    """A topic whose messages answer others."""

    fields: tuple[str, ...]
    """What names the message that is answered."""
    causes: tuple[str, ...]
    """Topics on which that may have been said."""
    named: tuple[str, ...]
    """The same fields, as the causes call them."""


_TOUCH = ("goal", "touch")
ANSWERS = {
    "/touch/raw": Answer(_TOUCH, ("/finger/goal",), _TOUCH),
    "/touch/image": Answer(_TOUCH, ("/touch/raw",), _TOUCH),
    "/touch/patch": Answer(_TOUCH, ("/touch/image",), _TOUCH),
    "/finger/goal": Answer(("goal",), ("/contour/goal", "/probe/goal"), ("id",)),
    "/contour/traced": Answer(("id",), ("/contour/goal",), ("id",)),
    "/probe/traced": Answer(("id",), ("/probe/goal",), ("id",)),
    "/hand/contacts": Answer(("number",), ("/hand/goal",), ("number",)),
    "/model/coarse": Answer(("number",), ("/model/goal",), ("number",)),
    "/model/shape": Answer(("number",), ("/model/goal", "/plan/done"), ("number",)),
    "/score": Answer(("number",), ("/model/shape",), ("number",)),
}
"""Topics without the namespace of a finger."""
_SHARED = ("/contour/goal", "/probe/goal")
"""Said by one for all fingers: their namespaces do not count."""

Key = tuple[str, tuple[str, ...], tuple[int, ...]]


def uncaused(history: History, *, whole: bool) -> Iterator[Breach]:
    """Messages that answer what was not said, or not yet.

    Parameters
    ----------
    history : History
        What was recorded.
    whole : bool
        Whether it has an end; if not, a cause may just have had no time to be recorded.
    """
    first = _first_said(history)
    for event in history.events:
        space, topic = _split(event.topic)
        answer = ANSWERS.get(topic)
        if answer is None:
            continue
        values = _values(event, answer.fields)
        keys = [(_join(space, cause), answer.named, values) for cause in answer.causes]
        times = [first[key] for key in keys if key in first]
        if not times and whole:
            what = ", ".join(f"{n} {v}" for n, v in zip(answer.fields, values, strict=True))
            yield Breach("cause", f"{event.topic} {event.seq} answers {what}, which nobody said")
        elif times and min(times) >= event.sent_ns:
            text = f"{event.topic} {event.seq} was sent before what it answers"
            yield Breach("cause", text)


def _first_said(history: History) -> dict[Key, int]:
    """Time at which each message that may be answered was first sent, ns."""
    wanted: dict[str, set[tuple[str, ...]]] = {}
    for answer in ANSWERS.values():
        for cause in answer.causes:
            wanted.setdefault(cause, set()).add(answer.named)
    first: dict[Key, int] = {}
    for event in history.events:
        for named in wanted.get(_split(event.topic)[1], ()):
            key = event.topic, named, _values(event, named)
            first[key] = min(first.get(key, event.sent_ns), event.sent_ns)
    return first


def _split(topic: str) -> tuple[str, str]:
    """Namespace of a finger, maybe empty, and the rest of a topic."""
    head, _, rest = topic[1:].partition("/")
    return (f"/{head}", f"/{rest}") if head.startswith("finger_") else ("", topic)


def _join(space: str, cause: str) -> str:
    shared = cause in _SHARED or cause.startswith(("/model", "/plan", "/hand"))
    return cause if shared else space + cause


def _values(event: Event, fields: tuple[str, ...]) -> tuple[int, ...]:
    body: Any = msgpack.unpackb(event.body)
    return tuple(body.get(field, -1) for field in fields)
