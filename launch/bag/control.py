"""Words to the player of a running graph: stand still, go on, step."""

from __future__ import annotations

from typing import Any

from palpate.launch.located import InputError
from palpate.launch.looking.ask import ask
from palpate.launch.processes.register import Card, find_run

PLAYER = "palpate.nodes.player"


def control(run: str | None, kind: str, **fields: Any) -> None:
    """Say a word to the player of a running graph.

    Raises
    ------
    InputError
        If no such graph runs, it has no player or several, or the word is refused.
    """
    try:
        card = find_run(run)
        ask(card, kind, node=_player(card), **fields)
    except ValueError as error:
        raise InputError(str(error)) from None


def _player(card: Card) -> str:
    players = [one.name for one in card.nodes if one.module == PLAYER]
    if len(players) != 1:
        has = ", ".join(players) or "none"
        raise ValueError(f"run {card.run[:6]} ({card.name}) must have one player, it has {has}")
    return players[0]
