"""Single points of contours that are outliers: found before any surface is fitted.

An outlier deviates from its neighbours along the contour where the contours beside it do not.
What those contours do there as well, a corner, a groove, a lobe, is the object's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from palpate.core.arrays import PROBABLE_ERROR, Bools, Floats
from palpate.core.rebuild.contours.curves import ContourCurve, chord_places, same_steps

CLEARLY = 4.5  # Deviations of the points' noise from which on one is off,


# and of what the contours beside it are off there, for they see a corner at other points,
SHARED = 0.3
LEAST = 5e-4  # and of the perimeter: less does little harm
MOST = 0.15  # Share of a contour's points beyond which it is the contour that is like that
LEAST_POINTS = 12  # Contours of fewer points are not judged: seven points in a row tell of one
ROUNDS = 5  # Of looking, for what sticks out most hides what is beside it


SLACK = 0.3  # Of uneven steps: what a point may be off along the contour, others being mended
SWEEPS = 3  # Of mending, for outliers side by side
BESIDE = 3  # Points on either side that one point spoils
REACH = 3  # Neighbours on either side that tell of a point
SAMPLES = 128  # Places around at which curves are compared
NEAREST = 4  # Curves beside one that tell what is the object's
WINDOW = 1.5  # Steps on either side within which a curve may have the same corner


PAIRS = ((2, 4), (1, 5), (0, 6), (2, 1), (4, 5))  # Of seven in a row: lines to the fourth
CUBIC = (1, 2, 4, 5)  # Neighbours that a cubic passes


class PointOutliers(NamedTuple):
    """What was found, for each of the curves."""

    masks: tuple[Bools, ...]  # (n,): which points are wrong
    mended: tuple[Floats, ...]  # (n, 2): with these where neighbours and contours beside tell


class _Points(NamedTuple):
    """All points of all curves in a row."""

    owner: NDArray[np.intp]
    turns: Floats
    near: NDArray[np.intp]  # (N, 7): each with three neighbours on either side
    judged: Bools
    slack: Floats  # (N,): the step along the contour, where steps are uneven; else 0


def point_outliers(loops: tuple[ContourCurve, ...], places: Floats) -> PointOutliers:
    """Find single points that stick out of M contours, starting from those that are known.

    `places` (M, K) are turns of their curves that correspond, rising, over less than one turn.
    """
    points = np.concatenate([loop.as_given for loop in loops])
    known = np.concatenate([loop.off_height for loop in loops])
    all_ = _in_a_row(loops)
    steps = np.array([1.0 / len(loop.points) for loop in loops])
    sizes = np.array([loop.perimeter for loop in loops])
    least = LEAST * sizes[all_.owner]
    if not known.any() and _smooth(points, least, all_):
        untouched = tuple(loop.points for loop in loops)
        return PointOutliers(tuple(np.zeros(len(one), np.bool_) for one in untouched), untouched)
    shared = shared_deviation(np.stack([loop.fine for loop in loops]), places, steps, sizes)
    there = shared.at(all_.owner, all_.turns)
    mended = np.concatenate([loop.points for loop in loops])
    outlier = np.concatenate([loop.outlier for loop in loops])
    for number in range(ROUNDS):
        course = neighbour_deviation(mended[all_.near], _turns_beside(all_))
        off = course.off - there.off
        over = _over(off, _allowed(off, there.most, least, all_))
        new = (over > 1.0) & (over >= over[all_.near].max(axis=1))
        new = (known & ~outlier) if number == 0 and (known & ~outlier).any() else new & ~outlier
        if not new.any():
            break
        outlier |= new
        mended[new] = course.predicted(there.bend)[new]
    outlier = _still_off(points, mended, outlier & ~known, there, least, all_) | (known & outlier)
    counts = np.bincount(all_.owner, outlier, len(loops)) * steps
    outlier &= (counts <= MOST)[all_.owner]
    mended = np.where(outlier[:, None], mended, points)
    for _ in range(SWEEPS if outlier.any() else 0):
        course = neighbour_deviation(mended[all_.near], _turns_beside(all_))
        mended[outlier] = course.predicted(there.bend)[outlier]
    ends = np.cumsum([len(loop.points) for loop in loops])[:-1]
    return PointOutliers(tuple(np.split(outlier, ends)), tuple(np.split(mended, ends)))


def _in_a_row(loops: tuple[ContourCurve, ...]) -> _Points:
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


def _smooth(points: Floats, least: Floats, all_: _Points) -> bool:
    """Whether no point sticks out of its own contour, whatever those beside it do."""
    off = neighbour_deviation(points[all_.near], _turns_beside(all_)).off
    return not (_over(off, _allowed(off, np.zeros(len(off)), least, all_)) > 1.0).any()


def shared_deviation(fine: Floats, places: Floats, steps: Floats, sizes: Floats) -> SharedDeviation:
    """What the curves beside each are off, at the distance of their own points.

    Parameters
    ----------
    fine : (M, n, 2) array
        Curves at even steps of their turn.
    places : (M, K) array
        Turns of them that correspond, rising, over less than one turn.
    steps : (M,) array
        Turns between their points.
    sizes : (M,) array
        How large they are.
    """
    count = len(fine)
    around = np.linspace(0.0, places.shape[1], SAMPLES, endpoint=False)
    wound = np.column_stack([places, places[:, :1] + 1.0])
    turns = np.stack([np.interp(around, np.arange(wound.shape[1]), row) for row in wound])
    ahead = steps[:, None, None] * np.arange(-REACH, REACH + 1)
    taps = (turns[..., None] + ahead).reshape(count, -1)
    beside = chord_places(fine, taps).reshape(-1, 2 * REACH + 1, 2)
    even = np.broadcast_to(np.arange(-REACH, REACH + 1.0), beside.shape[:2])
    found = neighbour_deviation(beside, even)
    off, bend = (
        part.reshape(count, SAMPLES, 2) / sizes[:, None, None] for part in (found.off, found.bend)
    )
    far = np.hypot(off[..., 0], off[..., 1])
    window = int(np.ceil(WINDOW * SAMPLES * float(np.median(steps))))
    most = maximum_filter1d(far, 2 * window + 1, axis=1, mode="wrap")
    near = _nearest(count)
    if not near.shape[1]:
        return SharedDeviation(turns, 0.0 * off, 0.0 * off, 0.0 * far)
    common, bent = (np.median(part[near], axis=1) * sizes[:, None, None] for part in (off, bend))
    return SharedDeviation(turns, common, bent, np.median(most[near], axis=1) * sizes[:, None])


def _nearest(count: int) -> NDArray[np.intp]:
    """The curves next to each one, (count, at most 4)."""
    every = np.arange(count)
    away = np.abs(every[:, None] - every).astype(np.float64)
    np.fill_diagonal(away, np.inf)
    nearest: NDArray[np.intp] = np.argsort(away, axis=1, kind="stable")[
        :, : min(NEAREST, count - 1)
    ]
    return nearest


def _still_off(
    points: Floats, mended: Floats, outlier: Bools, there: DeviationAt, least: Floats, all_: _Points
) -> Bools:
    """Those outliers that are so as well once their neighbours have been mended."""
    beside, ahead = mended[all_.near], _turns_beside(all_)
    allowed = _allowed(neighbour_deviation(beside, ahead).off - there.off, there.most, least, all_)
    allowed[:, 0] += SLACK * all_.slack
    beside[:, BESIDE] = points
    return outlier & (_over(neighbour_deviation(beside, ahead).off - there.off, allowed) > 1.0)


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
    allowed: Floats = CLEARLY / PROBABLE_ERROR * scale + (SHARED * shared + least)[:, None]
    return np.where(all_.judged[:, None], allowed, np.inf)


def neighbour_deviation(beside: Floats, ahead: Floats) -> NeighbourDeviation:
    """How far points are off what their neighbours predict of them.

    `beside` (N, 7, 2) is each point in the middle of its neighbours, which are `ahead` (N, 7) of
    it, in turns, rising. They predict it five times, and the median counts: one wrong neighbour
    spoils two of the five at most.
    """
    point = beside[:, REACH]
    beside = beside - point[:, None]
    along = beside[:, REACH + 2] - beside[:, REACH - 2]
    length = np.hypot(along[:, 0], along[:, 1])
    along = along / np.where(length > 0.0, length, 1.0)[:, None]
    frame = np.stack([along, np.stack([along[:, 1], -along[:, 0]], axis=1)], axis=1)
    in_frame = np.einsum("nij,nkj->ink", frame, beside)
    one, other = np.array(PAIRS).T
    share = ahead[:, one] / (ahead[:, one] - ahead[:, other])
    off = [
        -_middle_of_five(own[:, one] + share * (own[:, other] - own[:, one])) for own in in_frame
    ]
    cubic = np.einsum("nk,nkd->nd", _cubic_weights(ahead[:, CUBIC]), beside[:, CUBIC])
    bend = -np.einsum("nij,nj->ni", frame, cubic)
    return NeighbourDeviation(np.stack(off, axis=1), bend, frame, point)


def _middle_of_five(values: Floats) -> Floats:
    """Medians (N,) of rows (N, 5): three of the five are no more than it, and three no less."""
    a, b, c, d, e = values.T
    low, high = np.minimum(a, b), np.maximum(a, b)
    low, high = np.maximum(low, np.minimum(c, d)), np.minimum(high, np.maximum(c, d))
    # Of four values the two in the middle are left; the fifth is between them, or not.
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e)))


def _cubic_weights(ahead: Floats) -> Floats:
    """Lagrange's weights (N, 4) at 0 of values at four other places (N, 4)."""
    between = ahead[:, None, :] - ahead[:, :, None]
    np.einsum("nkk->nk", between)[:] = 1.0
    others = np.where(np.eye(4, dtype=bool), 1.0, ahead[:, None, :])
    return np.asarray((others / between).prod(axis=2))


def _over(off: Floats, allowed: Floats) -> Floats:
    """How many times farther than allowed points are off, (N,)."""
    return np.asarray((np.abs(off) / allowed).max(axis=1))


class NeighbourDeviation(NamedTuple):
    """Points and what their neighbours predict of them."""

    off: Floats  # (N, 2): how far each is off, along and across, by the median of several guesses
    bend: Floats  # (N, 2): how far each is off the cubic through two neighbours on either side
    frame: Floats  # (N, 2, 2): unit vectors along and across
    points: Floats  # (N, 2)

    def predicted(self, bend: Floats) -> Floats:
        """Where they should be if they ought to be off the cubic by as much, (N, 2)."""
        return np.asarray(self.points + np.einsum("ni,nij->nj", bend - self.bend, self.frame))


class SharedDeviation(NamedTuple):
    """What the curves beside each are off the course of their own, by the place around."""

    places: Floats  # (M, S): turns that correspond, rising, over less than one turn
    off: Floats  # (M, S, 2): along and across, in the size of the curve itself
    bend: Floats  # (M, S, 2): the same from the cubic
    most: Floats  # (M, S): how far they are off nearby, at most

    def at(self, owner: NDArray[np.intp], turns: Floats) -> DeviationAt:
        """Where the curves `owner` (N,) have the turns (N,)."""
        column = np.empty(len(turns), np.intp)
        samples = self.places.shape[1]
        for row, places in enumerate(self.places):
            mine = owner == row
            ahead = np.mod(turns[mine] - places[0], 1.0)
            rising = np.append(places - places[0], 1.0)
            share = np.interp(ahead, rising, np.arange(samples + 1))
            column[mine] = np.rint(share).astype(np.intp) % samples
        return DeviationAt(
            self.off[owner, column], self.bend[owner, column], self.most[owner, column]
        )


class DeviationAt(NamedTuple):
    """The same for single points."""

    off: Floats  # (N, 2)
    bend: Floats  # (N, 2)
    most: Floats  # (N,)
