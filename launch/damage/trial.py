"""One damaged input, read: accepted, refused with the one error, or a defect."""

from __future__ import annotations

import random
import tempfile
import time
from pathlib import Path
from typing import Literal, NamedTuple

from palpate.launch.damage.kinds import KINDS, Kind

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


def again(name: str, number: int) -> Outcome:
    """Damage and read one input by itself, as `repeat` does; `name` is one of `KINDS`."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        KINDS[name].prepare(Path(folder))
        return repeat(KINDS[name], number, Path(folder))


def repeat(kind: Kind, number: int, folder: Path) -> Outcome:
    """Damage and read the input of a number, which is the same whenever it is done.

    Parameters
    ----------
    kind : Kind
        What is read.
    number : int
        The seed.
    folder : Path
        Where files are put; prepared.
    """
    outcome = _once(kind, number, folder)
    for _ in range(TRIES - 1):
        if outcome.seconds <= SECONDS:
            return outcome
        outcome = min(outcome, _once(kind, number, folder), key=lambda one: one.seconds)
    if outcome.seconds <= SECONDS:
        return outcome
    return Outcome("defect", f"takes {outcome.seconds:.1f} s", outcome.seconds)


def _once(kind: Kind, number: int, folder: Path) -> Outcome:
    rng = random.Random(f"{kind.name} {number}")
    began, then = time.process_time(), time.monotonic()
    try:
        kind.attempt(rng, number, folder)
    except Exception as error:
        fault = _fault(error, kind.refusal)
        seconds = _took(began, then)
        if fault is None:
            return Outcome("refused", str(error), seconds)
        return Outcome("defect", f"{fault}: {error!s:.300}", seconds)
    return Outcome("accepted", "", _took(began, then))


def _took(began: float, then: float) -> float:
    """Processor time, or that of the clock if something was waited for."""
    waited = time.monotonic() - then
    return waited if waited > WAITS else time.process_time() - began


def _fault(error: Exception, refusal: type[Exception]) -> str | None:
    """What is wrong with an error as a refusal; None if it is one."""
    kind, said = type(error), str(error)
    own = kind is refusal or kind.__module__.startswith("palpate.")
    if not (own and isinstance(error, refusal)):
        return kind.__name__
    if _ran_out(error):
        return "refused for want of memory"
    if not said or "\n" in said or len(said) > MOST_LETTERS:
        return f"refused in no sentence, but {len(said)} letters"
    return None


def _ran_out(error: BaseException | None) -> bool:
    """Whether an error came of another that says that there was no more memory."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False
