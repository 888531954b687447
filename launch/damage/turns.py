"""Whose turn it is: every second input was made by hand, as long as there are such."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

Bomb = TypeVar("Bomb")


def bomb_of(number: int, bombs: Sequence[Bomb]) -> Bomb | None:
    """The bomb whose turn is at a number; None where damage comes from the seed."""
    turn, odd = divmod(number, 2)
    return None if odd or turn >= len(bombs) else bombs[turn]
