"""Topics measured once a second, until the graph ends or the user has seen enough."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from palpate.launch.looking.hearing import Hearing
from palpate.launch.looking.rate_text import Say
from palpate.launch.looking.rates import Rates
from palpate.launch.looking.topics import Topic
from palpate.launch.processes.register import Card

EVERY = 1.0
"""Figures are printed this often, s."""


class Gauge:
    """Figures of some topics, each publisher by itself.

    Parameters
    ----------
    topics : sequence of Topic
        What is measured.
    window : int
        Messages over which a figure is taken.
    say : callable
        Figures of one publisher to lines.
    echo : callable
        Takes some lines.
    """

    def __init__(
        self, topics: Sequence[Topic], window: int, say: Say, echo: Callable[[str], None]
    ) -> None:
        self._say, self._echo = say, echo
        self._rates = {(one.name, node): Rates(window) for one in topics for node in one.publishers}
        self._several = len(topics) > 1
        self._crowds = {one.name for one in topics if len(one.publishers) > 1}
        self._said: dict[tuple[str, str], int] = {}

    def run(self, card: Card, topics: Sequence[Topic], duration: float | None) -> None:
        """Measure until the graph ends, the time is over, or Ctrl-C."""
        with Hearing(card, topics) as hearing:
            due = time.monotonic() + EVERY
            for batch in hearing.batches(duration):
                for heard in batch:
                    self._rates[heard.topic, heard.publisher].add(heard)
                if time.monotonic() >= due:
                    due += EVERY
                    self.print(last=False)
        self.print(last=True)

    def print(self, *, last: bool) -> None:
        """Say what is new, and of what nothing comes; at the last only what was not said."""
        for (topic, node), rates in self._rates.items():
            news = rates.last != self._said.get((topic, node))
            label = f"{topic} of {node}" if topic in self._crowds else topic
            text = self._say(rates) if news else None
            self._said[topic, node] = rates.last
            if text is not None:
                self._echo(f"{label}\n{text}" if self._several or self._crowds else text)
            elif not rates.heard and (news or not last):
                self._echo(f"no messages on {label}")
            elif news:
                self._echo(f"only one message on {label}")
            elif not last:
                self._echo(f"no new messages on {label}")
