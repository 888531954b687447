"""Explorations along other axes: of objects that lean and stand aside, and of the same object.

An object that shows no axis of its own is sliced along the world's, and one whose principal axis
leans little too: turned, they are sliced in another direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from palpate.launch.bench_explore_scene import NOISY, Demand, leaning
from palpate.launch.bench_explore_trial import Explored, explore_object
from palpate.launch.bench_row import Row
from palpate.launch.explore_objects import OBJECTS, ExploreObject
from palpate.launch.one_thread import one_thread

LEAN, AWAY, LIFT = 25.0, 0.03, 0.07
"""Degrees, m, and m: enough above the floor for any object."""
TILTED, QUICK_TILTED = ("ellipsoid", "box", "bottle", "vase", "pear"), ("ellipsoid",)
MOST_TIMES = 1.2


class Turned(NamedTuple):
    """An object that is sliced along the world's axis all the same."""

    target: ExploreObject
    """The object."""
    degrees: float
    """By which it leans."""


def _cube(exponent: float) -> ExploreObject:
    described = {"size": [0.036, 0.036, 0.036], "exponents": [exponent, exponent]}
    solid = {"superquadric": described, "pose": {"position": [0.0, 0.0, 0.036]}}
    return ExploreObject("plain", solid)


TURNED: Mapping[str, Turned] = {
    "blunt cube": Turned(_cube(0.6), 45.0),
    "cube": Turned(_cube(0.4), 30.0),
    "box": Turned(OBJECTS["box"], 12.0),
    "tapered and bent": Turned(OBJECTS["tapered and bent"], 12.0),
    "lattice": Turned(OBJECTS["lattice"], 12.0),
}
QUICK_TURNED = ("blunt cube",)


def tilted_rows(quick: bool) -> Iterable[Row]:
    """Objects that lean and stand aside, over the same ones upright in the middle.

    Parameters
    ----------
    quick : bool
        Fewer objects.
    """
    with one_thread():
        for name in QUICK_TILTED if quick else TILTED:
            upright = explore_object(OBJECTS[name], NOISY, Demand())
            pose = leaning(LEAN, AWAY, LIFT)
            tilted = explore_object(OBJECTS[name], NOISY, Demand(), moved=pose)
            title = f"{name}: leaning by {LEAN:g} deg, {1e3 * AWAY:g} mm off"
            ratio = times(tilted, upright)
            yield Row(title, f"{ratio:.2f} x", f"<= {MOST_TIMES:g} x", ratio <= MOST_TIMES)


def direction_rows(quick: bool) -> Iterable[Row]:
    """Objects that are sliced in two directions: one error over the other, the larger on top.

    Parameters
    ----------
    quick : bool
        Fewer objects.
    """
    with one_thread():
        for name in QUICK_TURNED if quick else TURNED:
            target, degrees = TURNED[name]
            one = explore_object(target, NOISY, Demand())
            other = explore_object(target, NOISY, Demand(), moved=leaning(degrees, 0.0, LIFT))
            ratio = times(one, other)
            worst = max(ratio, 1.0 / ratio)
            title = f"{name}: sliced in directions {degrees:g} deg apart"
            yield Row(title, f"{worst:.2f} x", f"<= {MOST_TIMES:g} x", worst <= MOST_TIMES)


def times(one: Explored, other: Explored) -> float:
    """Chamfer distance over that of another run."""
    return one.score.chamfer / other.score.chamfer
