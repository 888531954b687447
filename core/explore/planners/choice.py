"""What a planner answers: a height, that it waits, or that it stops and why."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from palpate.core.explore.planners.known import Known

END_SHARE = 0.03
"""The first and the last slice lie this share of the height inside the ends."""
END_DEVIATIONS = 2.0
"""And at least so many standard deviations of where the end is."""
SAME = 1e-9
"""Of the height: heights that differ by less are one."""


class Height(NamedTuple):
    """Trace this slice next."""

    height: float
    """m."""
    reason: str
    """Why there, in words."""


class Wait(NamedTuple):
    """Nothing to do until another finger has finished."""

    reason: str
    """Why, in words."""


class Stop(NamedTuple):
    """Trace no more."""

    reason: str
    """Why, in words."""
    within: bool | None
    """Whether the demand is met, as far as the planner can tell; None where it does not look."""
    bound: float | None = None
    """The root mean square error of the side is below this in 95 of 100 runs, m; None where the
    planner does not say."""
    unfelt: float | None = None
    """Largest height that nothing has felt, m; None where the planner does not say."""


Choice = Height | Wait | Stop


class Planner(Protocol):
    """A rule, with its numbers. It remembers nothing: the same `Known`, the same answer."""

    def next(self, known: Known) -> Choice:
        """The next slice, or that there is none."""
        ...


def first_and_last(known: Known) -> tuple[float, float]:
    """Heights of the lowest and the highest slice, m."""
    inside = END_SHARE * known.extent
    low = known.low + max(inside, END_DEVIATIONS * known.low_deviation)
    high = known.high - max(inside, END_DEVIATIONS * known.high_deviation)
    middle = 0.5 * (known.low + known.high)
    return min(low, middle), max(high, middle)


def spent(known: Known) -> str | None:
    """Which budget one slice more would overrun, in words; None if there is enough.

    A slice is expected to take as much as those before it did on average.
    """
    budget, traced = known.budget, max(len(known.slices), 1)
    touches = sum(one.touches for one in known.slices) / traced
    seconds = sum(one.seconds for one in known.slices) / traced
    for what, used, most, more in (
        ("touches", budget.touches, budget.most_touches, touches),
        ("s of robot time", budget.seconds, budget.most_seconds, seconds),
    ):
        if used >= most or used + more > most:
            return f"the budget is spent: {used:g} of {most:g} {what}, a slice takes {more:.3g}"
    return None


def tried(known: Known, height: float) -> bool:
    """Whether a slice was asked for at this height, whatever came of it."""
    heights = (*(one.height for one in known.slices), *known.taken)
    return any(abs(height - one) <= SAME * known.extent for one in heights)


def blocked(known: Known, height: float) -> bool:
    """Whether another finger is too near to this height."""
    return any(abs(height - other) < known.apart for other in known.taken)
