"""A tool's line to the launcher of a running graph."""

from __future__ import annotations

import os
import time
from typing import Any

from palpate.launch.processes.register import Card
from palpate.messages.bus.control import NodeLine
from palpate.messages.bus.wires import Wires
from palpate.messages.bus.words import TO_TOOLS, Word

PATIENCE = 5.0
"""Who does not answer for so long is busy, or stopped, s."""
AGAIN = 0.02
"""A node that is not up is asked for again after this long, s."""


def tell(card: Card, kind: str, **fields: Any) -> None:
    """Say a word to the launcher of a running graph, without waiting for an answer."""
    wires = Wires(card.key)
    line = _line(wires, card)
    line.send(kind, **fields)
    line.close()
    wires.close()


def ask(card: Card, kind: str, **fields: Any) -> Word:
    """Ask the launcher of a running graph, and return what it answers.

    A node that is just being started, or started again, is waited for.

    Raises
    ------
    ValueError
        If it refuses, or gives no answer.
    """
    deadline = time.monotonic() + PATIENCE
    wires = Wires(card.key)
    line = _line(wires, card)
    try:
        while True:
            line.send(kind, **fields)
            answer = _answer(line, card, deadline)
            if answer["kind"] != "not_yet" or time.monotonic() > deadline:
                break
            time.sleep(AGAIN)
    finally:
        line.socket.close(0)
        wires.close()
    if answer["kind"] in ("refused", "not_yet"):
        raise ValueError(str(answer["text"]))
    return answer


def _answer(line: NodeLine, card: Card, deadline: float) -> Word:
    left = deadline - time.monotonic()
    answer = line.receive() if line.socket.poll(int(1000 * max(left, 0.1))) else None
    if answer is None:
        raise ValueError(
            f"run {card.run[:6]} ({card.name}) gives no answer within {PATIENCE:g} s; "
            "it is busy or stopped"
        )
    return answer


def _line(wires: Wires, card: Card) -> NodeLine:
    return NodeLine(
        wires.context,
        card.tools,
        name=f"tool {os.getpid()} {os.urandom(4).hex()}",
        hears=TO_TOOLS,
    )
