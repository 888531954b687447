"""What contours begun anywhere, points that stray and steps cost when a solid is rebuilt."""

from __future__ import annotations

import timeit
from collections.abc import Iterable

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.solid import Solid
from palpate.launch.bench_row import Row
from palpate.launch.rebuild_objects import OBJECTS, RoundObject

SIZES = ((27, 81), (24, 41), (9, 24))
"""Contours, and points of each."""
NOISE, OFF, SHARE = 0.004, 0.06, 0.02
"""Standard deviation of a coordinate, and how far which share of points stray; heights are 2."""
SEEDS, QUICK_SEEDS = 4, 1
SPREAD = 100
"""Between the seeds of objects, so that they do not share their noise."""
LAST = 0.99
"""Height of the last contours, on either side."""
ROWS, COLUMNS = 181, 97
"""Places at which a side is compared with the truth."""
WIDE, NARROW, AT = 0.6, 0.36, 0.12
"""Radii of a cylinder that steps, and where."""
STEPS = 16
"""Random stacks of its contours."""


def contour_rows(quick: bool) -> Iterable[Row]:
    """Figures of what contours may be like.

    Parameters
    ----------
    quick : bool
        Fewer runs.
    """
    seeds = QUICK_SEEDS if quick else SEEDS
    for size in SIZES:
        name = f"{size[0]} by {size[1]}"
        yield _below(f"{name}, begun anywhere: error over as recorded", starts(size, seeds), 1.03)
        yield _below(f"{name}, 2 % of points stray: error over without", strays(size, seeds), 1.1)
    most = max(step_swing(seed) for seed in range(STEPS))
    yield _below("a step: side beyond its radii, over the width", most, 0.05)
    yield from _times()


def starts(size: tuple[int, int], seeds: int) -> float:
    """Error of contours begun anywhere, in either direction, of any count, over recorded ones."""
    return _ratio(size, seeds, anyhow=True, share=0.0)


def strays(size: tuple[int, int], seeds: int) -> float:
    """Error with single points far off over that without them."""
    return _ratio(size, seeds, anyhow=False, share=SHARE)


def step_swing(seed: int) -> float:
    """How far the side leaves the two radii of a step, over the width."""
    rng = np.random.default_rng(seed)
    near = AT + np.concatenate([rng.uniform(-0.06, 0.0, 2), 0.002 + rng.uniform(0.0, 0.06, 2)])
    heights = np.concatenate([rng.uniform(-LAST, LAST, 12), near])
    angle = 2.0 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(60)])
    contours = [(WIDE if z < AT + 0.001 else NARROW) * rim + [0.0, 0.0, z] for z in heights]
    side = _side(_rebuilt(contours), np.linspace(-LAST, LAST, 997))
    radius = np.linalg.norm(side, axis=2)
    return float(max(radius.max() - WIDE, NARROW - radius.min())) / (2.0 * WIDE)


def _ratio(size: tuple[int, int], seeds: int, *, anyhow: bool, share: float) -> float:
    """Geometric mean over objects of the error in one case over that of plain contours."""
    logs = []
    for number, thing in enumerate(OBJECTS.values()):
        plain, other = 0.0, 0.0
        for seed in range(SPREAD * number, SPREAD * number + seeds):
            plain += _error(thing, _contours(thing, size, seed, anyhow=False, share=0.0))
            other += _error(thing, _contours(thing, size, seed, anyhow=anyhow, share=share))
        logs.append(np.log(other / plain))
    return float(np.exp(np.mean(logs)))


def _contours(
    thing: RoundObject, size: tuple[int, int], seed: int, *, anyhow: bool, share: float
) -> list[Floats]:
    """Noisy contours (n, 3), the noise the same for one seed as far as counts are."""
    rng, other = np.random.default_rng(seed), np.random.default_rng(seed + 1000)
    found = []
    for z in np.linspace(-LAST, LAST, size[0]):
        many = int(size[1] * other.uniform(0.8, 1.25)) if anyhow else size[1]
        angle = 2.0 * np.pi * (np.arange(many) / many + (other.random() if anyhow else 0.0))
        radius = thing.radius(np.full(many, z), angle)[:, None]
        plane = thing.axis(np.array(z)) + radius * np.stack([np.cos(angle), np.sin(angle)], -1)
        points = np.column_stack([plane, np.full(many, z)])
        points += NOISE * rng.normal(size=points.shape)
        away = other.normal(size=points.shape)
        away *= OFF / np.linalg.norm(away, axis=1, keepdims=True)
        points += away * (other.random(many) < share)[:, None]
        found.append(points[:: other.choice([-1, 1]) if anyhow else 1])
    return found


def _rebuilt(contours: list[Floats]) -> Solid:
    return reconstruct(contours, method="skin", tops=[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])


def _side(solid: Solid, heights: Floats) -> Floats:
    """Places (m, COLUMNS, 2) of the side at heights (m,)."""
    if solid.closed is None:
        raise ValueError("solid must have a skin, got none")
    return solid.closed.skin.at(heights[:, None], np.arange(COLUMNS) / COLUMNS)


def _error(thing: RoundObject, contours: list[Floats]) -> float:
    """Mean distance of the side from the object."""
    heights = np.linspace(-LAST, LAST, ROWS)
    off, area = thing.distances(_side(_rebuilt(contours), heights), heights)
    return float((np.abs(off) * area).sum() / area.sum())


def _times() -> Iterable[Row]:
    contours = _contours(OBJECTS["screw"], SIZES[0], 0, anyhow=False, share=0.0)
    before = _rebuilt(contours[:-1])
    for name, run, most in (
        ("27 by 81, all at once", lambda: _rebuilt(contours), np.inf),
        ("27 by 81, one contour more", lambda: before.update(contours[-1]), 10.0),
    ):
        took = 1e3 * min(timeit.repeat(run, number=1, repeat=7))
        target = f"at most {most:g} ms" if np.isfinite(most) else ""
        yield Row(name, f"{took:.1f} ms", target, took <= most)


def _below(name: str, value: float, most: float) -> Row:
    return Row(name, f"{value:.3g}", f"at most {most:g}", value <= most)
