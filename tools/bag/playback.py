"""Plays a recording in a new graph; keys pause and step it."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import tty
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from palpate.launch.files.file_access import plain_name
from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.graph import Graph
from palpate.launch.launcher import launch
from palpate.launch.node_kinds import Entry
from palpate.launch.processes.registry import running_graphs
from palpate.launch.run_directory import find_bag
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.runtime.composed import Watcher
from palpate.nodes.runtime.node import Wiring
from palpate.tools.introspection.requests import notify

PLAYER_NAME = "player"
DONE, DIED, INTERRUPTED = 0, 3, 130  # exit codes
SPACE, RIGHT = b" ", b"\x1b[C"
_KEY = re.compile(rb"\x1b\[[A-D]|[^\x1b]", re.DOTALL)


def read_remap(pairs: Sequence[str]) -> dict[str, str]:
    """New names of topics by old ones, from ``/a:=/b``; raises InputError for another form."""
    remap = {}
    for pair in pairs:
        old, sign, new = pair.partition(":=")
        if not (old and sign and new):
            raise InputError(f"--remap {pair}: must look like /touch/raw:=/touch/again")
        remap[old] = new
    return remap


def player_entry(bag: Path, params: Mapping[str, Any], remap: Mapping[str, str]) -> Entry:
    """The player of a recording, which is a file or in a run directory."""
    return Entry(name=PLAYER_NAME, params={"path": str(find_bag(bag)), **params}, remap=remap)


def play_recording(entry: Entry, *, quiet: bool) -> int:
    """Play until the end of the recording, or Ctrl-C; returns the exit code.

    Raises InputError if it cannot be played; nothing has been started.
    """
    wirings = Graph((entry,), ends=PLAYER_NAME).wirings()
    with Keyboard() as keys:
        watcher = PlaybackWatcher(wirings[0], quiet=quiet, keys=keys)
        name = plain_name(Path(entry.params["path"]).stem)
        with as_input_errors():
            ending = launch(wirings, ends=PLAYER_NAME, watch=(), watcher=watcher, name=name)
    if ending.status == "interrupted":
        watcher.say(f"stopped after {watcher.sent} messages")
        return INTERRUPTED
    watcher.say(ending.reason)
    return DONE if ending.status == "finished" else DIED


class PlaybackWatcher(Watcher):
    """Prints what a player does."""

    def __init__(self, wiring: Wiring, *, quiet: bool, keys: Keyboard) -> None:
        self.sent = 0  # messages that the player has published
        self._wiring, self._quiet, self._keys = wiring, quiet, keys
        self._paused: bool = wiring.params.paused

    def ready(self, seconds: float) -> None:
        """Print what is played."""
        number, params = len(self._wiring.outputs), self._wiring.params
        how = ", paused" if params.paused else ""
        self.say(f"playing {params.path}: {number} topics, {params.rate:g} x{how}")

    def log(self, record: LogRecord) -> None:
        """Print warnings and errors."""
        if record.level in ("warning", "error"):
            self.say(record.text)

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Count messages, and act on keys."""
        if PLAYER_NAME in statuses:
            self.sent = statuses[PLAYER_NAME].sent
        for key in self._keys.pressed():
            self._press(key)

    def _press(self, key: bytes) -> None:
        own = [card for card in running_graphs() if card.pid == os.getpid()]
        if own and key == RIGHT:
            notify(own[-1], "step", node=PLAYER_NAME, number=1)
        elif own and key == SPACE:
            self._paused = not self._paused
            notify(own[-1], "pause" if self._paused else "resume", node=PLAYER_NAME)
            self.say("paused" if self._paused else "resumed")

    def say(self, text: str) -> None:
        """Print a line, unless quiet."""
        if not self._quiet:
            print(text, flush=True)


class Keyboard:
    """Reads single keys during its ``with`` block; does nothing without a terminal."""

    def __init__(self) -> None:
        self._before: list[Any] | None = None

    def __enter__(self) -> Keyboard:
        with suppress(termios.error, OSError, ValueError):
            file = sys.stdin.fileno()
            # A background process would be stopped if it changed the terminal.
            if sys.stdin.isatty() and os.tcgetpgrp(file) == os.getpgrp():
                self._before = termios.tcgetattr(sys.stdin)
                tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def pressed(self) -> list[bytes]:
        """Keys that were pressed since the last call."""
        keys: list[bytes] = []
        while self._before is not None and select.select([sys.stdin], [], [], 0.0)[0]:
            data = os.read(sys.stdin.fileno(), 64)
            if not data:
                break
            keys += _KEY.findall(data)
        return keys
