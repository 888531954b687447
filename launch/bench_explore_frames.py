"""Explorations along other axes: of objects that lean and stand aside, and of the same object.

One exploration's error depends on its luck with the poses; so each ratio is one of means.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.launch.bench_explore_scene import NOISY, Demand, leaning
from palpate.launch.bench_explore_trial import explore_object
from palpate.launch.bench_row import Row
from palpate.launch.explore_objects import OBJECTS, ExploreObject
from palpate.launch.one_thread import one_thread

LEAN, AWAY, LIFT = 25.0, 0.03, 0.07
"""Degrees, m, and m: enough above the floor for any object."""
TILTED, QUICK_TILTED = ("ellipsoid", "box", "bottle", "vase", "pear"), ("ellipsoid",)
MOST_TIMES = 1.2
SEEDS, QUICK_SEEDS = 5, 1
"""Explorations of which a mean is taken."""


class Turned(NamedTuple):
    """An object that is sliced along another axis, too."""

    target: ExploreObject
    """The object."""
    degrees: float
    """By which that axis leans."""


def _cube(exponent: float) -> ExploreObject:
    described = {"size": [0.036, 0.036, 0.036], "exponents": [exponent, exponent]}
    solid = {"superquadric": described, "pose": {"position": [0.0, 0.0, 0.036]}}
    return ExploreObject("plain", solid)


TURNED: Mapping[str, Turned] = {
    "blunt cube": Turned(_cube(0.6), 45.0),
    "cube": Turned(_cube(0.4), 30.0),
    "ellipsoid": Turned(OBJECTS["ellipsoid"], 90.0),
    "box": Turned(OBJECTS["box"], 90.0),
    "tapered and bent": Turned(OBJECTS["tapered and bent"], 15.0),
    "lattice": Turned(OBJECTS["lattice"], 15.0),
}
QUICK_TURNED = ("blunt cube",)


def tilted_rows(quick: bool) -> Iterable[Row]:
    """Objects that lean and stand aside, over the same ones upright in the middle.

    Parameters
    ----------
    quick : bool
        Fewer objects, and one exploration of each.
    """
    pose = leaning(LEAN, AWAY, LIFT)
    with one_thread():
        for name in QUICK_TILTED if quick else TILTED:
            upright = mean_chamfer(OBJECTS[name], Demand(), quick)
            ratio = mean_chamfer(OBJECTS[name], Demand(), quick, pose) / upright
            title = f"{name}: leaning by {LEAN:g} deg, {1e3 * AWAY:g} mm off"
            yield Row(title, f"{ratio:.2f} x", f"<= {MOST_TIMES:g} x", ratio <= MOST_TIMES)


def direction_rows(quick: bool) -> Iterable[Row]:
    """Objects that are sliced in two directions: one error over the other, the larger on top.

    Parameters
    ----------
    quick : bool
        Fewer objects, and one exploration of each.
    """
    with one_thread():
        for name in QUICK_TURNED if quick else TURNED:
            target, degrees = TURNED[name]
            lean = math.radians(degrees)
            along = Demand(axis=(math.sin(lean), 0.0, math.cos(lean)))
            one, other = (mean_chamfer(target, each, quick) for each in (Demand(), along))
            worst = max(one / other, other / one)
            title = f"{name}: sliced in directions {degrees:g} deg apart"
            yield Row(title, f"{worst:.2f} x", f"<= {MOST_TIMES:g} x", worst <= MOST_TIMES)


def mean_chamfer(
    target: ExploreObject, demand: Demand, quick: bool, moved: Floats | None = None
) -> float:
    """Mean Chamfer distance of explorations that differ in their noise alone, m."""
    seeds = range(QUICK_SEEDS if quick else SEEDS)
    runs = (explore_object(target, NOISY, demand, seed=seed, moved=moved) for seed in seeds)
    return float(np.mean([run.score.chamfer for run in runs]))
