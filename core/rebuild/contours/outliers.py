"""What is wrong in contours: single points that are outliers, and contours that others contradict.

An outlier deviates from its neighbours along the contour where the contours beside it do not: what
those do there as well, a corner, a groove, a lobe, is the object's. Each contour is predicted from
two neighbours on either side (leave one out, Lagrange's weights); a wrong one spoils its own
prediction and its neighbours' by known shares, which edges and steps of the object do not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from palpate.core.arrays import PROBABLE_ERROR, Bools, Floats
from palpate.core.rebuild.contours.curves import ContourCurve, chord_places, same_steps
from palpate.core.rebuild.contours.prediction import lagrange_weights, neighbour_weights

# Of points.
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
# Of contours.
LEAST_SLICES = 9  # A bad contour spoils five predictions: fewer slices do not tell good ones
USUAL = 0.2  # Quantile of the errors that stands for good contours: three bad ones spoil half
CLEARLY = 4.2  # A bad contour is off, across its curve, by more than so many times that error,
LEAST_OFF = 0.02  # and by more than this share of the mean distance from the middles
# Of that: a contour is looked at only if its own prediction is off by more. It would be by 0.7, but
# a second bad one within 4 may take most of it away.
OWN = 0.2
# Of what the neighbours' predictions are off, squared, along the way in which a contour is: if more
# is left when it is put right, the object itself is like that. Its edges leave 0.05, its steps
# 0.12.
UNEXPLAINED = 0.02
UNEXPLAINED_NEAR = 0.01  # Where another within 4 is bad as well: two explain more
UNEXPLAINED_END = 0.003  # Next to lowest and highest: objects that round off leave 0.01
PAIRED = (2, 3, 4)  # Two bad contours so far apart spoil each other's test, and are tried together
FAR = 0.1  # Of the mean radius: a contour that is off by less does little harm
CANDIDATE_CLEARLY = 4.0  # Times what its neighbours are off without it, that one must be off
# With fewer nothing is left to compare with. Of three the middle one may well be the widest; one
# that is narrower than both others, or aside, is a candidate.
CANDIDATE_LEAST_SLICES = 4
ALIKE = 0.05  # Root mean square difference of two shapes of radius 1 that are alike


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
        0.0 if same_steps(loop.curve.parameters) else loop.perimeter / len(loop.points)
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


class InconsistentContours(NamedTuple):
    """What the test found."""

    bad: Bools  # (M,): which contours to leave out
    off: Floats  # (M,): by how much each of these is off, root mean square, m; 0 for the others


def inconsistent_contours(
    heights: Floats, grid: Floats, uncertain: Floats | None = None
) -> InconsistentContours:
    """Find contours that contradict their neighbours.

    Of contours (M, K, 2) at rising heights (M,), matched place by place, m; a contour that is off
    by no more than its `uncertain` (M,), m, is none. What a single contour
    has touched, a groove narrower than twice the spacing, is no different from a contour gone
    wrong. The lowest and the highest contour are never bad: beyond them nothing tells how the
    object rounds off. None is bad where there are fewer than 9, or so many bad, more than one in
    five or so, that nothing tells how good ones fare.
    """
    count = len(heights)
    bad = np.zeros(count, dtype=bool)
    if count < LEAST_SLICES:
        return InconsistentContours(bad, np.zeros(count))
    weights = neighbour_weights(heights)
    spread = np.sqrt(1.0 + (weights**2).sum(axis=1))
    # What moves predictions (M, M), and by how much they are off (M, 2 K), in one's noise.
    shares = (weights - np.eye(count)) / spread[:, None]
    errors = shares @ grid.reshape(count, -1)
    usual = float(np.quantile(_rms(errors), USUAL))
    size = float(_rms((grid - grid.mean(axis=1, keepdims=True)).reshape(count, -1)).mean())
    least = max(CLEARLY * usual, LEAST_OFF * size)
    allowed = np.full(count, least) if uncertain is None else np.maximum(uncertain, least)
    while found := _worst(shares, errors, bad, allowed):
        bad[list(found)] = True
    off = np.zeros(count)
    if bad.any():
        off[bad] = _rms(_solve(shares[:, bad], errors))
    return InconsistentContours(bad, off)


def _worst(shares: Floats, errors: Floats, bad: Bools, least: Floats) -> tuple[int, ...]:
    """The contour, or else the two, that are bad besides those already found; none if no other."""
    count = len(errors)
    removed = np.linalg.qr(shares[:, bad])[0]
    columns = shares - removed @ (removed.T @ shares)
    errors = errors - removed @ (removed.T @ errors)
    beside = bad | np.roll(bad, 1) | np.roll(bad, -1)
    looked_at = ~beside & (_rms(errors) > OWN * least)
    candidates = [row for row in range(1, count - 1) if looked_at[row]]
    singles = [(row,) for row in candidates]
    pairs = [(row, row + apart) for apart in PAIRED for row in candidates]
    pairs = [pair for pair in pairs if pair[1] in candidates]
    for sets in (singles, pairs):
        gains = [_gain(shares, columns, errors, bad, rows, least) for rows in sets]
        if gains and max(gains) > 0.0:
            return sets[int(np.argmax(gains))]
    return ()


def _gain(
    shares: Floats,
    columns: Floats,
    errors: Floats,
    bad: Bools,
    rows: tuple[int, ...],
    least: Floats,
) -> float:
    """Squared error that goes away if these contours are put right; 0 if they are not bad."""
    free = columns[:, rows]
    off = _solve(free, errors)
    if (_rms(off) <= least[list(rows)]).any():
        return 0.0
    left = errors - free @ off
    for row, one in zip(rows, off, strict=True):
        near = bad[max(row - PAIRED[-1], 0) : row + PAIRED[-1] + 1].any()
        allowed = UNEXPLAINED_NEAR if near or len(rows) > 1 else UNEXPLAINED
        allowed = UNEXPLAINED_END if row in (1, len(errors) - 2) else allowed
        share = shares[:, row]  # What is left along the way in which this contour is off
        seen = np.flatnonzero(share)
        rest = left[seen] @ one / (one @ one)
        if (rest**2).sum() > allowed * ((rest + share[seen]) ** 2).sum():
            return 0.0
    return float((errors**2).sum() - (left**2).sum())


def _solve(columns: Floats, errors: Floats) -> Floats:
    """Displacements (n, 2 K) of contours under which predictions are least off."""
    return np.asarray(np.linalg.lstsq(columns, errors, rcond=None)[0], np.float64)


def _rms(rows: Floats) -> Floats:
    """Root mean square distance (M,) that rows (M, 2 K) of x and y stand for."""
    return np.asarray(np.sqrt(2.0 * (rows**2).mean(axis=1)))


class FeatureCandidate(NamedTuple):
    """A contour that is used, though it is unlike its neighbours."""

    which: int  # Of the given contours
    height: float  # m
    off: float  # By how much it is unlike what they tell of it, root mean square, m


def neighbour_misfits(heights: Floats, grid: Floats) -> Floats:
    """By how much contours are unlike their neighbours, (M,), m; 0 where they are not clearly so.

    Of contours (M, K, 2) at rising heights (M,), matched place by place, m, one is put away, and
    the others are predicted from each other: where they agree far better than with it, it may have
    gone wrong, or have touched something by itself. The first and the last are candidates only if
    they are wider or farther aside than the others tell: an object may round off beyond them.
    """
    count = len(heights)
    found = np.zeros(count)
    middles = grid.mean(axis=1)
    radii = np.linalg.norm(grid - middles[:, None], axis=2).mean(axis=1)
    radius = float(radii.mean())
    if count < CANDIDATE_LEAST_SLICES:
        if count == CANDIDATE_LEAST_SLICES - 1:
            aside = np.linalg.norm(middles[1] - neighbour_weights(heights)[1] @ middles)
            off = max(float(aside), float(radii[[0, 2]].min() - radii[1]))
            found[1] = off if off > FAR * radius else 0.0
        return found
    missed = _rms_length(np.tensordot(neighbour_weights(heights), grid, 1) - grid)
    for row in np.flatnonzero(missed > FAR * radius):
        others = np.arange(count) != row
        rest = np.tensordot(neighbour_weights(heights[others]), grid[others], 1) - grid[others]
        usual = float(_rms_length(rest[1:-1]).max())
        if row in (0, count - 1):
            missed[row] = _beyond(heights, middles, radii, int(row))
        if missed[row] > max(CANDIDATE_CLEARLY * usual, FAR * radius):
            found[row] = missed[row]
    # What is next to a wrong contour is unlike it as well: only the worst of neighbours counts.
    for row in np.argsort(-found):
        if found[row] > 0.0:
            beside = found[max(row - 1, 0) : row + 2]
            beside[beside < found[row]] = 0.0
    return found


def _beyond(heights: Floats, middles: Floats, radii: Floats, row: int) -> float:
    """How much wider, or farther aside, the first or last contour is than the others tell."""
    near = np.arange(1, 4) if row == 0 else np.arange(row - 3, row)
    radius, *place = (
        Polynomial.fit(heights[near], values[near], 1)(heights[row])
        for values in (radii, *middles.T)
    )
    wider = float(radii[row] - max(radius, radii[near].max()))
    return max(wider, float(np.linalg.norm(middles[row] - np.array(place))), 0.0)


def look_like_features(grid: Floats, star: Bools, bad: Bools) -> Bools:
    """Which bad contours (M,) look as if the object were like that: its shape in another size."""
    away = grid - grid.mean(axis=1, keepdims=True)
    shapes = away / np.sqrt((away**2).sum(axis=2).mean(axis=1))[:, None, None]
    good = np.flatnonzero(~bad)
    found = np.zeros(len(grid), np.bool_)
    for row in np.flatnonzero(bad & star):
        near = good[np.argmin(np.abs(good - row))]
        found[row] = float(_rms_length((shapes[row] - shapes[near])[None])[0]) < ALIKE
    return found


def _rms_length(apart: Floats) -> Floats:
    """Root mean square length (M,) of differences (M, K, 2)."""
    return np.asarray(np.sqrt((apart**2).sum(axis=2).mean(axis=1)))
