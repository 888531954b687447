"""What single calls cost: casts and presses of ten shapes, filters, jets and patches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from palpate.bench.table import Row, best_seconds
from palpate.core import pad_rotation, pose_of, split_pose
from palpate.core.shapes import (
    Bend,
    DeformedShape,
    DeformedSuperquadric,
    Shape,
    Superquadric,
    TriangleShape,
)
from palpate.core.splines import LatticeLayer, layered_lattice
from palpate.core.touch import (
    Pad,
    fit_patch,
    fit_robust_jet,
    guarded_move,
    remove_impulses,
)

CALLS, ROUNDS, QUICK_ROUNDS = 10, 30, 3
DOMED = Pad(rows=16, cols=16, pitch=0.001, thickness=0.003, dome=1 / 0.015, saturation=0.8)
FLAT = Pad(rows=16, cols=16, pitch=0.001, thickness=0.003, dome=0.0, saturation=0.8)
START = pose_of(np.array([0.1, 0.0, 0.01]), pad_rotation(0.0, 0.2))
NOISE = 10e-6  # m
ACROSS = np.array([0.0, 1.0, 0.0])


def cost_rows(quick: bool) -> Iterator[Row]:
    """A row for each call."""
    for name, call in {**_shape_calls(), **_frame_calls()}.items():
        seconds = best_seconds(
            lambda call=call: [call() for _ in range(CALLS)],  # type: ignore[misc]
            QUICK_ROUNDS if quick else ROUNDS,
        )
        yield Row(name, f"{1e6 * seconds / CALLS:.0f} us")


def _shape_calls() -> dict[str, Callable[[], object]]:
    _, axes = split_pose(START)
    origins = DOMED.transducers() @ axes.T + START[:3]
    calls: dict[str, Callable[[], object]] = {}
    for name, shape in cast_shapes().items():
        calls[f"cast, {len(origins)} rays: {name}"] = partial(
            shape.cast, origins, axes[:, 2], 0.104
        )
        calls[f"press: {name}"] = partial(guarded_move, shape, DOMED, START, 0.1, 0.001)
    return calls


def cast_shapes() -> Mapping[str, Shape]:
    """Ten shapes that a finger meets."""
    solid = Superquadric(np.array([0.04, 0.03, 0.05]), np.array([0.4, 0.7]))
    layers = [LatticeLayer(0.8), LatticeLayer(1.2, 0.2), LatticeLayer(), LatticeLayer(0.9)]
    lattice = layered_lattice(solid.bounds(), layers)
    return {
        "ball": Superquadric(np.full(3, 0.04), np.ones(2)),
        "superquadric": solid,
        "tapered": DeformedSuperquadric(solid, np.array([0.3, 0.3])),
        "tapered and bent": DeformedSuperquadric(solid, np.array([0.3, 0.1]), Bend(5.0, 0.5)),
        "lattice, facets": DeformedShape(solid, lattice),
        "lattice, exact": DeformedShape(solid, lattice, exact=True),
        "mesh of 20k faces": TriangleShape(*solid.mesh(5)),
        "mesh of 80k faces": TriangleShape(*solid.mesh(6)),
        "mesh of 5k faces, z-buffer": TriangleShape(*solid.mesh(4), embree=False),
        "mesh of 20k faces, z-buffer": TriangleShape(*solid.mesh(5), embree=False),
    }


def _frame_calls() -> dict[str, Callable[[], object]]:
    rng, (x, y) = np.random.default_rng(0), FLAT.grid()
    height = 0.5 * (x**2 + y**2) / 0.04 + NOISE * rng.normal(size=x.shape)
    image = 2.2e-3 - height
    impulses = np.where(rng.random(x.shape) < 0.08, 2.4e-3, image)
    edge = 0.5 * np.abs(x + 0.2 * y) + NOISE * rng.normal(size=x.shape)
    everywhere = np.ones((16, 16), bool)
    return {
        "impulses removed, a clean frame": lambda: remove_impulses(FLAT, image, 5e-5, NOISE),
        "impulses removed, 8 %": lambda: remove_impulses(FLAT, impulses, 5e-5, NOISE),
        "robust jet of a full pad": lambda: fit_robust_jet(FLAT, height, everywhere, NOISE),
        "patch of a full pad": lambda: fit_patch(FLAT, height, everywhere, ACROSS, NOISE),
        "patch of an edge": lambda: fit_patch(FLAT, edge, everywhere, ACROSS, NOISE),
    }
