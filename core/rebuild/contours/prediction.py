"""What neighbours predict of a contour, where along it they do, and how well its curve is known.

Contours are compared across their curves: how points are spaced along a contour, where it begins
and how many points it has is no difference of shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.curves import ContourCurve, chord_places
from palpate.core.splines import closed_curve_points, interpolate_closed

EACH_SIDE = 2  # Neighbours below and above that tell of a contour


@dataclass(frozen=True, slots=True)
class SlidingSettings:
    """How places slide along their curves to where those of the neighbours predict them.

    The predictions of all curves change at once, so that whole steps would diverge: the slide of
    every other curve is answered by -5/3 of it, and a step of half a slide leaves a third of that.
    """

    n_sweeps: int = 8
    damping: float = 0.5  # fraction of a slide that one sweep makes
    max_step: float = 0.02  # [turns], of one sweep


def slid_grid(
    heights: Floats,
    fine: Floats,
    turns: Floats,
    alone: int | None = None,
    settings: SlidingSettings = SlidingSettings(),
) -> Floats:
    """Places (M, K, 2) of curves that differ from their neighbours' across the curves alone.

    Of curves (M, n, 2) at rising heights (M,), from turns (M, K) that correspond. How points are
    spaced along a contour moves its places along the curve, which is no difference of shape. The
    contour `alone` moves no other: one that is wrong would drag its neighbours' places along.
    """
    weights, count = neighbour_weights(heights), fine.shape[1]
    if alone is not None:
        others = np.arange(len(heights)) != alone
        weights = weights.copy()
        weights[others, alone] = 0.0
        weights[np.ix_(others, others)] = neighbour_weights(heights[others])
    ahead = 0.5 * count * (np.roll(fine, -1, axis=1) - np.roll(fine, 1, axis=1))
    grid = chord_places(fine, turns)
    for _ in range(settings.n_sweeps):
        speed = chord_places(ahead, turns)
        square = (speed**2).sum(axis=2)
        along = ((np.tensordot(weights, grid, 1) - grid) * speed).sum(axis=2)
        slide = np.divide(along, square, out=np.zeros_like(along), where=square > 0.0)
        turns = turns + np.clip(settings.damping * slide, -settings.max_step, settings.max_step)
        grid = chord_places(fine, turns)
    return grid


@dataclass(frozen=True, slots=True)
class InterpolationSettings:
    """How far a curve may leave the contour between its points.

    Half of the points are predicted from the others. The error falls with the `order` of the
    spacing: 4 for a cubic where points are dense, 2 where they hardly tell the shape.
    """

    order: float = 2.0
    min_points: int = 6  # of a contour: half as many must make a curve
    certainty: float = 3.0  # of that error's root mean square: what is no difference of shape


def interpolation_errors(
    loops: Sequence[ContourCurve], settings: InterpolationSettings = InterpolationSettings()
) -> Floats:
    """What curves (M,) may be off between their points, (M,), m; infinite where too few tell."""
    return np.array([_interpolation_error(loop, settings) for loop in loops])


def _interpolation_error(loop: ContourCurve, settings: InterpolationSettings) -> float:
    points, count = loop.points, len(loop.points)
    if count < settings.min_points:
        return np.inf
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    turns = np.concatenate([[0.0], np.cumsum(chords)[:-1]]) / chords.sum()
    missed = np.empty(count)
    for first in (0, 1):
        kept, out = slice(first, None, 2), slice(1 - first, None, 2)
        begin = turns[kept][0]
        fit = interpolate_closed(points[kept], turns[kept] - begin)
        places = closed_curve_points(fit.control, fit.knots, np.mod(turns[out] - begin, 1.0))
        missed[out] = np.linalg.norm(places - points[out], axis=1)
    wide = chords + np.roll(chords, 1)  # the gap in which each point was left out
    share = chords / np.minimum(wide, np.roll(wide, -1))
    between = np.maximum(missed, np.roll(missed, -1)) * share**settings.order
    return settings.certainty * float(np.sqrt(np.average(between**2, weights=chords)))


def neighbour_weights(heights: Floats) -> Floats:
    """Weights (M, M) that predict contours at rising heights (M,): ``weights @ rows``.

    Lagrange's, by the two nearest contours below and above; at either end by the three nearest.
    Rows sum to 1; they are 0 where there are fewer than 2 others.
    """
    return _weights(tuple(heights.tolist()))


@lru_cache(maxsize=64)
def _weights(levels: tuple[float, ...]) -> Floats:
    """The same, once for each stack; not to be written to."""
    heights, count = np.array(levels), len(levels)
    every = np.arange(count)
    weights = np.zeros((count, count))
    for row in range(count):
        below, above = every[:row], every[row + 1 :]
        if not len(below) or not len(above):
            near = np.concatenate([below[-EACH_SIDE - 1 :], above[: EACH_SIDE + 1]])
        else:
            near = np.concatenate([below[-EACH_SIDE:], above[:EACH_SIDE]])
        if len(near) >= 2:
            weights[row, near] = lagrange_weights(heights[near], levels[row])
    weights.setflags(write=False)
    return weights


def lagrange_weights(nodes: Floats, place: float = 0.0) -> Floats:
    """Weights (..., k) of values at nodes (..., k) in their polynomial's value at a place."""
    apart = nodes[..., :, None] - nodes[..., None, :]
    others = np.broadcast_to(~np.eye(nodes.shape[-1], dtype=bool), apart.shape)
    ahead = np.broadcast_to((place - nodes)[..., None, :], apart.shape)
    return np.asarray(np.divide(ahead, apart, out=np.ones_like(apart), where=others).prod(axis=-1))
