"""One touch: cast, filter, curvature. Run with ``./go test benchmarks``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.core.frames import pad_rotation, pose_of, split_pose
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.deformed import DeformedShape
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.triangles import TriangleShape
from palpate.core.shapes.warped import WarpedSuperquadric
from palpate.core.splines.layers import Layer, layered_lattice
from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.filters import median_then_wiener
from palpate.core.touch.pad import Pad, press

PAD = Pad(rows=16, cols=16, pitch=0.001, thickness=0.003, dome=1 / 0.015, saturation=0.8)
START = pose_of(np.array([0.1, 0.0, 0.01]), pad_rotation(0.0, 0.2))
BALL = Superquadric(np.full(3, 0.04), np.ones(2))
SOLID = Superquadric(np.array([0.04, 0.03, 0.05]), np.array([0.4, 0.7]))
TAPERED = WarpedSuperquadric(SOLID, np.array([0.3, 0.3]))
BENT = WarpedSuperquadric(SOLID, np.array([0.3, 0.1]), Bend(5.0, 0.5))
LATTICE = layered_lattice(SOLID.bounds(), [Layer(0.8), Layer(1.2, 0.2), Layer(), Layer(0.9)])
SHAPES: dict[str, Shape] = {
    "ball": BALL,
    "superquadric": SOLID,
    "tapered": TAPERED,
    "tapered and bent": BENT,
    "lattice, facets": DeformedShape(SOLID, LATTICE),
    "lattice, exact": DeformedShape(SOLID, LATTICE, exact=True),
    "mesh of 20k faces": TriangleShape(*SOLID.mesh(5)),
    "mesh of 80k faces": TriangleShape(*SOLID.mesh(6)),
    "mesh of 5k faces, z-buffer": TriangleShape(*SOLID.mesh(4), embree=False),
    "mesh of 20k faces, z-buffer": TriangleShape(*SOLID.mesh(5), embree=False),
}


@pytest.mark.parametrize("name", SHAPES)
def bench_cast(benchmark: Any, name: str) -> None:
    """256 rays."""
    _, axes = split_pose(START)
    origins = PAD.transducers() @ axes.T + START[:3]
    assert np.isfinite(benchmark(SHAPES[name].cast, origins, axes[:, 2], 0.104)).any()


@pytest.mark.parametrize("name", SHAPES)
def bench_press(benchmark: Any, name: str) -> None:
    assert benchmark(press, SHAPES[name], PAD, START, 0.1, 0.001).outcome == "hit"


def bench_filters(benchmark: Any) -> None:
    image = press(BALL, PAD, START, 0.1, 0.001).compression
    benchmark(median_then_wiener, image, 1e-10)


def bench_curvature(benchmark: Any) -> None:
    compression = press(BALL, PAD, START, 0.1, 0.001).compression
    touched = compression > 5e-5
    surface = np.where(touched, -(compression + PAD.sag()), 0.0)
    across = np.array([0.0, 1.0, 0.0])
    assert benchmark(feel_patch, PAD, surface, touched, across, 0.0).kind == "smooth"
