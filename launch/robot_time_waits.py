"""How long fingers wait for each other, if another robot makes their moves.

A finger that waits does so until another one has come to the end of a move: a contour is taken up,
and the next height handed out. Which move that was is seen from the recorded times; with another
robot it ends at another time, and the wait with it. Any other wait stays as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.robot_time import Moves, Sliding, durations
from palpate.core.measure.robot_time import Preset
from palpate.launch.robot_time_recording import FingerMoves

SAME = 1e-9
"""Times that differ by less of themselves are one: sums are rounded."""


class Place(NamedTuple):
    """One move of one finger."""

    finger: int
    """Place of the finger among them."""
    move: int
    """Place among its moves."""


def rescheduled(fingers: Sequence[FingerMoves], robot: Preset | Sliding) -> list[Moves]:
    """The moves of all fingers, with the waits that this robot would have.

    Parameters
    ----------
    fingers : sequence of FingerMoves
        What was recorded.
    robot : Preset or Sliding
        Who makes the moves.
    """
    work = [durations(one.moves._replace(wait=0.0 * one.moves.wait), robot) for one in fingers]
    lasts = [one.total() for one in work]
    waits = [one.moves.wait.copy() for one in fingers]
    ends = [np.zeros(len(one.ends)) for one in fingers]
    for end, finger, move in _in_order(fingers):
        before = ends[finger][move - 1] if move else 0.0
        if waits[finger][move] > SAME * end:
            awaited = _awaited(fingers, Place(finger, move))
            if awaited is not None:
                waits[finger][move] = max(ends[awaited.finger][awaited.move] - before, 0.0)
        ends[finger][move] = before + waits[finger][move] + lasts[finger][move]
    return [one.moves._replace(wait=wait) for one, wait in zip(fingers, waits, strict=True)]


def _in_order(fingers: Sequence[FingerMoves]) -> list[tuple[float, int, int]]:
    """All moves as they ended: who is waited for comes before who waits."""
    ends = [(end, i, k) for i, one in enumerate(fingers) for k, end in enumerate(one.ends.tolist())]
    return sorted(ends)


def _awaited(fingers: Sequence[FingerMoves], place: Place) -> Place | None:
    """The other finger's move at whose end this one began; None if there is none."""
    one, move = fingers[place.finger], place.move
    begun = float(one.moves.wait[move]) + (float(one.ends[move - 1]) if move else 0.0)
    for i, other in enumerate(fingers):
        near = _nearest(other.ends, begun)
        if i != place.finger and abs(float(other.ends[near]) - begun) <= SAME * begun:
            return Place(i, near)
    return None


def _nearest(times: Floats, wanted: float) -> int:
    return int(np.argmin(np.abs(times - wanted)))
