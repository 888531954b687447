"""Single points of contours that are outliers.

One deviates from its neighbours along the contour where the contours beside it do not: what those
do there as well, a corner, a groove, a lobe, is the object's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from palpate.core.arrays import PROBABLE_ERROR, Bools, Floats
from palpate.core.rebuild.contours.curves import ContourCurve, chord_places, has_even_steps
from palpate.core.rebuild.contours.neighbours import lagrange_weights

# Deviations of the points' noise from which on one is off; and, of what the contours beside it are
# off there, for they see a corner at other points,
STICKS_OUT, SHARED = 4.5, 0.3
LEAST = 5e-4  # and of the perimeter: less does little harm
MOST = 0.15  # Share of a contour's points beyond which it is the contour that is like that
LEAST_POINTS = 12  # Contours of fewer points are not judged: seven points in a row tell of one
ROUNDS = 5  # Of looking, for what sticks out most hides what is beside it
SLACK = 0.3  # Of uneven steps: what a point may be off along the contour, others being mended
SWEEPS = 3  # Of mending, for outliers side by side
REACH = 3  # Neighbours on either side that tell of a point, and that it spoils
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

    points: Floats  # (N, 2), as they were given
    owner: NDArray[np.intp]
    turns: Floats
    near: NDArray[np.intp]  # (N, 7): each with three neighbours on either side
    ahead: Floats  # (N, 7): how far ahead, in turns, these are
    judged: Bools
    slack: Floats  # (N,): the step along the contour, where steps are uneven; else 0


def point_outliers(loops: tuple[ContourCurve, ...], places: Floats) -> PointOutliers:
    """Find single points that stick out of M contours, starting from those that are known.

    `places` (M, K) are turns of their curves that correspond, rising, over less than one turn.
    """
    known = np.concatenate([loop.off_height for loop in loops])
    all_ = _in_a_row(loops)
    steps = np.array([1.0 / len(loop.points) for loop in loops])
    sizes = np.array([loop.perimeter for loop in loops])
    least = LEAST * sizes[all_.owner]
    off = neighbour_deviation(all_.points[all_.near], all_.ahead).off
    alone = _over(off, _allowed(off, np.zeros(len(off)), least, all_))
    if not known.any() and not (alone > 1.0).any():
        untouched = tuple(loop.points for loop in loops)
        return PointOutliers(tuple(np.zeros(len(one), np.bool_) for one in untouched), untouched)
    beside_them = _shared_deviation(loops, places, steps, sizes, all_)
    common, bent, nearby = beside_them.common, beside_them.bent, beside_them.nearby
    mended = np.concatenate([loop.points for loop in loops])
    outlier = np.concatenate([loop.outlier for loop in loops])
    for number in range(ROUNDS):
        course = neighbour_deviation(mended[all_.near], all_.ahead)
        off = course.off - common
        over = _over(off, _allowed(off, nearby, least, all_))
        new = (over > 1.0) & (over >= over[all_.near].max(axis=1))
        new = (known & ~outlier) if number == 0 and (known & ~outlier).any() else new & ~outlier
        if not new.any():
            break
        outlier |= new
        mended[new] = course.predicted(bent)[new]
    beside = mended[all_.near]  # Those stay that are off once their neighbours are mended
    off = neighbour_deviation(beside, all_.ahead).off - common
    allowed = _allowed(off, nearby, least, all_)
    allowed[:, 0] += SLACK * all_.slack
    beside[:, REACH] = all_.points
    still = _over(neighbour_deviation(beside, all_.ahead).off - common, allowed) > 1.0
    outlier &= (still & ~beside_them.shared(outlier, all_.owner)) | known
    counts = np.bincount(all_.owner, outlier, len(loops)) * steps
    outlier &= (counts <= MOST)[all_.owner]
    mended = np.where(outlier[:, None], mended, all_.points)
    for _ in range(SWEEPS if outlier.any() else 0):
        course = neighbour_deviation(mended[all_.near], all_.ahead)
        mended[outlier] = course.predicted(bent)[outlier]
    ends = np.cumsum([len(loop.points) for loop in loops])[:-1]
    return PointOutliers(tuple(np.split(outlier, ends)), tuple(np.split(mended, ends)))


def _in_a_row(loops: tuple[ContourCurve, ...]) -> _Points:
    counts = np.array([len(loop.points) for loop in loops])
    owner = np.repeat(np.arange(len(loops)), counts)
    begin = (np.cumsum(counts) - counts)[owner]
    reach = np.arange(-REACH, REACH + 1)
    place = np.arange(counts.sum()) - begin
    near = begin[:, None] + (place[:, None] + reach) % counts[owner][:, None]
    turns = np.concatenate([loop.curve.parameters for loop in loops])
    away = turns[near] - turns[:, None]
    before, after = away[:, :REACH], away[:, REACH + 1 :]
    ahead = np.hstack([before - (before > 0.0), 0.0 * away[:, :1], after + (after < 0.0)])
    judged = counts[owner] >= LEAST_POINTS
    ahead = np.where(judged[:, None], ahead, reach)  # Some of few are on both sides: not judged
    slack = [
        0.0 if has_even_steps(loop.curve.parameters) else loop.perimeter / len(loop.points)
        for loop in loops
    ]
    points = np.concatenate([loop.as_given for loop in loops])
    return _Points(points, owner, turns, near, ahead, judged, np.array(slack)[owner])


def _shared_deviation(
    loops: tuple[ContourCurve, ...], places: Floats, steps: Floats, sizes: Floats, all_: _Points
) -> _Beside:
    count = len(loops)
    around = np.linspace(0.0, places.shape[1], SAMPLES, endpoint=False)
    wound = np.column_stack([places, places[:, :1] + 1.0])
    turns = np.stack([np.interp(around, np.arange(wound.shape[1]), row) for row in wound])
    ahead = steps[:, None, None] * np.arange(-REACH, REACH + 1)
    taps = (turns[..., None] + ahead).reshape(count, -1)
    fine = np.stack([loop.fine for loop in loops])
    beside = chord_places(fine, taps).reshape(-1, 2 * REACH + 1, 2)
    even = np.broadcast_to(np.arange(-REACH, REACH + 1.0), beside.shape[:2])
    found = neighbour_deviation(beside, even)
    parts = (part.reshape(count, SAMPLES, 2) for part in (found.off, found.bend))
    off, bend = (part / sizes[:, None, None] for part in parts)
    far = np.hypot(off[..., 0], off[..., 1])
    window = int(np.ceil(WINDOW * SAMPLES * float(np.median(steps))))
    most = _largest_near(far, window)
    if count == 1:
        nobody, zero = np.zeros((1, 0), np.intp), 0.0 * all_.points
        return _Beside(zero, zero, 0.0 * all_.turns, nobody, np.zeros(len(zero), np.intp), window)
    away = np.abs(np.subtract.outer(np.arange(count), np.arange(count))).astype(np.float64)
    np.fill_diagonal(away, np.inf)
    near = np.argsort(away, axis=1, kind="stable")[:, : min(NEAREST, count - 1)]
    common, bent = (np.median(part[near], axis=1) * sizes[:, None, None] for part in (off, bend))
    nearby = np.median(most[near], axis=1) * sizes[:, None]
    column = np.empty(len(all_.turns), np.intp)
    for row, begins in enumerate(turns):
        mine = all_.owner == row
        share = np.interp(
            np.mod(all_.turns[mine] - begins[0], 1.0),
            np.append(begins - begins[0], 1.0),
            np.arange(SAMPLES + 1),
        )
        column[mine] = np.rint(share).astype(np.intp) % SAMPLES
    at = all_.owner, column
    return _Beside(common[at], bent[at], nearby[at], near, column, window)


class _Beside(NamedTuple):
    """What the curves beside each point's do there."""

    common: Floats  # (N, 2): how far they are off,
    bent: Floats  # (N, 2): and off the cubic,
    nearby: Floats  # (N,): and at most
    near: NDArray[np.intp]  # (M, k): which curves are beside each
    column: NDArray[np.intp]  # (N,): place around of each point, of `SAMPLES`
    window: int  # Of these on either side that count as the same place

    def shared(self, outlier: Bools, owner: NDArray[np.intp]) -> Bools:
        """Of which points (N,) half of the curves beside have outliers there: it is the object."""
        marked = np.zeros((len(self.near), SAMPLES))
        marked[owner[outlier], self.column[outlier]] = 1.0
        marked = _largest_near(marked, self.window)
        if not self.near.shape[1]:
            return np.zeros(len(owner), np.bool_)
        return np.asarray((marked[self.near].mean(axis=1) >= 0.5)[owner, self.column])


def _largest_near(values: Floats, window: int) -> Floats:
    """The largest of so many on either side around closed rows (m, n)."""
    wound = np.pad(values, ((0, 0), (window, window)), mode="wrap")
    return np.asarray(sliding_window_view(wound, 2 * window + 1, axis=1).max(axis=2))


def _allowed(off: Floats, shared: Floats, least: Floats, all_: _Points) -> Floats:
    """How far good points may be off, along and across, (N, 2), by how far they are, (N, 2)."""
    size = np.abs(off)
    ends = np.flatnonzero(np.diff(all_.owner)) + 1
    medians = np.array([np.median(part, axis=0) for part in np.split(size, ends)])
    scale = medians[all_.owner]
    if all_.judged.any():
        scale = np.maximum(scale, np.median(size[all_.judged], axis=0))
    allowed: Floats = STICKS_OUT / PROBABLE_ERROR * scale + (SHARED * shared + least)[:, None]
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
    one, two = np.array(PAIRS).T
    share = ahead[:, one] / (ahead[:, one] - ahead[:, two])
    lines = (own[:, one] + share * (own[:, two] - own[:, one]) for own in in_frame)
    off = [-np.sort(five, axis=1)[:, 2] for five in lines]  # Their medians
    cubic = np.einsum("nk,nkd->nd", lagrange_weights(ahead[:, CUBIC]), beside[:, CUBIC])
    bend = -np.einsum("nij,nj->ni", frame, cubic)
    return NeighbourDeviation(np.stack(off, axis=1), bend, frame, point)


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
