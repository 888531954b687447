"""Asks a planner, and refuses an answer that nobody could act on: a planner may be a user's own."""

from __future__ import annotations

import math

from palpate.core.explore.planners.choice import (
    SAME,
    Choice,
    Height,
    Planner,
    Stop,
    Wait,
    tried,
)
from palpate.core.explore.planners.known import Known


def ask(planner: Planner, known: Known) -> Choice:
    """What a planner answers.

    Parameters
    ----------
    planner : Planner
        Who is asked.
    known : Known
        What is known.

    Raises
    ------
    ValueError
        If it is no answer; or a height that does not lie between the ends, was asked for before,
        or is too near to another finger; or it waits though no finger is at work; or a bound or an
        unfelt height is no length.
    """
    choice = planner.next(known)
    wrong = _wrong(known, choice)
    if wrong:
        name = type(planner).__name__
        raise ValueError(f"the planner {name} gave no answer to act on: {wrong}")
    return choice


def _wrong(known: Known, choice: object) -> str:
    """What is wrong with an answer; nothing if nothing is."""
    match choice:
        case Height():
            return _wrong_height(known, choice.height)
        case Wait():
            return "" if known.taken else "it waits, but no finger is at work"
        case Stop():
            return _wrong_stop(choice)
    return f"it must answer with a Height, a Wait or a Stop, got {choice!r:.60}"


def _wrong_height(known: Known, height: float) -> str:
    if not known.low < height < known.high:  # nor is it if it is no number
        return f"a height must lie between {known.low:g} and {known.high:g} m, got {height:g} m"
    if tried(known, height):
        return f"a slice was asked for at {height:g} m before; it must go elsewhere, or stop"
    near = [other for other in known.taken if abs(height - other) < known.apart * (1.0 - SAME)]
    if near:
        return f"{height:g} m is nearer than {known.apart:g} m to a finger at {near[0]:g} m"
    return ""


def _wrong_stop(stop: Stop) -> str:
    for name in ("bound", "unfelt"):
        value = getattr(stop, name)
        if value is not None and not 0.0 <= value < math.inf:
            return f"{name} must be 0 or more and finite, got {value} m"
    return ""
