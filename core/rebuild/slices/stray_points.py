"""Single points of contours that are wrong: found before any surface is fitted.

A wrong point is off the course of its neighbours along the contour where the contours beside it
are not. What those contours do there as well, a corner, a groove, a lobe, is the object's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.slices.even_steps import same_steps
from palpate.core.rebuild.slices.loops import Loop
from palpate.core.rebuild.slices.neighbour_course import Around, off_course, shared_course

CLEARLY = 4.5
"""Deviations of the points' noise from which on one is off,"""
SHARED = 0.3
"""and of what the contours beside it are off there, for they see a corner at other points,"""
LEAST = 5e-4
"""and of the perimeter: less does little harm."""
MEDIAN = 0.6745
"""Median size of an error of deviation 1."""
MOST = 0.15
"""Share of a contour's points beyond which it is the contour that is like that."""
LEAST_POINTS = 12
"""Contours of fewer points are not judged: seven points in a row tell of one."""
ROUNDS = 5
"""Of looking, for what sticks out most hides what is beside it."""
SLACK = 0.3
"""Of uneven steps: what a point may be off along the contour, once others have been mended."""
SWEEPS = 3
"""Of mending, for points that stray side by side."""
BESIDE = 3
"""Points on either side that one point spoils."""


class Strays(NamedTuple):
    """What was found, for each of the loops."""

    masks: tuple[Bools, ...]
    """(n,): which points are wrong."""
    mended: tuple[Floats, ...]
    """(n, 2): with these where their neighbours and the contours beside tell."""


class _Points(NamedTuple):
    """All points of all loops in a row."""

    owner: NDArray[np.intp]
    turns: Floats
    near: NDArray[np.intp]
    """(N, 7): each with three neighbours on either side."""
    judged: Bools
    slack: Floats
    """(N,): the step along the contour, where steps are uneven; else 0."""


def stray_points(loops: tuple[Loop, ...], places: Floats) -> Strays:
    """Find single points that stick out, starting from those that are known.

    Parameters
    ----------
    loops : tuple of Loop
        M contours from the lowest to the highest.
    places : (M, K) array
        Turns of their curves that correspond, rising, over less than one turn.
    """
    points = np.concatenate([loop.felt for loop in loops])
    known = np.concatenate([loop.aloft for loop in loops])
    all_ = _in_a_row(loops)
    steps = np.array([1.0 / len(loop.points) for loop in loops])
    sizes = np.array([loop.perimeter for loop in loops])
    least = LEAST * sizes[all_.owner]
    if not known.any() and _smooth(points, least, all_):
        untouched = tuple(loop.points for loop in loops)
        return Strays(tuple(np.zeros(len(one), np.bool_) for one in untouched), untouched)
    shared = shared_course(np.stack([loop.fine for loop in loops]), places, steps, sizes)
    there = shared.at(all_.owner, all_.turns)
    mended = np.concatenate([loop.points for loop in loops])
    stray = np.concatenate([loop.stray for loop in loops])
    for number in range(ROUNDS):
        course = off_course(mended[all_.near], _turns_beside(all_))
        off = course.off - there.off
        over = _over(off, _allowed(off, there.most, least, all_))
        new = (over > 1.0) & (over >= over[all_.near].max(axis=1))
        new = (known & ~stray) if number == 0 and (known & ~stray).any() else new & ~stray
        if not new.any():
            break
        stray |= new
        mended[new] = course.foretold(there.bend)[new]
    stray = _still_off(points, mended, stray & ~known, there, least, all_) | (known & stray)
    counts = np.bincount(all_.owner, stray, len(loops)) * steps
    stray &= (counts <= MOST)[all_.owner]
    mended = np.where(stray[:, None], mended, points)
    for _ in range(SWEEPS if stray.any() else 0):
        course = off_course(mended[all_.near], _turns_beside(all_))
        mended[stray] = course.foretold(there.bend)[stray]
    ends = np.cumsum([len(loop.points) for loop in loops])[:-1]
    return Strays(tuple(np.split(stray, ends)), tuple(np.split(mended, ends)))


def _smooth(points: Floats, least: Floats, all_: _Points) -> bool:
    """Whether no point sticks out of its own contour, whatever those beside it do."""
    off = off_course(points[all_.near], _turns_beside(all_)).off
    return not (_over(off, _allowed(off, np.zeros(len(off)), least, all_)) > 1.0).any()


def _in_a_row(loops: tuple[Loop, ...]) -> _Points:
    counts = np.array([len(loop.points) for loop in loops])
    owner = np.repeat(np.arange(len(loops)), counts)
    begin = (np.cumsum(counts) - counts)[owner]
    place = np.arange(counts.sum()) - begin
    reach = np.arange(-BESIDE, BESIDE + 1)
    near = begin[:, None] + (place[:, None] + reach) % counts[owner][:, None]
    turns = np.concatenate([loop.curve.parameters for loop in loops])
    slack = [
        0.0 if same_steps(loop.curve.parameters) else loop.perimeter / len(loop.points)
        for loop in loops
    ]
    return _Points(owner, turns, near, counts[owner] >= LEAST_POINTS, np.array(slack)[owner])


def _turns_beside(all_: _Points) -> Floats:
    """How far ahead, in turns, each point's neighbours are, (N, 7)."""
    away = all_.turns[all_.near] - all_.turns[:, None]
    before, after = away[:, :BESIDE], away[:, BESIDE + 1 :]
    ahead = np.hstack([before - (before > 0.0), 0.0 * away[:, :1], after + (after < 0.0)])
    # Among few points some are neighbours on both sides; they are not judged.
    return np.where(all_.judged[:, None], ahead, np.arange(-BESIDE, BESIDE + 1))


def _allowed(off: Floats, shared: Floats, least: Floats, all_: _Points) -> Floats:
    """How far good points may be off, along and across, (N, 2), by how far they are, (N, 2)."""
    size = np.abs(off)
    ends = np.flatnonzero(np.diff(all_.owner)) + 1
    medians = np.array([np.median(part, axis=0) for part in np.split(size, ends)])
    scale = medians[all_.owner]
    if all_.judged.any():
        scale = np.maximum(scale, np.median(size[all_.judged], axis=0))
    allowed: Floats = CLEARLY / MEDIAN * scale + (SHARED * shared + least)[:, None]
    return np.where(all_.judged[:, None], allowed, np.inf)


def _over(off: Floats, allowed: Floats) -> Floats:
    """How many times farther than allowed points are off, (N,)."""
    over: Floats = (np.abs(off) / allowed).max(axis=1)
    return over


def _still_off(
    points: Floats, mended: Floats, stray: Bools, there: Around, least: Floats, all_: _Points
) -> Bools:
    """Those that stray which do so as well once their neighbours have been mended."""
    beside, ahead = mended[all_.near], _turns_beside(all_)
    allowed = _allowed(off_course(beside, ahead).off - there.off, there.most, least, all_)
    allowed[:, 0] += SLACK * all_.slack
    beside[:, BESIDE] = points
    return stray & (_over(off_course(beside, ahead).off - there.off, allowed) > 1.0)
