"""A machine on which nodes run, as the launcher of another one sees it."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping

from palpate.launch.processes.nursery import GRACE
from palpate.messages.bus.control import NodeLine
from palpate.messages.bus.wires import Wires
from palpate.messages.bus.words import OF_HOSTS, Word

PATIENCE = 10.0
"""A machine has this long for its first answer, s."""
BEAT, LOST = 0.5, 6.0
"""How often each side gives a sign of life, and after how long without one the other is lost, s."""


class Host:
    """The line to one machine that lends itself; nodes are born and die there.

    Parameters
    ----------
    wires : Wires
        Locked with the key.
    name : str
        Address and port, as the launch file has it.
    endpoint : str
        The same for a socket.
    run : str
        What the launcher is called there.
    """

    def __init__(self, wires: Wires, name: str, endpoint: str, run: str) -> None:
        self.name = name
        """Address and port."""
        self.line = NodeLine(wires.context, endpoint, name=run, hears=OF_HOSTS)
        """The line to it."""
        self._ends: dict[str, tuple[int, int]] = {}
        self._codes: dict[str, int] = {}
        self._heard = time.monotonic()
        self._next_beat = 0.0
        self._lost = False

    def hello(self, nodes: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str], int]:
        """Endpoints and taps of the nodes that will run there, and how far its clock is behind, ns.

        Parameters
        ----------
        nodes : mapping of str to str
            Their names and modules.

        Raises
        ------
        ValueError
            If it gives no answer.
        """
        asked = time.monotonic_ns()
        self.line.send("hello", names=list(nodes), modules=list(nodes.values()))
        if not self.line.socket.poll(int(1000 * PATIENCE)):
            raise ValueError(
                f"host {self.name} gives no answer: palpate host must run there, with the same key"
            )
        word = self.line.receive()
        heard = time.monotonic_ns()
        assert word is not None
        self._heard = time.monotonic()
        return word["endpoints"], word["taps"], (asked + heard) // 2 - word["ns"]

    def bear(self, name: str, wiring: bytes, place: bytes) -> int:
        """Have a node started; returns what wakes when it ends.

        Raises
        ------
        ChildProcessError
            If the machine is lost.
        """
        if self._lost:
            raise ChildProcessError(f"{name} cannot be started: host {self.name} is lost")
        self._close(name)
        self._ends[name] = os.pipe()
        self.line.send("bear", node=name, wiring=wiring, place=place)
        return self._ends[name][0]

    def exit_code(self, name: str) -> int:
        """Exit code of a node that has ended; negative for a signal."""
        return self._codes.get(name, 1)

    def kill(self, name: str) -> None:
        """Have a node killed at once."""
        self.line.send("kill", node=name)

    def hear(self, now: float) -> None:
        """Take in what the machine says, and give a sign of life."""
        while (word := self.line.receive()) is not None:
            self._heard = now
            self._take(word)
        if now >= self._next_beat:
            self._next_beat = now + BEAT
            self.line.send("alive")
        if now - self._heard > LOST and not self._lost:
            self._lost = True
            for name in self._ends:
                self._end(name, 1)

    def end(self) -> None:
        """Have all nodes there ended, and wait for that."""
        self.line.send("end")
        deadline = time.monotonic() + GRACE + 1.0
        while not self._lost and time.monotonic() < deadline:
            if self.line.socket.poll(50):
                word = self.line.receive()
                if word is not None and word["kind"] == "parted":
                    break
        for name in list(self._ends):
            self._close(name)
        self.line.close()

    def _take(self, word: Word) -> None:
        if word["kind"] == "ended":
            self._end(str(word["node"]), int(word["code"]))
        elif word["kind"] == "unborn":
            self._end(str(word["node"]), 1)
        elif word["kind"] == "parted":
            self._lost = True
            for name in self._ends:
                self._end(name, 1)

    def _end(self, name: str, code: int) -> None:
        self._codes[name] = code
        _, writing = self._ends.get(name, (-1, -1))
        if writing >= 0:
            os.close(writing)
            self._ends[name] = self._ends[name][0], -1

    def _close(self, name: str) -> None:
        for end in self._ends.pop(name, ()):
            if end >= 0:
                os.close(end)
