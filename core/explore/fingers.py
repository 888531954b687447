"""Whose result comes next, where several fingers work side by side.

Results are taken up in the order of robot time, whatever the order in which they were heard: one
counts only when no other finger can still bring an earlier one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping


def next_finished(
    finished: Mapping[int, float], busy: Collection[int], clocks: Mapping[int, float]
) -> int | None:
    """The finger whose result is taken up next; None if one must still be waited for.

    Parameters
    ----------
    finished : map
        Finger to the robot time of its result, s, of those not yet taken up.
    busy : collection of int
        Fingers at work, those that have finished among them.
    clocks : map
        Finger to the robot time that it is known to have reached, s.
    """
    if not finished:
        return None
    first = min((seconds, finger) for finger, seconds in finished.items())
    others = (finger for finger in busy if finger not in finished)
    if all((clocks.get(other, 0.0), other) > first for other in others):
        return first[1]
    return None
