"""The thesis's way of rebuilding, measured: its two examples repeated, and what loops cost."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.thesis.rebuild import rebuild_thesis
from palpate.core.rebuild.thesis.solid import ThesisSolid
from palpate.core.rebuild.thesis.triples import interpolated_parameters
from palpate.core.shapes.protocol import Mesh
from palpate.core.splines.invert import invert
from palpate.core.splines.volume import Volume
from palpate.launch.bench_row import Row
from palpate.launch.mesh_truth import Errors
from palpate.launch.thesis_examples import (
    COLUMNS,
    EXAMPLES,
    FIRST,
    FLOOR_COLUMNS,
    FLOOR_ROWS,
    ROWS,
    SIZE,
    loft,
    truth_of,
)

NOISE = 0.005
"""Of the object's height, along x and y."""
SIDE = 50
"""Rows and columns at which the thesis's program evaluates its surface."""
LOOPED, QUICK_LOOPED = 200, 40
"""Points that are done one at a time."""
ROUNDS = 5
LEAST_RATIO = 50.0


class Way(NamedTuple):
    """A way from contours to a mesh."""

    name: str
    """What it is called in the table."""
    build: Callable[[Floats], Mesh]
    """Contours (m, n, 3) to a mesh."""
    most: float
    """Chamfer distance that is demanded, over the height; infinite for comparison only."""


def thesis_rows(quick: bool) -> Iterable[Row]:
    """Errors of both examples, and the time of a loop over points against ours.

    Parameters
    ----------
    quick : bool
        Fewer points one at a time.
    """
    for example in EXAMPLES:
        truth, contours = truth_of(example), example.contours()
        floor = truth.errors_of(example.mesh(FLOOR_ROWS, FLOOR_COLUMNS))
        yield _row(f"{example.name}: floor", floor, np.inf)
        for way in WAYS:
            errors = truth.errors_of(way.build(contours))
            yield _row(f"{example.name}: {way.name}", errors, way.most)
    truth, contours = truth_of(FIRST), with_noise(FIRST.contours())
    for way in NOISY:
        errors = truth.errors_of(way.build(contours))
        yield _row(f"{FIRST.name}, noise: {way.name}", errors, way.most)
    ratio = loop_ratio(QUICK_LOOPED if quick else LOOPED)
    target = f">= {LEAST_RATIO:.0f} x"
    yield Row("contours to mesh, against a loop", f"{ratio:.0f} x", target, ratio >= LEAST_RATIO)


def with_noise(contours: Floats) -> Floats:
    """Contours (m, n, 3) with noise across the axis, still closed."""
    noisy = contours.copy()
    rng = np.random.default_rng(0)
    noisy[:, :-1, :2] += SIZE * NOISE * rng.normal(size=noisy[:, :-1, :2].shape)
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
    assert isinstance(undeformed, Volume)
    points = undeformed.at(solid.parameters.reshape(-1, 3))
    some = points[np.linspace(0, len(points) - 1, looped).astype(int)]
    places = np.random.default_rng(0).random((looped, 2))
    inverted = _seconds(lambda: [invert(undeformed, point[None]) for point in some], 1)
    evaluated = _seconds(lambda: [solid.surface(eta, nu) for eta, nu in places[..., None]], 1)
    loop = (inverted * len(points) + evaluated * SIDE**2) / looped
    return loop / _seconds(ours, ROUNDS)


def _seconds(call: Callable[[], object], rounds: int) -> float:
    """The best of some rounds: what a busy computer adds is not the method's."""
    times = []
    for _ in range(rounds):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return min(times)


def _row(name: str, errors: Errors, most: float) -> Row:
    found = f"{name}; normals {errors.normal_deg:.1f} deg, volume {errors.volume:+.1%}"
    target = f"<= {most:.2%}" if np.isfinite(most) else "for comparison"
    return Row(found, f"{errors.chamfer:.3%}", target, errors.chamfer <= most)


def _program(contours: Floats) -> Mesh:
    return rebuild_thesis(contours, faithful=True).mesh(ROWS, COLUMNS)


def _corrected(contours: Floats) -> Mesh:
    return rebuild_thesis(contours).mesh(ROWS, COLUMNS)


def _with_spline(contours: Floats) -> Mesh:
    solid = rebuild_thesis(contours)
    triples = interpolated_parameters(solid.parameters)
    return dataclasses.replace(solid, triples=triples).mesh(ROWS, COLUMNS)


def _finer(contours: Floats) -> Mesh:
    return rebuild_thesis(contours, layer=(7, 7)).mesh(ROWS, COLUMNS)


def _round(contours: Floats) -> Mesh:
    return rebuild_thesis(contours, exponents=(1.0, 1.0)).mesh(ROWS, COLUMNS)


WAYS = (
    Way("spline loft", loft, np.inf),
    Way("program", _program, 0.005),
    Way("corrected", _corrected, 0.0045),
    Way("with 4.3", _with_spline, 0.0045),
    Way("7 x 7 layers", _finer, 0.004),
    Way("ellipsoid", _round, np.inf),
)
NOISY = (
    Way("spline loft", loft, np.inf),
    Way("program", _program, np.inf),
    Way("corrected", _corrected, 0.005),
)
