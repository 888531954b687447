"""Contours of any origin as a stack of closed curves, upwards, and their corresponding places.

Correspondences (Fung, 1999, 4.2) are found by several methods: least twist (circular correlation by
Fourier transform), signatures (distance from the middle along the contour, followed through the
stack by dynamic programming, Bellman, 1957), a ray along x, and azimuths. The least twist of a
nearly round contour does not follow its lobes, for its circle outweighs them; signatures do.
Leave-one-out prediction of slices selects the method.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.core import geometry
from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.rebuild.contours.curves import (
    ContourCurve,
    DroppedContour,
    DropReason,
    chord_places,
    curve_places,
    drop_reasons,
)
from palpate.core.rebuild.contours.neighbours import neighbour_weights
from palpate.core.splines import ClosedCurve
from palpate.reprs import readable

# Fields of `Slices` that are arrays with a row for each slice.
SLICE_ARRAYS = (
    *("heights", "middles", "perimeter", "fine", "star", "self_intersecting"),
    *("tilt", "tilted", "rows"),
)
CorrespondenceMethod = Literal["twist", "signature", "ray", "azimuth"]  # the last for stars only
MIN_PLACES = 3  # around a slice


@dataclass(frozen=True, slots=True, kw_only=True)
class StackSettings:
    """When two contours are at one height, repeat each other, or are not level."""

    same_height: float = 1e-3  # fraction of the mean spacing of the contours
    height_rounding: float = 1e-9  # fraction of the perimeter: heights nearer differ by rounding
    height_sigmas: float = 3.0  # standard errors by which two equal heights may differ
    max_repeat_distance: float = 0.02  # fraction of the perimeter, root mean square, of repetitions
    repeat_stride: int = 8  # every 8th place of a fine curve is compared with the other curve
    max_tilt: float = 0.25  # fraction of the distance to the nearer slice; more is not level
    max_tilt_alone: float = 0.02  # fraction of the perimeter, where there is a single slice


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchSettings:
    """How methods of correspondence are compared, and how signatures follow lobes.

    Costs are in units of the correlation of two signatures.
    """

    max_score_ratio: float = 0.85  # over the score of least twist, below which a method replaces it
    min_inner_slices: int = 6  # in larger stacks the two slices at either end are not scored
    min_distance: float = 1e-6  # fraction of the perimeter: smaller distances count as equal
    n_scored: int = 64  # places around at which scores are taken; all if there are fewer
    max_lobe_shift: float = 0.17  # [turns] from the least twist, at which lobes are sought
    min_relief: float = 0.02  # of lobes: standard deviation of a signature over its mean
    min_correlation: float = 0.5  # of two signatures; else the least twist is kept
    step_change_cost: float = 15.0  # [1/turn^2] of a change of the step between pairs
    twist_cost: float = 1.5  # [1/turn^2] of a departure from the least twist


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Slices:
    """Closed curves at rising heights: M of them, at least one."""

    heights: Floats  # (M,) [m], rising: mean z of each contour's points
    middles: Floats  # (M, 2) [m]: centroids of their areas
    perimeter: Floats  # (M,) [m]
    fine: Floats  # (M, 512, 2) [m]: each curve at even steps of its parameter
    star: Bools  # (M,): whether each ray from the centroid meets the curve once
    self_intersecting: Bools  # (M,)
    tilt: Floats  # (M,) [m]: root mean square rise and fall of z around the contour, without noise
    tilted: Bools  # (M,): whether the tilt is too large: see `StackSettings`
    loops: tuple[ContourCurve, ...]  # the contours of the slices
    rows: Ints  # (M,): number of each slice's contour as it was given
    dropped: tuple[DroppedContour, ...]  # contours that are not used, and why

    @property
    def curves(self) -> tuple[ClosedCurve, ...]:
        """The curves of the slices in the plane, counter-clockwise."""
        return tuple(loop.curve for loop in self.loops)

    @property
    def points(self) -> tuple[Floats, ...]:
        """Points (n, 2) [m] of each slice, in the order of its curve."""
        return tuple(loop.points for loop in self.loops)

    def without(
        self,
        bad: Bools,
        why: DropReason,
        off: Floats | None = None,
        may_be_feature: Bools | None = None,
    ) -> Slices:
        """The slices without the bad ones, (M,), which are dropped for a reason.

        `off` and `may_be_feature` (M,) are stored in each `DroppedContour`. Raises ValueError if
        `bad` has another length, or no slice is left.
        """
        if bad.shape != self.heights.shape or bad.all():
            raise ValueError(
                f"bad must leave at least one of {len(self.heights)} slices, got {bad.tolist()}"
            )
        stay = np.flatnonzero(~bad)
        off = np.zeros(len(bad)) if off is None else off
        may_be_feature = np.zeros(len(bad), np.bool_) if may_be_feature is None else may_be_feature
        columns = (self.rows, self.heights, off, may_be_feature)
        removed = [
            DroppedContour(which, why, *figures)
            for which, *figures in zip(*(column[bad].tolist() for column in columns), strict=True)
        ]
        rows = {name: getattr(self, name)[stay] for name in SLICE_ARRAYS}
        rows |= {"dropped": tuple(sorted([*self.dropped, *removed]))}
        return replace(self, loops=tuple(self.loops[row] for row in stay), **rows)


def stack_curves(
    contours: Sequence[ContourCurve | DroppedContour], settings: StackSettings = StackSettings()
) -> Slices:
    """Sort curves by height; ValueError if there is none.

    Of two contours at one height one is kept: the better of two that repeat each other or cross,
    the outer of two nested ones, the larger of two side by side.
    """
    dropped = [contour for contour in contours if isinstance(contour, DroppedContour)]
    loops = [contour for contour in contours if isinstance(contour, ContourCurve)]
    if not loops:
        reasons = drop_reasons(dropped) or "none"
        raise ValueError(
            f"contours must hold at least one of 3 points around an area, got {reasons}"
        )
    # Ties are decided by properties of the contours, so that the given order has no effect.
    loops.sort(
        key=lambda loop: (loop.height, loop.perimeter, len(loop.points), float(loop.fine[0, 0]))
    )
    loops, duplicates = _one_at_each_height(loops, settings)
    return restack(loops, tuple(sorted([*dropped, *duplicates])), settings)


def _one_at_each_height(
    loops: list[ContourCurve], settings: StackSettings
) -> tuple[list[ContourCurve], list[DroppedContour]]:
    """Rising curves, no two at one height, and the ones that were dropped for that."""
    spacing = (loops[-1].height - loops[0].height) / max(len(loops) - 1, 1)
    kept, dropped = loops[:1], []
    for loop in loops[1:]:
        last = kept[-1]
        near = settings.height_sigmas * float(np.hypot(last.error, loop.error))
        near += settings.same_height * spacing
        if loop.height - last.height > max(near, settings.height_rounding * loop.perimeter):
            kept.append(loop)
            continue
        worse, why = duplicate_of_two(last, loop, settings)
        dropped.append(DroppedContour(worse.which, why, worse.height))
        if worse is last:
            kept[-1] = loop
    return kept, dropped


def duplicate_of_two(
    first: ContourCurve, second: ContourCurve, settings: StackSettings
) -> tuple[ContourCurve, DropReason]:
    """Which of two curves at one height to drop, and why."""

    def quality(loop: ContourCurve) -> tuple[bool, bool, int]:
        flags = loop.curve.flags
        return not flags.self_intersecting, not flags.uneven, len(loop.points)

    smaller, larger = sorted((first, second), key=lambda loop: abs(geometry.signed_area(loop.fine)))
    worse = min((second, first), key=quality)
    off = geometry.edge_distance(larger.fine, smaller.fine[:: settings.repeat_stride])
    if float(np.sqrt((off**2).mean())) <= settings.max_repeat_distance * larger.perimeter:
        return worse, "repeats another at its height"
    inside = geometry.winding_number(larger.fine, smaller.fine) != 0
    if inside.all():
        return smaller, "inside another at its height"
    if inside.any() or (geometry.winding_number(smaller.fine, larger.fine) != 0).any():
        return worse, "crosses another at its height"
    return smaller, "beside another at its height"


def restack(
    loops: Sequence[ContourCurve],
    dropped: tuple[DroppedContour, ...],
    settings: StackSettings = StackSettings(),
) -> Slices:
    """The stack of curves at rising heights; `dropped` are the contours that are not used."""
    fine = np.stack([loop.fine for loop in loops])
    middles = geometry.area_centroids(fine)
    heights = np.array([loop.height for loop in loops])
    perimeter = np.array([loop.perimeter for loop in loops])
    tilt = np.array([loop.tilt for loop in loops])
    allowed = settings.max_tilt_alone * perimeter
    if len(loops) > 1:
        gaps = np.diff(heights)
        allowed = settings.max_tilt * np.minimum(np.append(gaps, np.inf), np.append(np.inf, gaps))
    return Slices(
        heights=heights,
        middles=middles,
        perimeter=perimeter,
        fine=fine,
        star=np.array([loop.star for loop in loops]),
        self_intersecting=np.array([loop.curve.flags.self_intersecting for loop in loops]),
        tilt=tilt,
        tilted=tilt > allowed,
        loops=tuple(loops),
        rows=np.array([loop.which for loop in loops], np.int32),
        dropped=dropped,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Correspondence:
    """Corresponding places of M slices, K around each."""

    grid: Floats  # (M, K, 2) [m]: place j of each slice corresponds to place j of all slices
    places: Floats  # (M, K) [turns]: parameters of these places on the curves; they may exceed 1
    turns: Floats  # (M,): parameters of the first places, from 0 to 1
    method: CorrespondenceMethod
    # Score [m] of each method that was tried: distance between a slice's curve and the places that
    # its neighbours predict; its mean around, then the geometric mean over slices, so that a step
    # of the object, which no method predicts, does not outweigh the other slices. Empty with fewer
    # than 3 slices.
    scores: dict[CorrespondenceMethod, float]


def match_slices(
    slices: Slices,
    count: int,
    method: Literal["auto"] | CorrespondenceMethod = "auto",
    settings: MatchSettings = MatchSettings(),
) -> Correspondence:
    """Match `count` places around each slice, at least 3, with those of the other slices.

    Methods: "twist": each slice begins where the surface between it and the next twists least.
    "signature": it begins so that lobes and corners follow each other. "ray": it begins at the ray
    along x from its middle. In all three, equal parameters of the curves correspond. "azimuth":
    equal azimuths about the middles correspond (Fung, 1999, 4.2, step 5); approximately so where a
    slice is not star-shaped (`azimuth_match`). "auto" leaves each slice out and predicts it from
    its neighbours: it is the least twist, unless another method predicts clearly better; azimuths
    are tried only if all slices are star-shaped. Raises ValueError if the count is below 3 or the
    method unknown.
    """
    if count < MIN_PLACES:
        raise ValueError(f"count must be at least {MIN_PLACES}, got {count}")
    if method != "auto" and method not in get_args(CorrespondenceMethod):
        words = ", ".join(get_args(CorrespondenceMethod))
        raise ValueError(f"method must be auto or one of {words}, got {method!r}")
    methods: tuple[CorrespondenceMethod, ...] = get_args(CorrespondenceMethod)
    if method != "auto":
        methods = (method,)
    elif not slices.star.all():
        methods = methods[:-1]
    places = _places(slices, count, methods, settings)
    scores: dict[CorrespondenceMethod, float] = {}
    best = 0
    if len(slices.heights) > 2:  # so that a slice lies between others
        values = _scores(slices, places, settings)
        scores = dict(zip(methods, values.tolist(), strict=True))
        lowest = int(values.argmin())
        best = lowest if values[lowest] < settings.max_score_ratio * values[0] else 0
    grid, turns = curve_places(slices.curves, places[best]), np.mod(places[best, :, 0], 1.0)
    return Correspondence(grid, places[best], turns, methods[best], scores)


def _places(
    slices: Slices,
    count: int,
    methods: tuple[CorrespondenceMethod, ...],
    settings: MatchSettings,
) -> Floats:
    """Parameters (c, M, count) on the curves that correspond under each of c methods."""
    shapes = slices.fine - slices.middles[:, None]
    rays = start_ray(shapes)
    steps = minimum_twist(shapes)
    middle = len(shapes) // 2  # from where steps are summed: an error of a step moves few slices
    around = np.arange(count) / count

    def stepped(steps: Floats) -> Floats:
        return begin_turns(steps, middle, rays[middle])[:, None] + around

    turns_by: dict[CorrespondenceMethod, Callable[[], Floats]] = {
        "twist": lambda: stepped(steps),
        "signature": lambda: stepped(follow_signatures(shapes, steps, settings)),
        "ray": lambda: rays[:, None] + around,
        "azimuth": lambda: _azimuth_turns(slices, around),
    }
    return np.stack([turns_by[method]() for method in methods])


def start_ray(shapes: Floats) -> Floats:
    """Turns (M,) from 0 to 1 at which curves cross the ray along x upwards, farthest out.

    Curves are closed and counter-clockwise (M, n, 2), each about its own middle, at even steps; a
    curve that does not cross the ray begins at its largest x.
    """
    count = shapes.shape[1]
    following = np.roll(shapes, -1, axis=1)
    x, y = shapes[..., 0], shapes[..., 1]
    up = (y <= 0.0) & (following[..., 1] > 0.0)
    share = np.divide(-y, following[..., 1] - y, out=np.zeros_like(y), where=up)
    meets = x + share * (following[..., 0] - x)
    meets = np.where(up & (meets > 0.0), meets, -np.inf)
    rows, place = np.arange(len(shapes)), meets.argmax(axis=1)
    turns = np.mod((place + share[rows, place]) / count, 1.0)
    crossed = np.isfinite(meets[rows, place])
    return np.asarray(np.where(crossed, turns, x.argmax(axis=1) / count))


def minimum_twist(shapes: Floats) -> Floats:
    """Steps (M - 1,) [turns] to the next curve's start, by the largest circular correlation."""
    waves = np.fft.fft(shapes[..., 0] + 1j * shapes[..., 1], axis=1)
    # The sum over both coordinates is the real part of one complex product.
    steps = circular_peak(np.fft.ifft(np.conj(waves[:-1]) * waves[1:], axis=1).real)
    return steps - np.round(steps)


def _azimuth_turns(slices: Slices, around: Floats) -> Floats:
    """Parameters (M, count) of the curves at azimuths (count,) [turns] about their middles."""
    turns = []
    for curve, middle, star in zip(slices.fine, slices.middles, slices.star, strict=True):
        even = np.linspace(0.0, 1.0, len(curve) + 1)
        if star:
            away = curve - middle
            azimuths = np.unwrap(np.arctan2(away[:, 1], away[:, 0])) / (2.0 * np.pi)
            ahead = np.mod(around - azimuths[0], 1.0)
            turns.append(np.interp(ahead, np.append(azimuths - azimuths[0], 1.0), even))
            continue
        shares = geometry.azimuth_match(curve, middle, 2.0 * np.pi * around).turns
        lengths = np.linalg.norm(np.diff(np.vstack([curve, curve[:1]]), axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
        turns.append(np.interp(shares, ends, even))
    return np.unwrap(np.stack(turns), period=1.0, axis=1)


def begin_turns(steps: Floats, from_slice: int, begin: float) -> Floats:
    """Turns (M,) from 0 to 1 at which curves begin, from steps (M - 1,) and one curve's start."""
    turns = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(np.mod(turns - turns[from_slice] + begin, 1.0))


def follow_signatures(shapes: Floats, steps: Floats, settings: MatchSettings) -> Floats:
    """Steps (M - 1,) [turns] with which the signatures of adjacent curves agree.

    Lobes look alike, so that a single pair of curves may agree equally well one lobe further. All
    steps are chosen together: the sum of correlations less costs is largest (Bellman, 1957).
    """
    if not len(steps):
        return steps
    distance = np.linalg.norm(shapes, axis=2)
    mean = distance.mean(axis=1)
    relief = distance - mean[:, None]
    lengths = np.linalg.norm(relief, axis=1)
    count = shapes.shape[1]
    waves = np.fft.fft(relief, axis=1)
    turned = np.exp(2j * np.pi * np.fft.fftfreq(count, 1.0 / count) * steps[:, None])
    sizes = lengths[:-1] * lengths[1:]
    scale = np.where(sizes > 0.0, sizes, 1.0)
    products = np.conj(waves[:-1]) * waves[1:] * turned
    correlations = np.fft.ifft(products, axis=1).real / scale[:, None]
    max_shift = int(settings.max_lobe_shift * count)
    shifts = np.arange(-max_shift, max_shift + 1)
    near = correlations[:, shifts % count]
    has_lobes = lengths > settings.min_relief * mean * np.sqrt(count)
    followed = has_lobes[:-1] & has_lobes[1:] & (near.max(axis=1) > settings.min_correlation)
    gain = np.where(followed[:, None], near, 0.0) - settings.twist_cost * (shifts / count) ** 2
    best = _best_path(gain, shifts / count, settings.step_change_cost)
    return steps + np.where(
        followed, circular_peak(correlations, shifts[best]), shifts[best] / count
    )


def _best_path(gain: Floats, shifts: Floats, step_change_cost: float) -> NDArray[np.intp]:
    """The shift (m,) of each pair, as a column of its gains (m, k) with `shifts` (k,) [turns]."""
    change = step_change_cost * (shifts[:, None] - shifts) ** 2
    total = gain[0]
    back = np.zeros(gain.shape, np.intp)
    for pair in range(1, len(gain)):
        reached = total - change
        back[pair] = reached.argmax(axis=1)
        total = gain[pair] + reached.max(axis=1)
    path = np.zeros(len(gain), np.intp)
    path[-1] = total.argmax()
    for pair in range(len(gain) - 1, 0, -1):
        path[pair - 1] = back[pair, path[pair]]
    return path


def circular_peak(values: Floats, top: NDArray[np.intp] | None = None) -> Floats:
    """Places (m,) [turns] of peaks of functions at even steps (m, n), by parabolas at `top`."""
    count = values.shape[1]
    top = values.argmax(axis=1) if top is None else top
    rows = np.arange(len(values))
    before, here, after = (values[rows, (top + step) % count] for step in (-1, 0, 1))
    bend = 2.0 * here - before - after
    step = np.divide(0.5 * (after - before), bend, out=np.zeros_like(here), where=bend > 0.0)
    return np.asarray((top + np.clip(step, -0.5, 0.5)) / count)


def _scores(slices: Slices, places: Floats, settings: MatchSettings) -> Floats:
    """Scores (c,) [m] of correspondences (c, M, count), as in `Correspondence.scores`."""
    stride = max(places.shape[2] // settings.n_scored, 1)
    grids = chord_places(slices.fine, places[:, :, ::stride])
    margin = 2 if len(slices.heights) >= settings.min_inner_slices else 1
    inner = slice(margin, -margin)
    predicted = np.einsum("im,cmkd->cikd", neighbour_weights(slices.heights)[inner], grids)
    distance = slice_distance(slices.fine[inner], predicted).mean(axis=2)
    min_distance = settings.min_distance * slices.perimeter[inner]
    return np.asarray(np.exp(np.log(np.maximum(distance, min_distance)).mean(axis=1)))


def slice_distance(curves: Floats, points: Floats) -> Floats:
    """Distances (c, M, k) [m] of points (c, M, k, 2) from curves (M, n, 2), by their tangents."""
    middles = curves.mean(axis=1)  # so that the width below does not grow with the object's lean
    curves = curves - middles[:, None]
    points = points - middles[:, None]
    # Slices are raised ten widths apart: the nearest place is then always of the same slice.
    far = 10.0 * max(float(np.abs(curves).max()), float(np.abs(points).max()))
    level = far * np.arange(len(curves), dtype=np.float64)

    def raised(plane: Floats) -> Floats:
        levels = np.broadcast_to(level[:, None], plane.shape[:-1])
        return np.concatenate([plane, levels[..., None]], axis=-1).reshape(-1, 3)

    tree = geometry.point_tree(raised(curves), balanced=False)
    nearest = tree.query(raised(points))[1].reshape(points.shape[:-1])
    ahead = 0.5 * (np.roll(curves, -1, axis=1) - np.roll(curves, 1, axis=1))
    step = np.linalg.norm(ahead, axis=2)
    along = ahead / np.where(step > 0.0, step, 1.0)[..., None]
    off = points - curves.reshape(-1, 2)[nearest]
    tangent = along.reshape(-1, 2)[nearest]
    across = off[..., 0] * tangent[..., 1] - off[..., 1] * tangent[..., 0]
    aside = np.sqrt(np.maximum((off**2).sum(axis=-1) - across**2, 0.0))
    beyond = aside - 0.5 * step.ravel()[nearest]
    return np.asarray(np.hypot(across, np.maximum(beyond, 0.0)))
