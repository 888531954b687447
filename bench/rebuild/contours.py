"""How far the band of a loft can be trusted, and whether a step swings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from palpate.bench.objects import ROUND_HEIGHT, ROUND_OBJECTS, WAVY, RoundObject
from palpate.bench.table import Row, at_least, at_most
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.side import ContourLoft, fit_contour_loft

BAND_SIZES = ((6, 24), (9, 24), (14, 40), (24, 40), (27, 80))  # Contours, and points of each
FULL = (27, 80)
NOISES = (0.002, 0.005)  # Standard deviation of a coordinate over the height
BAND_SEEDS, QUICK_BAND_SEEDS = 13, 2
BEYOND = 0.04  # By which the ends lie beyond the contours, where no pole is known
POLE = float(np.sqrt(1.04))  # Height at which the lobed zig-zag closes
NORMAL_95 = 1.96
# Places at which a surface is compared with the truth, from contour to contour.
ROWS, COLUMNS = 181, 97
LAST = 0.99  # Height of the last contours, on either side
WIDE, NARROW, AT = 0.6, 0.36, 0.12  # Radii of a cylinder that steps, and where
STEPS = 16  # Random stacks of its contours


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
    off, area = thing.distances(places, heights)
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
