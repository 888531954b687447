"""Plays a recording in a graph of its own, which tools hear as they hear any other."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.bag.bag_file import find_bag
from palpate.launch.bag.keys import RIGHT, SPACE, Keys
from palpate.launch.entry import Entry
from palpate.launch.graph import Graph
from palpate.launch.launcher import launch
from palpate.launch.located import InputError
from palpate.launch.looking.ask import tell
from palpate.launch.processes.register import running
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.wiring import Wiring

NAME = "player"
DONE, DIED, INTERRUPTED = 0, 3, 130


def read_remap(pairs: Sequence[str]) -> dict[str, str]:
    """Old topics to new ones, from texts like ``/a:=/b``.

    Raises
    ------
    InputError
        If a text is no such pair.
    """
    remap = {}
    for pair in pairs:
        old, sign, new = pair.partition(":=")
        if not (old and sign and new):
            raise InputError(f"--remap {pair}: must look like /touch/raw:=/touch/again")
        remap[old] = new
    return remap


def player_entry(bag: Path, params: Mapping[str, Any], remap: Mapping[str, str]) -> Entry:
    """The player of a recording, given as a file or as the run directory that holds it."""
    return Entry(name=NAME, params={"path": str(find_bag(bag)), **params}, remap=remap)


def play(entry: Entry, *, quiet: bool) -> int:
    """Play until the end of the recording, or Ctrl-C; returns the exit code.

    Raises
    ------
    InputError
        If the recording cannot be played; nothing has been started.
    """
    wirings = Graph((entry,), ends=NAME).wirings()
    with Keys() as keys:
        watcher = Progress(wirings[0], quiet=quiet, keys=keys)
        try:
            ending = launch(
                wirings, ends=NAME, hear=(), watcher=watcher, name=Path(entry.params["path"]).stem
            )
        except ValueError as error:
            raise InputError(str(error)) from None
    if ending.status == "interrupted":
        watcher.say(f"stopped after {watcher.sent} messages")
        return INTERRUPTED
    watcher.say(ending.reason)
    return DONE if ending.status == "finished" else DIED


class Progress:
    """Says what a player does.

    Parameters
    ----------
    wiring : Wiring
        The player's.
    quiet : bool
        Whether it says nothing.
    keys : Keys
        Told that the graph is up, and that it goes on.
    """

    def __init__(self, wiring: Wiring, *, quiet: bool, keys: Keys) -> None:
        self.sent = 0
        """Messages that the player has said."""
        self._wiring, self._quiet, self._keys = wiring, quiet, keys
        self._paused: bool = wiring.params.paused

    def ready(self, seconds: float) -> None:
        """Say what is played."""
        number, params = len(self._wiring.outputs), self._wiring.params
        how = ", paused" if params.paused else ""
        self.say(f"playing {params.path}: {number} topics, {params.rate:g} x{how}")

    def heard(self, topic: str, message: object) -> None:
        """Nothing is asked for."""

    def log(self, record: LogRecord) -> None:
        """Show what went wrong."""
        if record.level in ("warning", "error"):
            self.say(record.text)

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Count, and see to the keyboard."""
        if NAME in statuses:
            self.sent = statuses[NAME].sent
        for key in self._keys.pressed():
            self._press(key)

    def _press(self, key: bytes) -> None:
        own = [card for card in running() if card.pid == os.getpid()]
        if own and key == RIGHT:
            tell(own[-1], "step", node=NAME, number=1)
        elif own and key == SPACE:
            self._paused = not self._paused
            tell(own[-1], "pause" if self._paused else "resume", node=NAME)
            self.say("paused" if self._paused else "goes on")

    def say(self, text: str) -> None:
        """Print a line, unless quiet."""
        if not self._quiet:
            print(text, flush=True)
