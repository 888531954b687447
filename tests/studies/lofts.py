"""Lofts of contours: how far their band can be trusted, what disorder costs, whether steps swing.

Objects of a height of 2 or of 100 mm; contours begin and end 0.5 % of the height inside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from palpate.bench.table import Row, at_least, at_most
from palpate.core import Floats
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.side import ContourLoft, fit_contour_loft
from palpate.tools import single_threaded
from tests.studies.contours import CONTOUR_NOISE, ends_of, noisy_contours, rebuilt
from tests.studies.rebuilt import REBUILT_SHAPES, WAVY, RoundObject, truth_of

DISORDERED = ((27, 81), (24, 41), (9, 24))  # Contours, and points of each
COUNTS = 0.25  # By which the number of points differs from contour to contour
OUTLIER_SHARE, OUTLIER_DISTANCE = 0.02, 3.0  # Share of the points that are off, and by how much, mm
Disorder = Callable[[RoundObject, Floats, np.random.Generator], Sequence[Floats]]
BAND_SIZES = ((6, 24), (9, 24), (14, 40), (24, 40), (27, 80))  # Contours, and points of each
FULL = (27, 80)
NOISES = (0.002, 0.005)  # Standard deviation of a coordinate over the height
BAND_SEEDS, QUICK_BAND_SEEDS = 13, 2
BEYOND = 0.04  # By which the ends lie beyond the contours, where no pole is known
POLE = float(np.sqrt(1.04))  # Height at which the lobed zig-zag closes
NORMAL_95 = 1.96
ROWS, COLUMNS = 181, 97  # Places of a surface that are compared with the truth, between contours
LAST = 0.99  # Height of the last contours, on either side
WIDE, NARROW, AT = 0.6, 0.36, 0.12  # Radii of a cylinder that steps, and where
STEPS = 16  # Random stacks of its contours
ROUND_HEIGHT = 2.0  # Of every object that is measured; its contours lie from -1 to 1
SLOPE_STEP = 1e-5  # Over which slopes are taken


def disorder_rows(quick: bool) -> Iterable[Row]:
    """What disorder and outliers cost."""
    off = f"{OUTLIER_SHARE:.0%} of points off by {OUTLIER_DISTANCE:g} mm"
    cases = (("random starts, directions and counts", shuffled, 1.03), (off, with_outliers, 1.1))
    with single_threaded():
        for size, (name, disorder, most) in product(DISORDERED, cases):
            title = f"{size[0]} by {size[1]}, {CONTOUR_NOISE} mm: {name}, error over that without"
            yield at_most(title, ratio_of(disorder, size), most, ".3f", " x")


def shuffled(shape: RoundObject, contours: Floats, rng: np.random.Generator) -> list[Floats]:
    """Other contours at the same heights: each begun anywhere, of any direction and count."""
    found = []
    for level in contours[..., 2].mean(axis=1):
        count = round(contours.shape[1] * rng.uniform(1.0 - COUNTS, 1.0 + COUNTS))
        exact = shape.contours(np.array([level]), count, rng.random())[0]
        noisy = exact + CONTOUR_NOISE * rng.normal(size=exact.shape)
        found.append(noisy[::-1] if rng.random() < 0.5 else noisy)
    return [found[i] for i in rng.permutation(len(found))]


def with_outliers(shape: RoundObject, contours: Floats, rng: np.random.Generator) -> list[Floats]:
    """The same contours with some points off, outwards or inwards."""
    changed = contours.copy()
    wrong = rng.random(contours.shape[:2]) < OUTLIER_SHARE
    away = contours - contours.mean(axis=1, keepdims=True)
    away[..., 2] = 0.0
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    signs = rng.choice([-1.0, 1.0], (int(wrong.sum()), 1))
    changed[wrong] += OUTLIER_DISTANCE * signs * away[wrong]
    return list(changed)


def ratio_of(
    disorder: Disorder,
    size: tuple[int, int] = DISORDERED[0],
    shapes: Mapping[str, RoundObject] = REBUILT_SHAPES,
) -> float:
    """Mean error over objects from disordered contours, over that from plain ones.

    The ends are touched, lest what nobody can know of them hides the rest.
    """
    plain, other = 0.0, 0.0
    for name, shape in shapes.items():
        tops = ends_of(shape)
        contours = noisy_contours(shape, size, CONTOUR_NOISE, np.random.default_rng(0))
        changed = disorder(shape, contours, np.random.default_rng(1))
        plain += truth_of(name).errors_of(rebuilt(list(contours), tops)).chamfer
        other += truth_of(name).errors_of(rebuilt(changed, tops)).chamfer
    return other / plain


class BandErrors(NamedTuple):
    """One surface against the truth; lengths over the height."""

    rms: float  # Root mean square error
    covered: float  # Share of the surface within the band of 95 %
    safe_rms: bool  # Whether the root mean square error stays below what was claimed
    safe_most: bool  # Whether the largest error does


def band_rows(quick: bool) -> Iterable[Row]:
    """Figures of surfaces through contours; fewer runs if quick."""
    for ends, poles in (("closed", True), ("open ends", False)):
        clean = judge_band(WAVY, _skin(WAVY, FULL, 0.0, 0, poles=poles)).rms
        yield at_most(f"lobed zig-zag, 27 by 80, {ends}: rms over height", clean, 1e-4, ".3g")
    seeds = QUICK_BAND_SEEDS if quick else BAND_SEEDS
    noisy = _noisy(WAVY, FULL, 0.005, seeds)
    yield at_most("the same with noise of 0.5 %: rms over height", noisy, 1.5e-3, ".3g")
    yield from _coverage_rows(seeds)
    most = max(step_swing(seed) for seed in range(STEPS))
    yield at_most("a step: side beyond its radii, over the width", most, 0.05, ".3g")


def _coverage_rows(seeds: int) -> Iterable[Row]:
    for size in BAND_SIZES:
        found = [
            judge_band(thing, _skin(thing, size, noise, seed))
            for thing in ROUND_OBJECTS.values()
            for noise in NOISES
            for seed in range(seeds)
        ]
        name = f"{size[0]} by {size[1]}, {len(found)} runs"
        pooled = float(np.mean([one.covered for one in found]))
        holds = 0.90 <= pooled <= 0.98
        yield Row(f"{name}: within the 95 % band", f"{pooled:.1%}", "90 to 98 %", holds)
        for what, error in (("rms", "root mean square"), ("most", "largest")):
            safe = float(np.mean([getattr(one, f"safe_{what}") for one in found]))
            yield at_least(f"{name}: {error} error as claimed", safe, 0.9, ".1%")


def _noisy(thing: RoundObject, size: tuple[int, int], noise: float, seeds: int) -> float:
    """Mean root mean square error over the height."""
    found = [judge_band(thing, _skin(thing, size, noise, seed)).rms for seed in range(seeds)]
    return float(np.mean(found))


def judge_band(thing: RoundObject, skin: ContourLoft) -> BandErrors:
    """Compare a surface with the object between its contours."""
    heights = np.linspace(-0.998, 0.998, ROWS)
    turns = (np.arange(COLUMNS) + 0.1) / COLUMNS
    places = skin.at(heights[:, None], turns)
    off, area = distances(thing, places, heights)
    deviation = skin.deviation(heights, turns)
    share = area / area.sum()
    rms = float(np.sqrt((share * off**2).sum()))
    most = float(np.abs(off).max())
    claimed = skin.uncertainty()
    covered = float(share[np.abs(off) <= NORMAL_95 * deviation].sum())
    safe = rms <= claimed.rms, most <= claimed.most
    return BandErrors(rms / ROUND_HEIGHT, covered, *safe)


def _skin(
    thing: RoundObject, size: tuple[int, int], noise: float, seed: int, poles: bool = False
) -> ContourLoft:
    """A loft of contours with noise."""
    rng = np.random.default_rng(seed)
    heights = np.linspace(-1.0, 1.0, size[0])
    grid = thing.rings(heights, 2.0 * np.pi * np.arange(size[1]) / size[1])[..., :2]
    grid = grid + noise * ROUND_HEIGHT * rng.normal(size=grid.shape)
    end = POLE if poles else 1.0 + BEYOND
    return fit_contour_loft(heights, grid, low=-end, high=end, pole=(poles, poles))


def step_swing(seed: int) -> float:
    """How far the side leaves the two radii of a step, over the width."""
    rng = np.random.default_rng(seed)
    near = AT + np.concatenate([rng.uniform(-0.06, 0.0, 2), 0.002 + rng.uniform(0.0, 0.06, 2)])
    heights = np.concatenate([rng.uniform(-LAST, LAST, 12), near])
    angle = 2.0 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(60)])
    contours = [(WIDE if z < AT + 0.001 else NARROW) * rim + [0.0, 0.0, z] for z in heights]
    closed = reconstruct(contours, method="skin", tops=[[0, 0, -1], [0, 0, 1]]).closed
    assert closed is not None
    side = closed.loft.at(np.linspace(-LAST, LAST, 997)[:, None], np.arange(COLUMNS) / COLUMNS)
    radius = np.linalg.norm(side, axis=2)
    return float(max(radius.max() - WIDE, NARROW - radius.min())) / (2.0 * WIDE)


def distances(thing: RoundObject, places: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """Normal distances (m, k) of places (m, k, 2) at heights (m,), and area elements.

    To first order: how far outside, over its slope.
    """
    z = np.broadcast_to(heights[:, None], places.shape[:2])
    outside = _outside(thing, places, z)
    slopes = [
        (_outside(thing, places + step, z) - _outside(thing, places - step, z)) / (2.0 * SLOPE_STEP)
        for step in SLOPE_STEP * np.eye(2)
    ]
    low, high = np.maximum(z - SLOPE_STEP, -1.0), np.minimum(z + SLOPE_STEP, 1.0)
    slopes.append((_outside(thing, places, high) - _outside(thing, places, low)) / (high - low))
    level = np.hypot(slopes[0], slopes[1])
    whole = np.hypot(level, slopes[2])
    around = np.linalg.norm(np.roll(places, -1, 1) - places, axis=-1)
    return outside / whole, around * whole / level


def _outside(thing: RoundObject, places: Floats, z: Floats) -> Floats:
    away = places - thing.axis(z)
    angle = np.arctan2(away[..., 1], away[..., 0])
    return np.asarray(np.hypot(away[..., 0], away[..., 1]) - thing.radius(z, angle))


def _tile(z: Floats, t: Floats) -> Floats:
    square = (np.abs(np.cos(t)) ** 6.0 + np.abs(np.sin(t) / 0.7) ** 6.0) ** (-1.0 / 6.0)
    return np.asarray(0.6 * square * (1.0 - 0.2 * z) * (1.08 - z**4) ** 0.25)


def bent_axis(z: Floats) -> Floats:
    """An axis that leans and bends sideways by a third of the height."""
    return np.stack([0.6 * z**2 + 0.2 * z, 0.15 * np.sin(2.0 * z)], axis=-1)


ROUND_OBJECTS: Mapping[str, RoundObject] = {
    "barrel": RoundObject(lambda z, t: (0.62 - 0.2 * z**2) * (1.0 + 0.06 * np.cos(2.0 * t))),
    "pear": RoundObject(lambda z, t: np.sqrt(1.1 - z**2) * (0.5 - 0.22 * np.tanh(2.5 * z))),
    "hourglass": RoundObject(
        lambda z, t: np.sqrt(0.1 + 0.25 * z**2) * (1.0 + 0.1 * np.sin(4.0 * t + z))
    ),
    "screw": RoundObject(lambda z, t: (0.5 - 0.08 * z) * (1.0 + 0.12 * np.cos(3.0 * t - 2.2 * z))),
    "tile": RoundObject(_tile),
    "bent tube": RoundObject(
        lambda z, t: (
            0.4 * (1.0 / np.sqrt(np.cos(t) ** 2 + (np.sin(t) / 0.7) ** 2)) * (1.0 - 0.25 * z**2)
        ),
        bent_axis,
    ),
    "ogive": RoundObject(
        lambda z, t: np.sqrt(2.1**2 - (z + 1.0) ** 2) - 0.35 + 0.04 * np.cos(5.0 * t)
    ),
    "rings": RoundObject(lambda z, t: 0.55 + 0.06 * np.cos(7.0 * z + 0.5 * np.sin(t)) - 0.1 * z),
}
