"""Whole explorations: error, cost, the stated bound, three fingers beside one, other axes.

One exploration's error depends on its luck with the poses; ratios are of means.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from palpate.bench.table import Row, at_most
from palpate.core import Floats, pose_of, rotations_from_vectors
from palpate.tools import single_threaded
from tests.studies.explored import EXPLORED_OBJECTS, ExploreObject, described
from tests.studies.harness import NOISY, Demand, Explored, explore_object

FINGERS = 3
FINGER_OBJECTS, QUICK_FINGERS = ("ellipsoid", "box", "vase", "bottle", "twist"), ("vase",)
MOST_TIME = 0.42  # Of one finger's
MOST_OFF = 0.05
LEAN, AWAY, LIFT = 25.0, 0.03, 0.07  # Degrees, m, and m: enough above the floor for any object
TILTED, QUICK_TILTED = ("ellipsoid", "box", "bottle", "vase", "pear"), ("ellipsoid",)
MOST_TIMES = 1.2
SEEDS, QUICK_SEEDS = 5, 1  # Explorations of which a mean is taken
# Sliced along another axis, too, that leans by so many degrees.
TURNED: Mapping[str, tuple[ExploreObject, float]] = {
    "blunt cube": (described(0.036, 0.036, 0.036, 0.6, 0.6), 45.0),
    "cube": (described(0.036, 0.036, 0.036, 0.4, 0.4), 30.0),
    "ellipsoid": (EXPLORED_OBJECTS["ellipsoid"], 90.0),
    "box": (EXPLORED_OBJECTS["box"], 90.0),
    "tapered and bent": (EXPLORED_OBJECTS["tapered and bent"], 15.0),
    "lattice": (EXPLORED_OBJECTS["lattice"], 15.0),
}
QUICK_TURNED = ("blunt cube",)


def finger_rows(quick: bool) -> Iterable[Row]:
    """Objects explored by three fingers at once and by one; fewer objects if quick."""
    errors: list[tuple[float, float]] = []
    with single_threaded():
        for name in QUICK_FINGERS if quick else FINGER_OBJECTS:
            one = explore_object(EXPLORED_OBJECTS[name], NOISY, Demand())
            several = explore_object(EXPLORED_OBJECTS[name], NOISY, Demand(), fingers=FINGERS)
            ratio = tracing_seconds(several) / tracing_seconds(one)
            title = f"{name}: {FINGERS} fingers, tracing after the first contour"
            yield at_most(title, ratio, MOST_TIME, ".2f", " x")
            total = several.score.robot_time / one.score.robot_time
            contours = f"{several.score.contours} for {one.score.contours}"
            yield Row(f"{name}: whole robot time, contours", f"{total:.2f} x, {contours}")
            yield Row(f"{name}: error", f"{several.percent:.3f} for {one.percent:.3f} %")
            errors.append((one.percent, several.percent))
    each = zip(*errors, strict=True)
    single, joint = (math.sqrt(sum(error**2 for error in some) / len(some)) for some in each)
    yield at_most("all: error, root mean square", joint / single, 1.0 + MOST_OFF, ".2f", " x")


def tracing_seconds(one: Explored) -> float:
    """Robot time from the end of the first contour to the end of the last, s."""
    ends = [contour.robot_time for contour in one.contours]
    return max(ends) - min(ends)


def tilted_rows(quick: bool) -> Iterable[Row]:
    """Objects that lean and stand aside, over the same ones upright in the middle."""
    pose = leaning(LEAN, AWAY, LIFT)
    with single_threaded():
        for name in QUICK_TILTED if quick else TILTED:
            upright = mean_chamfer(EXPLORED_OBJECTS[name], Demand(), quick)
            ratio = mean_chamfer(EXPLORED_OBJECTS[name], Demand(), quick, pose) / upright
            title = f"{name}: leaning by {LEAN:g} deg, {1e3 * AWAY:g} mm off"
            yield at_most(title, ratio, MOST_TIMES, ".2f", " x")


def leaning(degrees: float, away: float, lift: float) -> Floats:
    """Pose (7,) of an object that leans about the y axis and stands beside the world's, m."""
    turn = np.array([[0.0, np.radians(degrees), 0.0]])
    return pose_of(np.array([away, 0.0, lift]), rotations_from_vectors(turn)[0])


def direction_rows(quick: bool) -> Iterable[Row]:
    """Objects that are sliced in two directions: one error over the other, the larger on top."""
    with single_threaded():
        for name in QUICK_TURNED if quick else TURNED:
            target, degrees = TURNED[name]
            lean = math.radians(degrees)
            along = Demand(axis=(math.sin(lean), 0.0, math.cos(lean)))
            one, other = (mean_chamfer(target, each, quick) for each in (Demand(), along))
            title = f"{name}: sliced in directions {degrees:g} deg apart"
            yield at_most(title, max(one / other, other / one), MOST_TIMES, ".2f", " x")


def mean_chamfer(
    target: ExploreObject, demand: Demand, quick: bool, moved: Floats | None = None
) -> float:
    """Mean Chamfer distance of explorations that differ in their noise alone, m."""
    seeds = range(QUICK_SEEDS if quick else SEEDS)
    runs = (explore_object(target, NOISY, demand, seed=seed, moved=moved) for seed in seeds)
    return float(np.mean([run.score.chamfer for run in runs]))
