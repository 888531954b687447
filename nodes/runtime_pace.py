"""When a source says what it has to say: each at its time, with pauses, or one by one."""

from __future__ import annotations


class Pace:
    """The clock of one source.

    Parameters
    ----------
    paused : bool
        Whether it stands still until it is told to go on.
    """

    def __init__(self, *, paused: bool = False) -> None:
        self.paused = paused
        """Whether it stands still."""
        self._place = self._when = 0.0
        self._steps = 0

    def start(self, place: float, now: float) -> None:
        """Begin at a time of the source, s, at a monotonic time, s."""
        self._place, self._when = place, now

    def wait(self, due: float, now: float) -> float | None:
        """Time until what is due may be said, s; None while it stands still before that."""
        if due <= self._place or self._steps:
            return 0.0
        return None if self.paused else max(0.0, due - self._at(now))

    def gone(self, due: float, now: float) -> None:
        """What was due has been said."""
        if self._steps and due > self._place:
            self._steps -= 1
            self.start(due, now)

    def pause(self, now: float) -> None:
        """Stand still."""
        self.start(self._at(now), now)
        self.paused = True

    def resume(self, now: float) -> None:
        """Go on from where it stands."""
        self.start(self._at(now), now)
        self.paused, self._steps = False, 0

    def step(self, number: int) -> None:
        """Say the next so many at once, if it stands still."""
        if self.paused:
            self._steps += number

    def _at(self, now: float) -> float:
        return self._place if self.paused else self._place + now - self._when
