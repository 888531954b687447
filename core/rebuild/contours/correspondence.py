"""Which places of a stack of contours belong together: Fung, 1999, 4.2.

Candidates: the least twist (circular correlation by Fourier transform), signatures (the distance
from the middle along the contour, followed through the stack by dynamic programming, Bellman,
1957: the least twist of a nearly round contour follows nothing, for the circle in it outweighs
its lobes), a ray along x, and azimuths. Leaving slices out decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.geometry import azimuth_match
from palpate.core.rebuild.contours.curves import chord_places, curve_places
from palpate.core.rebuild.contours.outliers import neighbour_weights
from palpate.core.rebuild.contours.slices import Slices

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
    # In the middle of the stack, so that what is wrong in a step moves few slices.
    middle = len(shapes) // 2
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
    """Steps (M - 1,), in turns, to where the next curve should begin; curves as of `start_ray`.

    The step s makes the sum of ``|a(u) - b(u + s)|^2`` smallest: the peak of a circular
    correlation.
    """
    waves = np.fft.fft(shapes[..., 0] + 1j * shapes[..., 1], axis=1)
    # The sum over both coordinates is the real part of one complex product.
    correlation = np.fft.ifft(np.conj(waves[:-1]) * waves[1:], axis=1).real
    steps = circular_peak(correlation)
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
        shares = azimuth_match(curve, middle, 2.0 * np.pi * around).turns
        closed = np.vstack([curve, curve[:1]])
        lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
        found.append(np.interp(shares, ends, even))
    return np.unwrap(np.stack(found), period=1.0, axis=1)


def begin_turns(steps: Floats, from_slice: int, begin: float) -> Floats:
    """Turns (M,) from 0 to 1 at which curves begin, by steps (M - 1,), given that of one."""
    turns = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(np.mod(turns - turns[from_slice] + begin, 1.0))


def follow_signatures(shapes: Floats, steps: Floats) -> Floats:
    """Steps (M - 1,), in turns, under which the signatures of neighbours agree.

    Of curves as of `start_ray`, and the steps of the least twist. Lobes look alike: any one step
    could as well be a lobe further. So all are chosen together, for the largest sum of correlations
    less what changes of the twist cost (dynamic programming: Bellman, 1957).
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
    weights = neighbour_weights(slices.heights)[inner]
    predicted = np.einsum("im,cmkd->cikd", weights, grids)
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

    tree = cKDTree(raised(curves), balanced_tree=False, compact_nodes=False)
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
