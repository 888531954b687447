"""Single points of contours that are outliers.

An outlier deviates from its neighbours along the contour where adjacent contours do not: a corner,
a groove or a lobe that they have as well belongs to the object.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from palpate.core.arrays import PROBABLE_ERROR, Bools, Floats
from palpate.core.rebuild.contours.curves import ContourCurve, chord_places, has_even_steps
from palpate.core.rebuild.contours.neighbours import lagrange_weights

# Seven consecutive points predict the middle one: five lines through pairs of them are extended to
# it, and a cubic passes two on each side.
N_EACH_SIDE = 3
LINE_PAIRS = ((2, 4), (1, 5), (0, 6), (2, 1), (4, 5))
CUBIC_POINTS = (1, 2, 4, 5)


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlierSettings:
    """A single point is an outlier if its deviation exceeds the sum of the first three."""

    min_sigmas: float = 4.5  # standard deviations of the points' noise
    shared_fraction: float = 0.3  # of the largest deviation of adjacent contours there
    min_deviation: float = 5e-4  # fraction of the perimeter: less does little harm
    max_share: float = 0.15  # of a contour's points; beyond it the contour itself has this shape
    min_points: int = 12  # contours of fewer points are not judged
    n_rounds: int = 5  # of search: the largest outlier hides those beside it
    uneven_slack: float = 0.3  # fraction of the mean step, added along uneven contours
    n_repair_sweeps: int = 3  # moves of outliers to predicted places; more settle adjacent ones
    n_samples: int = 128  # places around at which contours are compared
    n_contours: int = 4  # nearest in the stack, with which each is compared
    window: float = 1.5  # [steps] on either side, within which a corner counts as the same


class PointOutliers(NamedTuple):
    """Outliers of each curve, and its points without them."""

    masks: tuple[Bools, ...]  # (n,): whether each point is an outlier
    mended: tuple[Floats, ...]  # (n, 2): outliers are moved to where they are predicted


class _Points(NamedTuple):
    """The points of all curves, concatenated."""

    points: Floats  # (N, 2), as they were given
    owner: NDArray[np.intp]  # number of each point's curve
    turns: Floats  # (N,): parameters on the curves
    near: NDArray[np.intp]  # (N, 7): each point with three neighbours on either side
    ahead: Floats  # (N, 7) [turns]: parameters of `near` less that of the point
    judged: Bools  # whether the curve has enough points
    slack: Floats  # (N,): mean step along the contour, where steps are uneven; else 0


def point_outliers(
    loops: tuple[ContourCurve, ...], places: Floats, settings: OutlierSettings = OutlierSettings()
) -> PointOutliers:
    """Find single points that deviate from M contours; those that are off in height are known.

    `places` (M, K) are parameters of the curves that correspond, rising, over less than one turn.
    """
    known = np.concatenate([loop.off_height for loop in loops])
    joined = _concatenated(loops, settings.min_points)
    min_off = settings.min_deviation * np.array([loop.perimeter for loop in loops])[joined.owner]
    off = neighbour_deviation(joined.points[joined.near], joined.ahead).off
    alone = _excess(off, _allowed(off, np.zeros(len(off)), min_off, joined, settings))
    if not known.any() and not (alone > 1.0).any():
        untouched = tuple(loop.points for loop in loops)
        return PointOutliers(
            tuple(np.zeros(len(points), np.bool_) for points in untouched), untouched
        )
    shared = _shared_deviation(loops, places, joined, settings)
    outlier, mended = _candidates(loops, joined, shared, min_off, known, settings)
    still_off = _is_off_beside_mended(joined, shared, mended, min_off, settings)
    outlier &= (still_off & ~shared.by_half(outlier, joined.owner)) | known
    steps = np.array([1.0 / len(loop.points) for loop in loops])
    shares = np.bincount(joined.owner, outlier, len(loops)) * steps
    outlier &= (shares <= settings.max_share)[joined.owner]
    mended = np.where(outlier[:, None], mended, joined.points)
    for _ in range(settings.n_repair_sweeps if outlier.any() else 0):
        deviation = neighbour_deviation(mended[joined.near], joined.ahead)
        mended[outlier] = deviation.predicted(shared.bend)[outlier]
    ends = np.cumsum([len(loop.points) for loop in loops])[:-1]
    return PointOutliers(tuple(np.split(outlier, ends)), tuple(np.split(mended, ends)))


def _concatenated(loops: tuple[ContourCurve, ...], min_points: int) -> _Points:
    counts = np.array([len(loop.points) for loop in loops])
    owner = np.repeat(np.arange(len(loops)), counts)
    begin = (np.cumsum(counts) - counts)[owner]
    steps = np.arange(-N_EACH_SIDE, N_EACH_SIDE + 1)
    place = np.arange(counts.sum()) - begin
    near = begin[:, None] + (place[:, None] + steps) % counts[owner][:, None]
    turns = np.concatenate([loop.curve.parameters for loop in loops])
    away = turns[near] - turns[:, None]
    before, after = away[:, :N_EACH_SIDE], away[:, N_EACH_SIDE + 1 :]
    ahead = np.hstack([before - (before > 0.0), 0.0 * away[:, :1], after + (after < 0.0)])
    judged = counts[owner] >= min_points
    ahead = np.where(judged[:, None], ahead, steps)  # few points may be neighbours on both sides
    slack = [
        0.0 if has_even_steps(loop.curve.parameters) else loop.perimeter / len(loop.points)
        for loop in loops
    ]
    points = np.concatenate([loop.as_given for loop in loops])
    return _Points(points, owner, turns, near, ahead, judged, np.array(slack)[owner])


def _candidates(
    loops: tuple[ContourCurve, ...],
    joined: _Points,
    shared: _Shared,
    min_off: Floats,
    known: Bools,
    settings: OutlierSettings,
) -> tuple[Bools, Floats]:
    """Mask (N,) of points that deviate, found from the largest ones on; and the mended points."""
    mended = np.concatenate([loop.points for loop in loops])
    outlier = np.concatenate([loop.outlier for loop in loops])
    for number in range(settings.n_rounds):
        deviation = neighbour_deviation(mended[joined.near], joined.ahead)
        off = deviation.off - shared.off
        excess = _excess(off, _allowed(off, shared.nearby, min_off, joined, settings))
        new = (excess > 1.0) & (excess >= excess[joined.near].max(axis=1)) & ~outlier
        if number == 0 and (known & ~outlier).any():
            new = known & ~outlier
        if not new.any():
            break
        outlier |= new
        mended[new] = deviation.predicted(shared.bend)[new]
    return outlier, mended


def _is_off_beside_mended(
    joined: _Points,
    shared: _Shared,
    mended: Floats,
    min_off: Floats,
    settings: OutlierSettings,
) -> Bools:
    """Points (N,) that still deviate, as they were given, from their mended neighbours."""
    beside = mended[joined.near]
    off = neighbour_deviation(beside, joined.ahead).off - shared.off
    allowed = _allowed(off, shared.nearby, min_off, joined, settings)
    allowed[:, 0] += settings.uneven_slack * joined.slack
    beside[:, N_EACH_SIDE] = joined.points
    off = neighbour_deviation(beside, joined.ahead).off - shared.off
    return np.asarray(_excess(off, allowed) > 1.0)


class _Shared(NamedTuple):
    """Deviations of the contours adjacent to each point's, at the same place around."""

    off: Floats  # (N, 2): median deviation
    bend: Floats  # (N, 2): median deviation from the cubic
    nearby: Floats  # (N,): median of the largest deviation within the window
    adjacent: NDArray[np.intp]  # (M, k): contours adjacent to each
    column: NDArray[np.intp]  # (N,): sample at each point's place around
    n_samples: int
    window: int  # [samples] on either side that count as the same place

    def by_half(self, outlier: Bools, owner: NDArray[np.intp]) -> Bools:
        """Points (N,) at whose place half of the adjacent contours have outliers, too."""
        marked = np.zeros((len(self.adjacent), self.n_samples))
        marked[owner[outlier], self.column[outlier]] = 1.0
        marked = _largest_near(marked, self.window)
        if not self.adjacent.shape[1]:
            return np.zeros(len(owner), np.bool_)
        return np.asarray((marked[self.adjacent].mean(axis=1) >= 0.5)[owner, self.column])


def _shared_deviation(
    loops: tuple[ContourCurve, ...], places: Floats, joined: _Points, settings: OutlierSettings
) -> _Shared:
    count, n_samples = len(loops), settings.n_samples
    steps = np.array([1.0 / len(loop.points) for loop in loops])
    sizes = np.array([loop.perimeter for loop in loops])
    around = np.linspace(0.0, places.shape[1], n_samples, endpoint=False)
    wound = np.column_stack([places, places[:, :1] + 1.0])
    turns = np.stack([np.interp(around, np.arange(wound.shape[1]), line) for line in wound])
    off, bend = (part / sizes[:, None, None] for part in _sampled_deviation(loops, turns, steps))
    window = int(np.ceil(settings.window * n_samples * float(np.median(steps))))
    largest = _largest_near(np.hypot(off[..., 0], off[..., 1]), window)
    if count == 1:
        zero, column = 0.0 * joined.points, np.zeros(len(joined.points), np.intp)
        adjacent = np.zeros((1, 0), np.intp)
        return _Shared(zero, zero, 0.0 * joined.turns, adjacent, column, n_samples, window)
    away = np.abs(np.subtract.outer(np.arange(count), np.arange(count))).astype(np.float64)
    np.fill_diagonal(away, np.inf)
    order = np.argsort(away, axis=1, kind="stable")
    adjacent = order[:, : min(settings.n_contours, count - 1)]
    off, bend = (np.median(part[adjacent], axis=1) * sizes[:, None, None] for part in (off, bend))
    nearby = np.median(largest[adjacent], axis=1) * sizes[:, None]
    column = _sample_of(joined, turns)
    at = joined.owner, column
    return _Shared(off[at], bend[at], nearby[at], adjacent, column, n_samples, window)


def _sampled_deviation(
    loops: tuple[ContourCurve, ...], turns: Floats, steps: Floats
) -> tuple[Floats, Floats]:
    """Deviations of curves (M, s, 2) at turns (M, s) from neighbours and cubics at even steps."""
    stencil = np.arange(-N_EACH_SIDE, N_EACH_SIDE + 1)
    taps = (turns[..., None] + steps[:, None, None] * stencil).reshape(len(loops), -1)
    fine = np.stack([loop.fine for loop in loops])
    beside = chord_places(fine, taps).reshape(-1, len(stencil), 2)
    even = np.broadcast_to(stencil.astype(np.float64), beside.shape[:2])
    deviation = neighbour_deviation(beside, even)
    return deviation.off.reshape(*turns.shape, 2), deviation.bend.reshape(*turns.shape, 2)


def _sample_of(joined: _Points, turns: Floats) -> NDArray[np.intp]:
    """The sample (N,) nearest to each point, of samples at turns (M, s) on the curves."""
    n_samples = turns.shape[1]
    column = np.empty(len(joined.turns), np.intp)
    for number, begins in enumerate(turns):
        own = joined.owner == number
        share = np.interp(
            np.mod(joined.turns[own] - begins[0], 1.0),
            np.append(begins - begins[0], 1.0),
            np.arange(n_samples + 1),
        )
        column[own] = np.rint(share).astype(np.intp) % n_samples
    return column


def _largest_near(values: Floats, window: int) -> Floats:
    """Largest values within `window` columns on either side, of closed rows (m, n)."""
    wound = np.pad(values, ((0, 0), (window, window)), mode="wrap")
    return np.asarray(sliding_window_view(wound, 2 * window + 1, axis=1).max(axis=2))


def _allowed(
    off: Floats, shared: Floats, min_off: Floats, joined: _Points, settings: OutlierSettings
) -> Floats:
    """Largest deviations of good points, along and across (N, 2), from all deviations (N, 2)."""
    size = np.abs(off)
    ends = np.flatnonzero(np.diff(joined.owner)) + 1
    medians = np.array([np.median(part, axis=0) for part in np.split(size, ends)])
    scale = medians[joined.owner]
    if joined.judged.any():
        scale = np.maximum(scale, np.median(size[joined.judged], axis=0))
    floor = settings.shared_fraction * shared + min_off
    allowed: Floats = settings.min_sigmas / PROBABLE_ERROR * scale + floor[:, None]
    return np.where(joined.judged[:, None], allowed, np.inf)


def neighbour_deviation(beside: Floats, ahead: Floats) -> NeighbourDeviation:
    """Deviations of points from the predictions of their neighbours.

    `beside` (N, 7, 2) is each point in the middle of its neighbours, which are `ahead` (N, 7) of
    it, in turns, rising. The median of five predictions counts: a single wrong neighbour spoils at
    most two of them.
    """
    point = beside[:, N_EACH_SIDE]
    beside = beside - point[:, None]
    along = beside[:, N_EACH_SIDE + 2] - beside[:, N_EACH_SIDE - 2]
    length = np.hypot(along[:, 0], along[:, 1])
    along = along / np.where(length > 0.0, length, 1.0)[:, None]
    frame = np.stack([along, np.stack([along[:, 1], -along[:, 0]], axis=1)], axis=1)
    in_frame = np.einsum("nij,nkj->ink", frame, beside)
    first, second = np.array(LINE_PAIRS).T
    share = ahead[:, first] / (ahead[:, first] - ahead[:, second])
    lines = (axis[:, first] + share * (axis[:, second] - axis[:, first]) for axis in in_frame)
    off = [-np.sort(predictions, axis=1)[:, len(LINE_PAIRS) // 2] for predictions in lines]
    weights = lagrange_weights(ahead[:, CUBIC_POINTS])
    cubic = np.einsum("nk,nkd->nd", weights, beside[:, CUBIC_POINTS])
    bend = -np.einsum("nij,nj->ni", frame, cubic)
    return NeighbourDeviation(np.stack(off, axis=1), bend, frame, point)


def _excess(off: Floats, allowed: Floats) -> Floats:
    """Deviations over the allowed ones, the larger of both axes, (N,)."""
    return np.asarray((np.abs(off) / allowed).max(axis=1))


class NeighbourDeviation(NamedTuple):
    """Deviations of points from the predictions of their neighbours."""

    off: Floats  # (N, 2): along and across, by the median of several predictions
    bend: Floats  # (N, 2): from the cubic through two neighbours on either side
    frame: Floats  # (N, 2, 2): unit vectors along and across
    points: Floats  # (N, 2)

    def predicted(self, bend: Floats) -> Floats:
        """Where the points (N, 2) are, if they deviate from the cubic by `bend` (N, 2)."""
        return np.asarray(self.points + np.einsum("ni,nij->nj", bend - self.bend, self.frame))
