"""The messages of a topic as text, as they come, and how many of them did not come."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from palpate.launch.looking.field_path import FieldPath
from palpate.launch.looking.filtering import Wanted
from palpate.launch.looking.hearing import Heard, Hearing
from palpate.launch.looking.showing import Style, csv_line, yaml_lines, yaml_value
from palpate.launch.looking.topics import Topic, type_of
from palpate.launch.processes.register import Card
from palpate.messages.codec import codec_of, decode

TELL = 1.0
"""Losses are told at most this often, s."""
QUIET = 3.0
"""If nothing has come for so long, that is told, s."""

Echo = Callable[[str], None]


class Form(NamedTuple):
    """What is shown of each message, and how."""

    paths: tuple[FieldPath, ...] = ()
    """The values wanted; all fields if there is none."""
    style: Style = Style()
    csv: bool = False
    raw: bool = False
    """Whether bytes are shown as they came, unread."""
    wanted: Wanted | None = None
    """Which messages are shown; all of them if None."""


class Losses:
    """How many messages were sent and not heard.

    Parameters
    ----------
    topic : str
        Its name.
    tell : callable
        Takes a sentence.
    """

    def __init__(self, topic: str, tell: Echo) -> None:
        self._topic, self._tell = topic, tell
        self._lost = self._told = 0
        self._due = 0.0

    def add(self, lost: int, now: float) -> None:
        """So many are missing more; tells of it from time to time."""
        self._lost += lost
        if now >= self._due:
            self._due = now + TELL
            self.tell()

    def tell(self) -> None:
        """Tell of what has not been told of."""
        if self._lost > self._told:
            self._told = self._lost
            self._tell(f"{self._topic}: {self._lost} messages lost on the way here so far")


def echo_topic(
    card: Card,
    topic: Topic,
    form: Form,
    *,
    most: int | None,
    say: Echo,
    tell: Echo,
    losses: Losses,
) -> None:
    """Show the messages of a topic until the graph ends, or enough have been shown.

    Parameters
    ----------
    card, topic
        Whose, and what.
    form : Form
        How they are shown.
    most : int, optional
        How many.
    say : callable
        Takes a text for each message.
    tell : callable
        Is told what is odd.
    losses : Losses
        Counts what did not come.

    Raises
    ------
    ValueError
        If what comes is not what the topic carries, or cannot be compared as the filter asks.
    """
    with Hearing(card, [topic]) as hearing:
        shown = 0
        for heard in _each(hearing, topic, losses, tell):
            text = message_text(topic, heard, form)
            if text is None:
                continue
            say(text)
            shown += 1
            if shown == most:
                break
    losses.tell()


def message_text(topic: Topic, heard: Heard, form: Form) -> str | None:
    """A message as text; None if the filter does not want it."""
    if form.raw and form.wanted is None:
        return f"{heard.body!r}\n---"
    fields = fields_of(topic, heard)
    if form.wanted is not None and not form.wanted(fields):
        return None
    if form.raw:
        return f"{heard.body!r}\n---"
    if not form.paths:
        if form.csv:
            return csv_line(list(fields.values()), form.style)
        return "\n".join([*yaml_lines(fields, form.style), "---"])
    values = [_value(path, fields) for path in form.paths]
    if form.csv:
        return csv_line(values, form.style)
    shown = [yaml_value(value, form.style) for value in values]
    if len(shown) > 1:
        shown = [f"{p.text}: {text}" for p, text in zip(form.paths, shown, strict=True)]
    return "\n".join([*shown, "---"])


def fields_of(topic: Topic, heard: Heard) -> dict[str, Any]:
    """Name of each field of a message to its value.

    Raises
    ------
    ValueError
        If the message is not of the topic's type as it is known here.
    """
    cls = type_of(topic)
    codec = codec_of(cls)
    if heard.header.schema != codec.hash:
        raise ValueError(
            f"{topic.name} carries a {topic.type} with other fields than this palpate knows: "
            "the graph was started by another version"
        )
    return dict(zip(codec.names, codec.values(decode(cls, heard.body)), strict=True))


def _each(hearing: Hearing, topic: Topic, losses: Losses, tell: Echo) -> Iterator[Heard]:
    quiet: float | None = time.monotonic() + QUIET
    for batch in hearing.batches():
        for heard in batch:
            quiet = None
            losses.add(heard.lost, time.monotonic())
            yield heard
        if quiet is not None and time.monotonic() > quiet:
            quiet = None
            tell(f"nothing has come on {topic.name} yet; what was said before is not said again")


def _value(path: FieldPath, fields: dict[str, Any]) -> Any:
    try:
        return path.of(fields)
    except LookupError:
        return None
