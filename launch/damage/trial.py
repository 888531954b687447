"""One damaged input, read: accepted, refused with the one error, or a defect."""

from __future__ import annotations

import random
import time
from pathlib import Path
from typing import Literal, NamedTuple

from palpate.launch.damage.kinds import KINDS

SECONDS = 1.0
"""Longest processor time for one input, s: what it takes on a machine that does nothing else."""
WAITS = 10.0
"""Longest time by the clock, s: whoever waits for something uses no processor."""
TRIES = 3
"""Of an input that takes longer: the processor may have been shared."""
MOST_LETTERS = 1000
"""Of the sentence by which an input is refused."""


class Outcome(NamedTuple):
    """What came of one input."""

    verdict: Literal["accepted", "refused", "defect"]
    said: str
    """The sentence of a refusal, or what the defect is."""
    seconds: float
    """Processor time of the fastest try."""


def repeat(kind: str, number: int, folder: Path) -> Outcome:
    """Damage and read the input of a number, the same whenever it is done.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    number : int
        The seed; bombs come first.
    folder : Path
        Where files are put; prepared.
    """
    outcome = _once(kind, number, folder)
    for _ in range(TRIES - 1):
        if outcome.seconds <= SECONDS:
            break
        outcome = min(outcome, _once(kind, number, folder), key=lambda one: one.seconds)
    if outcome.seconds > SECONDS:
        return Outcome("defect", f"takes {outcome.seconds:.1f} s", outcome.seconds)
    return outcome


def _once(kind: str, number: int, folder: Path) -> Outcome:
    rng = random.Random(f"{kind} {number}")
    refusals = KINDS[kind].refusals
    began, then = time.process_time(), time.monotonic()
    try:
        KINDS[kind].attempt(rng, number, folder)
    except Exception as error:
        seconds = _took(began, then)
        said, name = str(error), type(error).__name__
        if type(error) not in refusals or _ran_out(error):
            return Outcome("defect", f"{name}: {said:.300}", seconds)
        if not said or "\n" in said or len(said) > MOST_LETTERS:
            return Outcome("defect", f"refused in no sentence: {said:.300}", seconds)
        return Outcome("refused", said, seconds)
    return Outcome("accepted", "", _took(began, then))


def _took(began: float, then: float) -> float:
    """Processor time, or that of the clock if something was waited for."""
    waited = time.monotonic() - then
    return waited if waited > WAITS else time.process_time() - began


def _ran_out(error: BaseException | None) -> bool:
    """Whether an error came of another that says that there was no more memory."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False
