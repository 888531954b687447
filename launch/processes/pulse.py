"""Which nodes hang: they give no sign of life, and neither wait for the processor nor work.

A node gives its signs from its own loop, so that a handler that never ends is seen. How long one
may take is its own word, and counted in processor time: a busy machine makes nobody hang.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

SILENT = 1.2
"""Signs of life come four times a second; after so long without one a node is looked at, s."""
GAP = 0.5
"""If the launcher itself had not run for so long, nobody is blamed for his silence, s."""


class Busy(NamedTuple):
    """What a process does, as the system has it."""

    state: str
    """R: it runs, or waits for the processor; T: it is stopped; others: it waits for something."""
    used: float
    """Processor time so far, s."""


class _Sign(NamedTuple):
    when: float
    used: float
    begun: bool


class Pulse:
    """The signs of life of the nodes of one graph.

    Parameters
    ----------
    longest : mapping of str to float
        Name of the node to the longest time that one of its handlers may take, s.
    """

    def __init__(self, longest: Mapping[str, float]) -> None:
        self._longest = longest
        self._signs: dict[str, _Sign] = {}
        self._looked = 0.0

    def sign(self, name: str, now: float, used: float) -> None:
        """A node has given a sign of life, when it had used so much processor time, s."""
        self._signs[name] = _Sign(now, used, True)

    def begin(self, name: str, now: float) -> None:
        """A node begins: until its next sign, which may take a while, it must not be stopped."""
        self._signs[name] = _Sign(now, 0.0, False)

    def forget(self, name: str) -> None:
        """A node has died, or has said goodbye: nothing more is expected of it."""
        self._signs.pop(name, None)

    def hung(self, now: float, pids: Mapping[str, int]) -> dict[str, float]:
        """Names of the nodes that hang, with the time since their last sign, s.

        Parameters
        ----------
        now : float
            Monotonic time, s.
        pids : mapping of str to int
            Numbers of the processes.
        """
        if now - self._looked > GAP:
            self._signs = {name: sign._replace(when=now) for name, sign in self._signs.items()}
        self._looked = now
        silent = {name: sign for name, sign in self._signs.items() if now - sign.when > SILENT}
        return {
            name: now - sign.when
            for name, sign in silent.items()
            if self._hangs(name, now, sign, busy(pids[name]))
        }

    def _hangs(self, name: str, now: float, sign: _Sign, does: Busy | None) -> bool:
        if does is not None and does.state in "Tt":
            return True
        if not sign.begun:
            return False
        silence, longest = now - sign.when, max(self._longest[name], SILENT)
        if does is not None and does.state == "R":
            return does.used - sign.used > longest
        return silence > longest


def busy(pid: int) -> Busy | None:
    """What a process does; None where the system does not say."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return Busy(fields[0], (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"))
