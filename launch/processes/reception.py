"""Where tools ask the launcher: how the graph is doing, and that a source may do something.

A tool that is stopped or killed while it is being answered is simply left out.
"""

from __future__ import annotations

import os
import time
from itertools import count
from typing import Any

from palpate.launch.processes.roll import Roll
from palpate.launch.processes.ward import Ward
from palpate.messages.bus.control import LauncherLine
from palpate.messages.bus.words import Word

_MOST = 8
_MOST_PENDING = 1000


class Reception:
    """Answers the tools of one graph.

    Parameters
    ----------
    line : LauncherLine
        The tools' line.
    nodes : LauncherLine
        The nodes' line.
    ward, roll
        The processes, and what the nodes have said.
    """

    def __init__(self, line: LauncherLine, nodes: LauncherLine, ward: Ward, roll: Roll) -> None:
        self._line, self._nodes, self._ward, self._roll = line, nodes, ward, roll
        self._began = time.monotonic()
        self._pending: dict[int, str] = {}
        self._tickets = count()

    def serve(self) -> None:
        """Answer what has come, but no more than a few at a time."""
        for _ in range(_MOST):
            try:
                asked = self._line.receive()
            except ValueError:
                continue
            if asked is None:
                return
            tool, word = asked
            answer = self._answer(tool, word)
            if answer is not None:
                self._line.send(tool, **answer)

    def done(self, ticket: int) -> None:
        """A node has done what a tool had asked for."""
        tool = self._pending.pop(ticket, None)
        if tool is not None:
            self._line.send(tool, "done")

    def _answer(self, tool: str, word: Word) -> dict[str, Any] | None:
        """What is answered at once; None if a node has to do something first."""
        return self._status() if word["kind"] == "status" else self._tell(tool, word)

    def _status(self) -> dict[str, Any]:
        now, counts = time.monotonic(), self._ward.restarts.counts
        living = set(self._ward.living)
        nodes = {
            name: {
                "pid": self._ward.pid(name) if name in living else 0,
                "restarts": counts[name],
                "silent_s": self._roll.silence(name, now),
            }
            for name in self._ward.wirings
        }
        return {
            "kind": "status",
            "launcher": os.getpid(),
            "for_s": now - self._began,
            "nodes": nodes,
        }

    def _tell(self, tool: str, word: Word) -> dict[str, Any] | None:
        """Hand a word on to a source, which says when it has done it."""
        name, ticket = str(word.get("node")), next(self._tickets)
        if name not in self._ward.wirings:
            return {"kind": "refused", "text": f"there is no node {name!r}"}
        fields = {key: value for key, value in word.items() if key not in ("kind", "node")}
        if not self._nodes.send(name, word["kind"], **{**fields, "ticket": ticket}):
            return {"kind": "not_yet", "text": f"{name} is not up"}
        self._pending[ticket] = tool
        while len(self._pending) > _MOST_PENDING:
            self._pending.pop(next(iter(self._pending)))
        return None
