"""Free-form deformation as in section 5.3.1 of the thesis: what a zig-zag lattice does and costs.

An ellipsoid lies in a lattice that is bent to a zig-zag.
What the thesis shows by one picture each is counted here as the lattice grows: how well the body
follows the lattice with a Bernstein basis and with cubic NURBS (their weights one, for the thesis
names none), and what each costs. The zig-zag's layers are shifted in turn; below, the lattice is
drawn out and gets narrower linearly. Lengths are over the half height of the ellipsoid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.bench.table import Row, figure
from palpate.core import Floats, splines, thesis
from palpate.core.shapes import Superquadric
from palpate.tools import single_threaded
from tests.studies.timing import best_seconds

SIZES = ((4, 4, 10), (6, 6, 20), (8, 8, 40))  # Control points along x, y and z
LEVEL, QUICK_LEVEL = 5, 4  # Of the ellipsoid's mesh
HALVES = np.array([0.5, 0.4, 1.0])  # Of the ellipsoid
MARGIN = 1.1  # Of the lattice's box over the ellipsoid's
CORNERS = np.array([-1.1, -0.3, 0.0, 0.3, 0.6, 0.9, 1.1])  # Heights of the zig-zag's corners
SHIFTS = np.array([0.0, 0.0, 0.3, -0.3, 0.3, -0.3, 0.0])  # Along x
DRAWN, NARROW = 1.6, 0.5  # Below the zig-zag: times as long, and so wide at the bottom
HEIGHTS = 400  # Of the middle line at which it is compared with the lattice's
DEFORM_ROUNDS = 3


class Deformed(NamedTuple):
    """A lattice before and after, and how parameters of points (n, 3) are found in the first."""

    before: splines.SplineVolume
    after: splines.SplineVolume
    invert: Callable[[splines.SplineVolume, Floats], Floats]

    def points(self, points: Floats) -> Floats:
        """Points (n, 3) that were deformed."""
        return self.after.at(self.invert(self.before, points))


def deformation_rows(quick: bool) -> Iterator[Row]:
    """How far the middle line is from the zig-zag, and times; a coarser mesh if quick."""
    points = Superquadric(HALVES, np.ones(2)).mesh(QUICK_LEVEL if quick else LEVEL).vertices
    yield Row("points that are deformed", str(len(points)))
    with single_threaded():
        for size in SIZES:
            head, times = " x ".join(map(str, size)), dict[tuple[str, str], float]()
            for basis, whose in INVERSIONS:
                way = zigzagged(size, basis, whose)
                if whose == "palpate":
                    title = f"{head}, {basis}: middle line off the zig-zag"
                    yield figure(title, straying(way), ".1%", " of amplitude")
                seconds = times[basis, whose] = best_seconds(
                    partial(way.points, points), DEFORM_ROUNDS
                )
                yield figure(f"{head}, {basis}, {whose}", 1e3 * seconds, ".1f", " ms")
            for whose in ("thesis", "palpate"):
                ratio = times["NURBS", whose] / times["Bernstein", whose]
                title = f"{head}, {whose}: NURBS over Bernstein"
                yield figure(title, ratio, ".2f", " x", kind="time")


def straying(way: Deformed) -> float:
    """Root mean square distance along x of the middle line from the zig-zag, over its amplitude."""
    heights = np.linspace(CORNERS[1], 1.0, HEIGHTS)
    line = np.column_stack([np.zeros(HEIGHTS), np.zeros(HEIGHTS), heights])
    found = way.points(line)
    wanted = np.interp(found[:, 2], CORNERS, SHIFTS)
    return float(np.sqrt(((found[:, 0] - wanted) ** 2).mean()) / SHIFTS.max())


def zigzag(control: Floats) -> Floats:
    """Control points (..., 3) moved to the zig-zag and drawn out below it."""
    moved, height = control.copy(), control[..., 2]
    below = np.clip((CORNERS[1] - height) / (CORNERS[1] - CORNERS[0]), 0.0, 1.0)
    moved[..., :2] *= (1.0 - (1.0 - NARROW) * below)[..., None]
    moved[..., 0] += np.interp(height, CORNERS, SHIFTS)
    moved[..., 2] -= (DRAWN - 1.0) * np.maximum(CORNERS[1] - height, 0.0)
    return moved


def zigzagged(size: tuple[int, int, int], basis: str, whose: str) -> Deformed:
    """A lattice with control points at even steps, (2.19), as the thesis has it, or as Greville."""
    degrees = [count - 1 if basis == "Bernstein" else splines.CUBIC for count in size]
    s, t, u = (splines.clamped_basis(*pair) for pair in zip(size, degrees, strict=True))
    even = whose == "thesis"
    control = BOX.even_control(size) if even else BOX.greville_control((s, t, u))
    weights = None if basis == "Bernstein" else np.ones(size)
    before, after = (
        splines.SplineVolume(places, (s, t, u), weights) for places in (control, zigzag(control))
    )
    return Deformed(before, after, INVERSIONS[basis, whose])


def _closed_form(volume: splines.SplineVolume, points: Floats) -> Floats:
    return BOX.local(points)  # (2.18): even steps are a Bernstein basis' Greville abscissae


def _newton(volume: splines.SplineVolume, points: Floats) -> Floats:
    return thesis.invert_thesis(volume, points).parameters


def _exact(volume: splines.SplineVolume, points: Floats) -> Floats:
    return splines.invert_points(volume, points).parameters


BOX = splines.upright_parallelepiped(-MARGIN * HALVES, 2.0 * MARGIN * HALVES)
INVERSIONS: dict[tuple[str, str], Callable[[splines.SplineVolume, Floats], Floats]] = {
    ("Bernstein", "thesis"): _closed_form,
    ("NURBS", "thesis"): _newton,
    ("Bernstein", "palpate"): _exact,
    ("NURBS", "palpate"): _exact,
}
