"""A tool's line to the launcher of a running graph."""

from __future__ import annotations

import os
from typing import Any

import zmq

from palpate.launch.processes.register import Card
from palpate.messages.bus.control import NodeLine, Word

PATIENCE_MS = 3000
"""A launcher that does not answer for so long is busy, or stopped."""


def ask(card: Card, kind: str, **fields: Any) -> Word:
    """Ask the launcher of a running graph, and return what it answers.

    Raises
    ------
    ValueError
        If it refuses, or gives no answer.
    """
    with zmq.Context() as context:
        line = NodeLine(context, card.tools, name=f"tool {os.getpid()} {os.urandom(4).hex()}")
        try:
            line.send(kind, **fields)
            if not line.socket.poll(PATIENCE_MS):
                raise ValueError(
                    f"the launcher of {card.run[:6]} ({card.name}) gives no answer within "
                    f"{PATIENCE_MS / 1000:g} s; it is busy or stopped"
                )
            answer = line.receive()
        finally:
            line.socket.close(0)
    if answer is None or answer["kind"] == "refused":
        raise ValueError(str(answer["text"]) if answer else "the launcher said nothing")
    return answer
