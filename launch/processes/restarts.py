"""Whether a node that has died may be started again: not if it dies of the same once more."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from palpate.nodes.wiring import OnExit

MOST, WITHIN = 3, 10.0
"""So often may a node be started again within so many s: more is a storm."""


class Restarts:
    """What nodes have died of so far.

    Parameters
    ----------
    on_exit : mapping of str to str
        Name of the node to what is done when it dies.
    """

    def __init__(self, on_exit: Mapping[str, OnExit]) -> None:
        self.counts = dict.fromkeys(on_exit, 0)
        """How often each node has been started again."""
        self._on_exit = on_exit
        self._failed_while: dict[str, str] = {}
        self._when: dict[str, deque[float]] = {name: deque(maxlen=MOST) for name in on_exit}

    def refusal(self, name: str, how: str, failed: bool, now: float) -> str | None:
        """Why a node that died may not be started again, in a sentence; None if it may.

        Parameters
        ----------
        name : str
            Name of the node.
        how : str
            How it died, as the rest of a sentence that begins with its name.
        failed : bool
            Whether it said so itself: what it failed of is in `how`.
        now : float
            Monotonic time, s.
        """
        if self._on_exit[name] == "stop":
            return f"{name} {how}"
        if failed:
            if self._failed_while.get(name) == how:
                return f"{name} {how}; so it did when it was started again"
            self._failed_while[name] = how
        when = self._when[name]
        if len(when) == MOST and now - when[0] < WITHIN:
            return f"{name} {how}, after it had been started again {MOST} times in {WITHIN:g} s"
        when.append(now)
        self.counts[name] += 1
        return None
