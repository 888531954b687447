"""The thesis's way of rebuilding: its two examples repeated, and what loops over points cost.

The examples stand in for the two objects that the thesis only draws: one turned and lobed, with
27 contours of 81 points at even heights, one smoother, with 24 contours of 41 points. The first
point of each contour comes again at its end, and each begins at azimuth -pi, as the thesis's
program needs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.bench.objects import WAVY, MeshErrors, TrueSurface, radial_rings, truth_of_mesh
from palpate.bench.table import Row, at_least, best_seconds
from palpate.core import Floats
from palpate.core.geometry import close_rings
from palpate.core.shapes import Mesh
from palpate.core.splines import SplineVolume, invert_points
from palpate.core.thesis import ThesisSolid, interpolated_parameters, rebuild_thesis

EXAMPLE_NOISE = 0.005  # Of the object's height, along x and y
SIDE = 50  # Rows and columns at which the thesis's program evaluates its surface
LOOPED, QUICK_LOOPED = 200, 40  # Points that are done one at a time
ROUNDS = 5
LEAST_RATIO = 50.0
# Height of both objects; all figures are over it, so that its unit does not matter.
EXAMPLE_HEIGHT = 2.0
MESH_ROWS, MESH_COLUMNS = 161, 240  # Of the meshes that are compared
TRUE_ROWS, TRUE_COLUMNS = 401, 720
# Of the truth, and of the other mesh of it that shows what measuring alone adds.
FLOOR_ROWS, FLOOR_COLUMNS = 301, 541


class ThesisVariant(NamedTuple):
    """A way from contours to a mesh."""

    name: str  # What it is called in the table
    build: Callable[[Floats], Mesh]  # Contours (m, n, 3) to a mesh
    most: float  # Chamfer distance that is demanded, over the height; infinite for comparison only


def thesis_rows(quick: bool) -> Iterable[Row]:
    """Errors of both examples, and the time of a loop over points against ours."""
    for example in EXAMPLES:
        truth, contours = example_truth(example), example.contours()
        floor = truth.errors_of(example.mesh(FLOOR_ROWS, FLOOR_COLUMNS))
        yield _row(f"{example.name}: floor", floor, np.inf)
        for way in VARIANTS:
            errors = truth.errors_of(way.build(contours))
            yield _row(f"{example.name}: {way.name}", errors, way.most)
    truth, contours = example_truth(FIRST), with_noise(FIRST.contours())
    for way in NOISY_VARIANTS:
        errors = truth.errors_of(way.build(contours))
        yield _row(f"{FIRST.name}, noise: {way.name}", errors, way.most)
    ratio = loop_ratio(QUICK_LOOPED if quick else LOOPED)
    yield at_least("contours to mesh, against a loop", ratio, LEAST_RATIO, ".0f", " x")


def example_truth(example: Example) -> TrueSurface:
    """The example's own surface, finely meshed; errors are over its height."""
    return truth_of_mesh(example.mesh(TRUE_ROWS, TRUE_COLUMNS), EXAMPLE_HEIGHT)


def _row(name: str, errors: MeshErrors, most: float) -> Row:
    found = f"{name}; normals {errors.normal_deg:.1f} deg, volume {errors.volume:+.1%}"
    target = f"<= {most:.2%}" if np.isfinite(most) else "for comparison"
    return Row(found, f"{errors.chamfer:.3%}", target, errors.chamfer <= most)


def with_noise(contours: Floats) -> Floats:
    """Contours (m, n, 3) with noise across the axis, still closed."""
    noisy = contours.copy()
    rng = np.random.default_rng(0)
    noisy[:, :-1, :2] += EXAMPLE_HEIGHT * EXAMPLE_NOISE * rng.normal(size=noisy[:, :-1, :2].shape)
    noisy[:, -1] = noisy[:, 0]
    return noisy


def loop_ratio(looped: int) -> float:
    """Seconds of a loop over points, over ours, for the same surface of the first example.

    The loop inverts each of the model's 27 x 81 points and evaluates each of 50 x 50 points by
    itself, as the thesis's program does; some of them are timed. Contours are fitted in the
    same way in both, and their time is left out of the loop's.
    """
    contours = FIRST.contours()

    def ours() -> ThesisSolid:
        solid = rebuild_thesis(contours)
        solid.mesh(SIDE, SIDE)
        return solid

    solid = ours()
    undeformed = solid.lattice.undeformed
    assert isinstance(undeformed, SplineVolume)
    points = undeformed.at(solid.parameters.reshape(-1, 3))
    some = points[np.linspace(0, len(points) - 1, looped).astype(int)]
    places = np.random.default_rng(0).random((looped, 2))
    inverted = best_seconds(lambda: [invert_points(undeformed, point[None]) for point in some], 1)
    evaluated = best_seconds(lambda: [solid.surface(eta, nu) for eta, nu in places[..., None]], 1)
    loop = (inverted * len(points) + evaluated * SIDE**2) / looped
    return loop / best_seconds(ours, ROUNDS)


class Example(NamedTuple):
    """An object and the contours that were traced of it."""

    name: str  # What it is called in tables and files
    # Distance of its surface from the z axis, by height (-1 to 1) and azimuth.
    radius: Callable[[Floats, Floats], Floats]
    heights: Floats  # Of its contours, (m,)
    around: int  # Points of a contour, the first twice

    def contours(self) -> Floats:
        """What a perfect finger traces, (m, around, 3)."""
        return self._rings(self.heights, np.linspace(-np.pi, np.pi, self.around))

    def mesh(self, rows: int, columns: int) -> Mesh:
        """The object itself, with plane ends."""
        azimuths = 2.0 * np.pi * np.arange(columns) / columns
        return _closed(self._rings(np.linspace(-1.0, 1.0, rows), azimuths))

    def _rings(self, heights: Floats, azimuths: Floats) -> Floats:
        radius = self.radius(heights[:, None], azimuths[None, :])
        return radial_rings(radius, heights, azimuths)


def _solid(contours: Floats, **how: Any) -> Mesh:
    return rebuild_thesis(contours, **how).mesh(MESH_ROWS, MESH_COLUMNS)


def _with_spline(contours: Floats) -> Mesh:
    solid = rebuild_thesis(contours)
    triples = interpolated_parameters(solid.parameters)
    return dataclasses.replace(solid, triples=triples).mesh(MESH_ROWS, MESH_COLUMNS)


def spline_loft(contours: Floats) -> Mesh:
    """The plain way: cubic splines through points of one number, around and then upwards.

    `contours` (m, n, 3): upwards, the first point of each again at its end. The ends are closed by
    planes.
    """
    return _closed(loft_rings(contours, contours[:, 0, 2], MESH_ROWS, MESH_COLUMNS))


def loft_rings(contours: Floats, heights: Floats, rows: int, columns: int) -> Floats:
    """Cubic splines through points of one number, around and then upwards, (rows, columns, 3).

    `contours` (m, n, 3): upwards, the first point of each again at its end. `heights` (m,): of the
    contours. `rows` and `columns`: how finely they are taken.
    """
    turns = np.arange(contours.shape[1]) / (contours.shape[1] - 1)
    around = CubicSpline(turns, contours[..., :2], axis=1, bc_type="periodic")
    along = CubicSpline(heights, around(np.arange(columns) / columns), axis=0)
    levels = np.linspace(heights[0], heights[-1], rows)
    flat = np.broadcast_to(levels[:, None, None], (rows, columns, 1))
    return np.concatenate([along(levels), flat], axis=-1)


def _closed(rings: Floats) -> Mesh:
    return Mesh(*close_rings(rings[0].mean(axis=0), rings, rings[-1].mean(axis=0)))


def _smooth(height: Floats, azimuth: Floats) -> Floats:
    outline = (1.02 - height**2) ** 0.35 * (0.8 + 0.1 * height)
    return np.asarray(outline * (1.0 + 0.15 * np.cos(2.0 * azimuth)))


VARIANTS = (
    ThesisVariant("spline loft", spline_loft, np.inf),
    ThesisVariant("program", partial(_solid, faithful=True), 0.005),
    ThesisVariant("corrected", _solid, 0.0045),
    ThesisVariant("with 4.3", _with_spline, 0.0045),
    ThesisVariant("7 x 7 layers", partial(_solid, layer=(7, 7)), 0.004),
    ThesisVariant("ellipsoid", partial(_solid, exponents=(1.0, 1.0)), np.inf),
)
NOISY_VARIANTS = (
    ThesisVariant("spline loft", spline_loft, np.inf),
    ThesisVariant("program", partial(_solid, faithful=True), np.inf),
    ThesisVariant("corrected", _solid, 0.005),
)
FIRST = Example("example 1", WAVY.radius, np.linspace(-1.0, 1.0, 27), 81)
SECOND = Example("example 2", _smooth, np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 24)), 41)
EXAMPLES = (FIRST, SECOND)
