"""Procedures that touch, wait and go on: written as generators, run as pure functions.

A routine yields what it wants to touch and is sent what was felt. A generator cannot be a
node's state, for it cannot be copied or compared; so the state keeps what was felt since the
routine began, and `resume` runs it again over that. Routines are short, a few touches each.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from palpate.core.explore.aim import Aim
from palpate.core.explore.felt import Felt

Result = TypeVar("Result")
Routine = Generator[Aim, Felt | None, Result]


@dataclass(frozen=True, slots=True)
class Done(Generic[Result]):
    """The end of a routine."""

    result: Result


def resume(start: Callable[[], Routine[Result]], felt: Sequence[Felt | None]) -> Aim | Done[Result]:
    """The next aim of a routine that has felt all this, or its end."""
    routine = start()
    try:
        aim = next(routine)
        for one in felt:
            aim = routine.send(one)
    except StopIteration as end:
        return Done(end.value)
    return aim
