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
from palpate.messages.codec import decode
from palpate.nodes.node import Source
from palpate.nodes.wiring import load_node

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
        self._pending: dict[int, tuple[str, str]] = {}
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
        tool, _ = self._pending.pop(ticket, ("", ""))
        if tool:
            self._line.send(tool, "done")

    def buried(self, name: str) -> None:
        """A node has died: what it had been asked for may not have been done."""
        for ticket, (tool, node) in list(self._pending.items()):
            if node == name:
                del self._pending[ticket]
                self._line.send(tool, "refused", text=f"{name} died before it had done that")

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
        name, ticket = str(word["node"]), next(self._tickets)
        try:
            self._check(name, word)
        except ValueError as error:
            return {"kind": "refused", "text": str(error)}
        fields = {key: value for key, value in word.items() if key not in ("kind", "node")}
        if not self._nodes.send(name, word["kind"], **{**fields, "ticket": ticket}):
            return {"kind": "not_yet", "text": f"{name} is not up"}
        self._pending[ticket] = tool, name
        while len(self._pending) > _MOST_PENDING:
            self._pending.pop(next(iter(self._pending)))
        return None

    def _check(self, name: str, word: Word) -> None:
        """Refuse what a node could not do."""
        wiring = self._ward.wirings.get(name)
        if wiring is None:
            raise ValueError(f"there is no node {name!r}")
        node = load_node(wiring.module)
        if not isinstance(node, Source):
            raise ValueError(f"{name} is no source: it speaks when it hears something")
        if word["kind"] == "publish":
            topic = word["topic"]
            if not node.outside or topic not in wiring.outputs.values():
                raise ValueError(f"{name} does not publish {topic!r} for tools")
            local = next(one for one, wire in wiring.outputs.items() if wire == topic)
            decode(node.outputs(wiring.params)[local], word["body"])
