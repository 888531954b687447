"""Contours of any origin as a stack of closed curves, upwards, and which places belong together.

For that (Fung, 1999, 4.2) there are candidates: the least twist (circular correlation by Fourier
transform), signatures (the distance from the middle along the contour, followed through the stack
by dynamic programming, Bellman, 1957: the least twist of a nearly round contour follows nothing,
for the circle in it outweighs its lobes), a ray along x, and azimuths. Leaving slices out decides.
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

SAME_HEIGHT = 1e-3  # Of the mean spacing: contours at heights nearer to each other are one
NOT_APART = 1e-9  # Of a contour's perimeter: heights nearer to each other differ by rounding
CERTAIN = 3.0  # Standard errors of a mean height within which two contours may be at the same one
TILTED = 0.25  # Of the distance to the next slice: a contour that sways farther is not in one plane
TILTED_ALONE = 0.02  # Of the perimeter, where there is no other slice
# Arrays with a row for each slice.
EACH_SLICE = (
    *("heights", "middles", "perimeter", "fine", "star", "self_intersecting"),
    *("tilt", "tilted", "rows"),
)
ALIKE = 0.02  # Of the perimeter: curves that are apart by less, root mean square, are one curve
EACH = 8  # Every so many places of a fine curve are compared with the other one
CorrespondenceMethod = Literal["twist", "signature", "ray", "azimuth"]  # The last is for stars
LEAST_COUNT = 3
CLEARLY = 0.85  # Of the score of the least twist: another method must beat that to be taken
WHOLE = 6  # Slices from which on only those count that have two neighbours on either side
EXACT = 1e-6  # Of the perimeter: distances below are not told apart
SCORED = 64  # Places around, at least, at which methods are compared
LEAST_SLICES = 3  # With fewer no slice lies between others
REACH = 0.17  # Turns on either side of the least twist within which lobes are sought
LEAST_RELIEF = 0.02  # Deviation of a signature, over the mean distance, that tells nothing
LEAST_ALIKE = 0.5  # Correlation of two signatures below which they are not of one shape
CHANGE = 15.0  # Cost of a change of the step between pairs, squared, in turns, in correlation
TWIST = 1.5  # What a departure from the least twist, squared, in turns, costs
# Slices are set apart by so many times the width of everything, so that no place is nearest to a
# point of another slice.
APART = 10.0


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Slices:
    """Closed curves at rising heights: M of them, at least one."""

    heights: Floats  # (M,), rising: the mean z of each contour's points, m
    middles: Floats  # (M, 2): centroids of their areas, m
    perimeter: Floats  # (M,), m
    fine: Floats  # (M, 512, 2): each curve at even steps of its turn, m
    star: Bools  # (M,): each ray from the middle meets the curve once
    self_intersecting: Bools  # (M,): the curve meets itself
    tilt: Floats  # (M,): root mean square rise and fall of z around the contour, noise apart, m
    tilted: Bools  # (M,): by more than a quarter of the distance to the next slice
    loops: tuple[ContourCurve, ...]  # What they are made of
    rows: Ints  # (M,): which of the given contours each one is
    dropped: tuple[DroppedContour, ...]  # The given contours that are not among them, and why

    @property
    def curves(self) -> tuple[ClosedCurve, ...]:
        """In the plane, counter-clockwise."""
        return tuple(loop.curve for loop in self.loops)

    @property
    def points(self) -> tuple[Floats, ...]:
        """(n, 2) each: what the curves were made from, in their order, m."""
        return tuple(loop.points for loop in self.loops)

    def without(
        self,
        bad: Bools,
        why: DropReason,
        off: Floats | None = None,
        may_be_feature: Bools | None = None,
    ) -> Slices:
        """The slices but those that are bad, (M,), for a reason.

        What they are off by and whether they may be right, (M,) each, are for `DroppedContour`.
        Raises ValueError if there are not as many as slices, or none stays.
        """
        if bad.shape != self.heights.shape or bad.all():
            raise ValueError(
                f"bad must leave at least one of {len(self.heights)} slices, got {bad.tolist()}"
            )
        stay = np.flatnonzero(~bad)
        off = np.zeros(len(bad)) if off is None else off
        may_be_feature = np.zeros(len(bad), np.bool_) if may_be_feature is None else may_be_feature
        out = (each[bad].tolist() for each in (self.rows, self.heights, off, may_be_feature))
        told = zip(*out, strict=True)
        left = [DroppedContour(which, why, height, far, may) for which, height, far, may in told]
        rows = {name: getattr(self, name)[stay] for name in EACH_SLICE}
        rows |= {"dropped": tuple(sorted([*self.dropped, *left]))}
        return replace(self, loops=tuple(self.loops[row] for row in stay), **rows)


def stack_curves(given: Sequence[ContourCurve | DroppedContour]) -> Slices:
    """Put curves in order; ValueError if there is none.

    Of contours at one height one stays: the better of two that repeat each other or cross, the
    outer one of nested ones, the larger of two that lie side by side.
    """
    dropped = [one for one in given if isinstance(one, DroppedContour)]
    loops = [one for one in given if isinstance(one, ContourCurve)]
    if not loops:
        found = drop_reasons(dropped) or "none"
        raise ValueError(f"contours must hold at least one of 3 points around an area, got {found}")
    # Ties are decided by what the contours are like, for the order in which they came must not.
    loops.sort(key=lambda one: (one.height, one.perimeter, len(one.points), float(one.fine[0, 0])))
    loops, rivals = _one_at_each_height(loops)
    return restack(loops, tuple(sorted([*dropped, *rivals])))


def _one_at_each_height(
    loops: list[ContourCurve],
) -> tuple[list[ContourCurve], list[DroppedContour]]:
    """Those of rising curves that stay, no two at one height, and the others."""
    spacing = (loops[-1].height - loops[0].height) / max(len(loops) - 1, 1)
    kept, dropped = loops[:1], []
    for loop in loops[1:]:
        last = kept[-1]
        near = CERTAIN * float(np.hypot(last.error, loop.error)) + SAME_HEIGHT * spacing
        if loop.height - last.height > max(near, NOT_APART * loop.perimeter):
            kept.append(loop)
            continue
        worse, why = duplicate_of_two(last, loop)
        dropped.append(DroppedContour(worse.which, why, worse.height))
        if worse is last:
            kept[-1] = loop
    return kept, dropped


def duplicate_of_two(first: ContourCurve, second: ContourCurve) -> tuple[ContourCurve, DropReason]:
    """Which one of two curves at one height to drop, and why."""

    def worth(loop: ContourCurve) -> tuple[bool, bool, int]:
        flags = loop.curve.flags
        return not flags.self_intersecting, not flags.uneven, len(loop.points)

    smaller, larger = sorted((first, second), key=lambda loop: abs(geometry.signed_area(loop.fine)))
    worse = min((second, first), key=worth)
    off = geometry.edge_distance(larger.fine, smaller.fine[::EACH])
    if float(np.sqrt((off**2).mean())) <= ALIKE * larger.perimeter:
        return worse, "repeats another at its height"
    inside = geometry.winding_number(larger.fine, smaller.fine) != 0
    if inside.all():
        return smaller, "inside another at its height"
    if inside.any() or (geometry.winding_number(smaller.fine, larger.fine) != 0).any():
        return worse, "crosses another at its height"
    return smaller, "beside another at its height"


def restack(loops: Sequence[ContourCurve], dropped: tuple[DroppedContour, ...]) -> Slices:
    """The stack of curves at rising heights, and of what was dropped before."""
    fine = np.stack([loop.fine for loop in loops])
    middles = geometry.area_centroids(fine)
    heights = np.array([loop.height for loop in loops])
    perimeter = np.array([loop.perimeter for loop in loops])
    tilt = np.array([loop.tilt for loop in loops])
    allowed = TILTED_ALONE * perimeter
    if len(loops) > 1:
        gaps = np.diff(heights)
        allowed = TILTED * np.minimum(np.append(gaps, np.inf), np.append(np.inf, gaps))
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
    """Places of M slices that belong together, K around each."""

    grid: Floats  # (M, K, 2): place j of each slice belongs to place j of every other, m
    places: Floats  # (M, K): the turns of these places on the slices' curves; they may exceed 1
    turns: Floats  # (M,): those of the first places, from 0 to 1
    method: CorrespondenceMethod  # How they were found
    # Of each method that was tried: the distance between a slice's curve and the places that its
    # neighbours predict for it, m; its mean around, then the geometric mean over slices, so that an
    # object's step, which no method predicts, does not outweigh all others. Empty where fewer than
    # 3 slices leave none between others.
    scores: dict[CorrespondenceMethod, float]


def match_slices(
    slices: Slices, count: int, method: Literal["auto"] | CorrespondenceMethod = "auto"
) -> Correspondence:
    """Match slices place by place, at least 3 (`count`) around each.

    Methods: "twist": each slice begins where the surface between it and the next twists least.
    "signature": it begins so that lobes and corners follow each other. "ray": it begins at the ray
    along x from its middle. In all of them equal turns of the curves correspond. "azimuth": equal
    azimuths about the middles do (Fung, 1999, 4.2, step 5); of slices that are not star-shaped as
    nearly as may be, by `azimuth_match`. "auto" leaves each slice out and predicts it from its
    neighbours: the least twist, unless another method predicts clearly better; azimuths only if all
    slices are star-shaped. Raises ValueError if the count is below 3 or the method unknown.
    """
    if count < LEAST_COUNT:
        raise ValueError(f"count must be at least {LEAST_COUNT}, got {count}")
    if method != "auto" and method not in get_args(CorrespondenceMethod):
        words = ", ".join(get_args(CorrespondenceMethod))
        raise ValueError(f"method must be auto or one of {words}, got {method!r}")
    methods: tuple[CorrespondenceMethod, ...] = get_args(CorrespondenceMethod)
    if method != "auto":
        methods = (method,)
    elif not slices.star.all():
        methods = methods[:-1]
    places = _places(slices, count, methods)
    scores: dict[CorrespondenceMethod, float] = {}
    best = 0
    if len(slices.heights) >= LEAST_SLICES:
        found = _scores(slices, places)
        scores = dict(zip(methods, found.tolist(), strict=True))
        nearest = int(found.argmin())
        best = nearest if found[nearest] < CLEARLY * found[0] else 0
    grid, turns = curve_places(slices.curves, places[best]), np.mod(places[best, :, 0], 1.0)
    return Correspondence(grid, places[best], turns, methods[best], scores)


def _places(slices: Slices, count: int, methods: tuple[CorrespondenceMethod, ...]) -> Floats:
    """Turns (c, M, count) on the curves that belong together under each method."""
    shapes = slices.fine - slices.middles[:, None]
    rays = start_ray(shapes)
    steps = minimum_twist(shapes)
    middle = len(shapes) // 2  # So that what is wrong in a step moves few slices
    around = np.arange(count) / count
    found: dict[CorrespondenceMethod, Callable[[], Floats]] = {
        "twist": lambda: begin_turns(steps, middle, rays[middle])[:, None] + around,
        "signature": lambda: (
            begin_turns(follow_signatures(shapes, steps), middle, rays[middle])[:, None] + around
        ),
        "ray": lambda: rays[:, None] + around,
        "azimuth": lambda: _azimuths(slices, around),
    }
    return np.stack([found[method]() for method in methods])


def start_ray(shapes: Floats) -> Floats:
    """Turns (M,) from 0 to 1 at which curves come up through the ray along x, the farthest out.

    Closed counter-clockwise curves (M, n, 2), each about its own middle, at even steps of the turn;
    one that does not cross the ray begins where it is farthest along x.
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
    """Steps (M - 1,), in turns, to the next curve's begin with the largest circular correlation."""
    waves = np.fft.fft(shapes[..., 0] + 1j * shapes[..., 1], axis=1)
    # The sum over both coordinates is the real part of one complex product.
    steps = circular_peak(np.fft.ifft(np.conj(waves[:-1]) * waves[1:], axis=1).real)
    return steps - np.round(steps)


def _azimuths(slices: Slices, around: Floats) -> Floats:
    """Turns (M, count) at which the curves have given azimuths, in turns, about their middles."""
    found = []
    for curve, middle, star in zip(slices.fine, slices.middles, slices.star, strict=True):
        even = np.linspace(0.0, 1.0, len(curve) + 1)
        if star:
            away = curve - middle
            azimuths = np.unwrap(np.arctan2(away[:, 1], away[:, 0])) / (2.0 * np.pi)
            ahead = np.mod(around - azimuths[0], 1.0)
            found.append(np.interp(ahead, np.append(azimuths - azimuths[0], 1.0), even))
            continue
        shares = geometry.azimuth_match(curve, middle, 2.0 * np.pi * around).turns
        lengths = np.linalg.norm(np.diff(np.vstack([curve, curve[:1]]), axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
        found.append(np.interp(shares, ends, even))
    return np.unwrap(np.stack(found), period=1.0, axis=1)


def begin_turns(steps: Floats, from_slice: int, begin: float) -> Floats:
    """Turns (M,) from 0 to 1 at which curves begin, by steps (M - 1,), given that of one."""
    turns = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(np.mod(turns - turns[from_slice] + begin, 1.0))


def follow_signatures(shapes: Floats, steps: Floats) -> Floats:
    """Steps (M - 1,), in turns, under which the signatures of neighbours agree.

    Lobes look alike: any one step could as well be a lobe further. So all are chosen together, for
    the largest sum of correlations less what changes of the twist cost (Bellman, 1957).
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
    products = lengths[:-1] * lengths[1:]
    scale = np.where(products > 0.0, products, 1.0)
    alike = np.fft.ifft(np.conj(waves[:-1]) * waves[1:] * turned, axis=1).real / scale[:, None]
    reach = int(REACH * count)
    shifts = np.arange(-reach, reach + 1)
    near = alike[:, shifts % count]
    lobed = lengths > LEAST_RELIEF * mean * np.sqrt(count)
    tells = lobed[:-1] & lobed[1:] & (near.max(axis=1) > LEAST_ALIKE)
    best = _best_path(np.where(tells[:, None], near, 0.0), shifts / count)
    return steps + np.where(tells, circular_peak(alike, shifts[best]), shifts[best] / count)


def _best_path(gain: Floats, shifts: Floats) -> NDArray[np.intp]:
    """Which shift (k,) each pair (m,) takes, given what each gains (m, k)."""
    change = CHANGE * (shifts[:, None] - shifts) ** 2
    gain = gain - TWIST * shifts**2
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
    """Places (m,), in turns, of peaks of functions at even steps (m, n): parabolas at `top`."""
    count = values.shape[1]
    top = values.argmax(axis=1) if top is None else top
    rows = np.arange(len(values))
    before, here, after = (values[rows, (top + step) % count] for step in (-1, 0, 1))
    bend = 2.0 * here - before - after
    step = np.divide(0.5 * (after - before), bend, out=np.zeros_like(here), where=bend > 0.0)
    return np.asarray((top + np.clip(step, -0.5, 0.5)) / count)


def _scores(slices: Slices, places: Floats) -> Floats:
    """How well turns (c, M, count) predict slices from their neighbours, (c,), m."""
    grids = chord_places(slices.fine, places[:, :, :: max(places.shape[2] // SCORED, 1)])
    margin = 2 if len(slices.heights) >= WHOLE else 1
    inner = slice(margin, -margin)
    predicted = np.einsum("im,cmkd->cikd", neighbour_weights(slices.heights)[inner], grids)
    distance = slice_distance(slices.fine[inner], predicted).mean(axis=2)
    least = EXACT * slices.perimeter[inner]
    return np.asarray(np.exp(np.log(np.maximum(distance, least)).mean(axis=1)))


def slice_distance(curves: Floats, points: Floats) -> Floats:
    """Distances (c, M, k) of points (c, M, k, 2) from curves (M, n, 2), to their tangents, m."""
    middles = curves.mean(axis=1)  # Width must not grow by where an object leans to
    curves = curves - middles[:, None]
    points = points - middles[:, None]
    far = APART * max(float(np.abs(curves).max()), float(np.abs(points).max()))
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
