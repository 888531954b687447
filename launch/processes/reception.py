"""Where tools ask the launcher: how the graph is doing, and that a source may do something.

A tool that is stopped or killed while it is being answered is simply left out.
"""

from __future__ import annotations

import os
import time
from typing import Any

from palpate.launch.processes.roll import Roll
from palpate.launch.processes.ward import Ward
from palpate.messages.bus.control import LauncherLine, Word

TOLD = ("pause", "resume", "step", "publish")
"""What a source may be told to do."""
_MOST = 8


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
            self._line.send(tool, **self._answer(word))

    def _answer(self, word: Word) -> dict[str, Any]:
        if word["kind"] == "status":
            return self._status()
        if word["kind"] in TOLD:
            return self._tell(word)
        return _refused(f"the launcher does not know the word {word['kind']!r}")

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

    def _tell(self, word: Word) -> dict[str, Any]:
        """Hand a word on to a source that is up."""
        name = word.get("node")
        if name not in self._ward.living:
            return _refused(f"no node {name!r} is up")
        fields = {key: value for key, value in word.items() if key not in ("kind", "node")}
        if not self._nodes.send(str(name), word["kind"], **fields):
            return _refused(f"{name} cannot be reached")
        return {"kind": "done"}


def _refused(text: str) -> dict[str, Any]:
    return {"kind": "refused", "text": text}
