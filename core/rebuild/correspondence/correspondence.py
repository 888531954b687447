"""Which places of a stack of contours belong together, from the lowest to the highest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.azimuth_match import azimuth_match
from palpate.core.rebuild.correspondence.leave_one_out import neighbour_weights
from palpate.core.rebuild.correspondence.minimum_twist import begin_turns, minimum_twist
from palpate.core.rebuild.correspondence.signature import follow_signatures
from palpate.core.rebuild.correspondence.start_ray import start_ray
from palpate.core.rebuild.slices.curve_places import chord_places, curve_places
from palpate.core.rebuild.slices.slice_distance import slice_distance
from palpate.core.rebuild.slices.slices import Slices

Method = Literal["twist", "signature", "ray", "azimuth"]

LEAST_COUNT = 3
CLEARLY = 0.85
"""Of the score of the least twist: another method must do better than that to be taken."""
WHOLE = 6
"""Slices from which on only those count that have two neighbours on either side."""
EXACT = 1e-6
"""Of the perimeter: distances below are not told apart."""
SCORED = 64
"""Places around, at least, at which methods are compared."""
LEAST_SLICES = 3
"""With fewer no slice lies between others."""


@dataclass(frozen=True, slots=True, eq=False)
class Correspondence:
    """Places of M slices that belong together, K around each."""

    grid: Floats
    """(M, K, 2): place j of each slice belongs to place j of every other, m."""
    places: Floats
    """(M, K): the turns of these places on the slices' curves; they may exceed 1."""
    turns: Floats
    """(M,): those of the first places, from 0 to 1."""
    method: Method
    """How they were found."""
    scores: dict[Method, float]
    """Of each method that was tried: the distance between a slice's curve and the places that its
    neighbours predict for it, m; its mean around, then the geometric mean over slices, so that
    an object's step, which no method predicts, does not outweigh all others. Empty where fewer
    than 3 slices leave none between others."""


def match_slices(
    slices: Slices, count: int, method: Literal["auto"] | Method = "auto"
) -> Correspondence:
    """Match slices place by place.

    Parameters
    ----------
    slices : Slices
        The stack.
    count : int
        Places around each slice, at least 3.
    method : {"auto", "twist", "signature", "ray", "azimuth"}
        "twist": each slice begins where the surface between it and the next twists least.
        "signature": it begins so that lobes and corners follow each other. "ray": it begins at
        the ray along x from its middle. In all of them equal turns of the curves correspond.
        "azimuth": equal azimuths about the middles do (Fung, 1999, 4.2, step 5); of slices that
        are not star-shaped as nearly as may be, by `azimuth_match`. "auto" leaves each slice
        out and predicts it from its neighbours: the least twist, unless another method
        predicts clearly better; azimuths only if all slices are star-shaped.

    Raises
    ------
    ValueError
        If the count is below 3 or the method unknown.
    """
    if count < LEAST_COUNT:
        raise ValueError(f"count must be at least {LEAST_COUNT}, got {count}")
    if method != "auto" and method not in get_args(Method):
        words = ", ".join(get_args(Method))
        raise ValueError(f"method must be auto or one of {words}, got {method!r}")
    methods: tuple[Method, ...] = get_args(Method) if method == "auto" else (method,)
    if method == "auto" and not slices.star.all():
        methods = tuple(one for one in methods if one != "azimuth")
    places = _places(slices, count, methods)
    scores: dict[Method, float] = {}
    best = 0
    if len(slices.heights) >= LEAST_SLICES:
        found = _scores(slices, places)
        scores = dict(zip(methods, found.tolist(), strict=True))
        nearest = int(found.argmin())
        best = nearest if found[nearest] < CLEARLY * found[0] else 0
    turns = np.mod(places[best, :, 0], 1.0)
    grid = curve_places(slices.curves, places[best])
    return Correspondence(grid, places[best], turns, methods[best], scores)


def _places(slices: Slices, count: int, methods: tuple[Method, ...]) -> Floats:
    """Turns (c, M, count) on the curves that belong together under each method."""
    shapes = slices.fine - slices.middles[:, None]
    rays = start_ray(shapes)
    steps = minimum_twist(shapes)
    # In the middle of the stack, so that what is wrong in a step moves few slices.
    middle = len(shapes) // 2
    around = np.arange(count) / count
    found = []
    for method in methods:
        if method == "azimuth":
            found.append(_azimuths(slices, around))
            continue
        turns = rays
        if method == "twist":
            turns = begin_turns(steps, middle, rays[middle])
        elif method == "signature":
            turns = begin_turns(follow_signatures(shapes, steps), middle, rays[middle])
        found.append(turns[:, None] + around)
    return np.stack(found)


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


def _scores(slices: Slices, places: Floats) -> Floats:
    """How well turns (c, M, count) predict slices from their neighbours, (c,), m."""
    grids = chord_places(slices.fine, places[:, :, :: max(places.shape[2] // SCORED, 1)])
    margin = 2 if len(slices.heights) >= WHOLE else 1
    inner = slice(margin, -margin)
    weights = neighbour_weights(slices.heights)[inner]
    predicted = np.einsum("im,cmkd->cikd", weights, grids)
    distance = slice_distance(slices.fine[inner], predicted).mean(axis=2)
    least = EXACT * slices.perimeter[inner]
    scores: Floats = np.exp(np.log(np.maximum(distance, least)).mean(axis=1))
    return scores
