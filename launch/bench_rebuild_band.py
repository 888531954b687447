"""Surfaces through contours, measured: their error, the band they give it, and what they cost."""

from __future__ import annotations

import timeit
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.skin.contour_skin import ContourSkin, fit_contour_skin
from palpate.launch.bench_row import Row
from palpate.launch.rebuild_objects import HEIGHT, OBJECTS, WAVY, RoundObject

SIZES = ((6, 24), (9, 24), (14, 40), (24, 40), (27, 80))
"""Contours, and points of each."""
FULL, LARGE = (27, 80), (100, 320)
NOISES = (0.002, 0.005)
"""Standard deviation of a coordinate over the height."""
SEEDS, QUICK_SEEDS = 13, 2
BEYOND = 0.04
"""By which the ends lie beyond the contours, where no pole is known."""
POLE = float(np.sqrt(1.04))
"""Height at which the lobed zig-zag closes."""
NORMAL_95 = 1.96
OUTLIERS, OFF = 0.02, 0.03
"""Share of the points that are off, and by how much of the height."""
ROWS, COLUMNS = 181, 97
"""Places at which a surface is compared with the truth, from contour to contour."""


class Judged(NamedTuple):
    """One surface against the truth; lengths over the height."""

    rms: float
    """Root mean square error."""
    most: float
    """Largest error."""
    covered: float
    """Share of the surface within the band of 95 %."""
    safe_rms: bool
    """Whether the root mean square error stays below what was claimed."""
    safe_most: bool
    """Whether the largest error does."""


def band_rows(quick: bool) -> Iterable[Row]:
    """Figures of surfaces through contours.

    Parameters
    ----------
    quick : bool
        Fewer runs.
    """
    clean = judge(WAVY, _skin(WAVY, FULL, 0.0, 0, poles=True)).rms
    yield _below("lobed zig-zag, 27 by 80, closed: rms over height", clean, 1e-4)
    clean = judge(WAVY, _skin(WAVY, FULL, 0.0, 0)).rms
    yield _below("lobed zig-zag, 27 by 80, open ends: rms over height", clean, 1e-4)
    seeds = QUICK_SEEDS if quick else SEEDS
    noisy = _noisy(WAVY, FULL, 0.005, seeds)
    yield _below("the same with noise of 0.5 %: rms over height", noisy, 1.5e-3)
    yield from _coverage_rows(seeds)
    yield _below("2 % of points off: error over that without", _outliers(seeds), 1.1)
    yield from _times()


def judge(thing: RoundObject, skin: ContourSkin) -> Judged:
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
    return Judged(
        rms=rms / HEIGHT,
        most=most / HEIGHT,
        covered=float(share[np.abs(off) <= NORMAL_95 * deviation].sum()),
        safe_rms=rms <= claimed.rms,
        safe_most=most <= claimed.most,
    )


def _coverage_rows(seeds: int) -> Iterable[Row]:
    for size in SIZES:
        found = [
            judge(thing, _skin(thing, size, noise, seed))
            for thing in OBJECTS.values()
            for noise in NOISES
            for seed in range(seeds)
        ]
        name = f"{size[0]} by {size[1]}, {len(found)} runs"
        pooled = float(np.mean([one.covered for one in found]))
        holds = 0.90 <= pooled <= 0.98
        yield Row(f"{name}: within the 95 % band", f"{pooled:.1%}", "90 to 98 %", holds)
        for what in ("rms", "most"):
            safe = float(np.mean([getattr(one, f"safe_{what}") for one in found]))
            said = "root mean square" if what == "rms" else "largest"
            yield Row(f"{name}: {said} error as claimed", f"{safe:.1%}", ">= 90 %", safe >= 0.9)


def _outliers(seeds: int) -> float:
    """Error with points off over that without, pooled over objects."""
    ratios = [
        _noisy(thing, FULL, 0.002, seeds, OUTLIERS) / _noisy(thing, FULL, 0.002, seeds)
        for thing in OBJECTS.values()
    ]
    return float(np.exp(np.mean(np.log(ratios))))


def _noisy(
    thing: RoundObject, size: tuple[int, int], noise: float, seeds: int, off: float = 0.0
) -> float:
    """Mean root mean square error over the height."""
    found = [judge(thing, _skin(thing, size, noise, seed, off)).rms for seed in range(seeds)]
    return float(np.mean(found))


def _times() -> Iterable[Row]:
    heights, grid = _contours(WAVY, FULL, 0.005, 0)
    large = _contours(WAVY, LARGE, 0.005, 0)

    def fit() -> ContourSkin:
        return _fit(heights, grid)

    skin = fit()
    over = np.linspace(-1.0, 1.0, 241)
    around = np.arange(97) / 97
    fewer = _fit(heights[1:], grid[1:])
    yield _time("27 by 80: fit", fit, 30.0)
    yield _time("27 by 80: deviation on 241 by 97", lambda: skin.deviation(over, around), 10.0)
    yield _time("27 by 80: one contour more", lambda: fewer.update(heights[0], grid[0]), 10.0)
    ratio = _least(lambda: _fit(*large)) / _least(fit)
    most = large[1].size / grid.size
    yield Row("100 by 320 over 27 by 80: time", f"{ratio:.1f} x", f"<= {most:.1f} x", ratio <= most)


def _fit(
    heights: Floats, grid: Floats, end: float = 1.0 + BEYOND, pole: bool = False
) -> ContourSkin:
    return fit_contour_skin(heights, grid, low=-end, high=end, pole=(pole, pole))


def _skin(
    thing: RoundObject,
    size: tuple[int, int],
    noise: float,
    seed: int,
    off: float = 0.0,
    poles: bool = False,
) -> ContourSkin:
    heights, grid = _contours(thing, size, noise, seed, off)
    return _fit(heights, grid, POLE, True) if poles else _fit(heights, grid)


def _contours(
    thing: RoundObject, size: tuple[int, int], noise: float, seed: int, off: float = 0.0
) -> tuple[Floats, Floats]:
    """Contours with noise, and with a share of points that are off along the radius."""
    rng = np.random.default_rng(seed)
    heights = np.linspace(-1.0, 1.0, size[0])
    grid = thing.contours(heights, size[1])
    outwards = grid - grid.mean(axis=1, keepdims=True)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    grid = grid + noise * HEIGHT * rng.normal(size=grid.shape)
    wrong = rng.random(grid.shape[:2]) < off
    grid[wrong] += OFF * HEIGHT * rng.choice([-1.0, 1.0], (wrong.sum(), 1)) * outwards[wrong]
    return heights, grid


def _least(call: Callable[[], object]) -> float:
    """The best of some calls, s: what a busy computer adds is not the method's."""
    return min(timeit.repeat(call, number=1, repeat=7))


def _time(name: str, call: Callable[[], object], most: float) -> Row:
    milliseconds = 1e3 * _least(call)
    return Row(f"{name}, ms", f"{milliseconds:.2f}", f"<= {most:g}", milliseconds <= most)


def _below(name: str, value: float, most: float) -> Row:
    return Row(name, f"{value:.3g}", f"<= {most:g}", value <= most)
