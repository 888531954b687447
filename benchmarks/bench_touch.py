"""One touch: cast, filter, curvature. Run with ``./go test benchmarks``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.core.frames import pad_rotation, pose_of
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.triangles import TriangleShape
from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.filters import adaptive_wiener, median_filter
from palpate.core.touch.pad import Pad, press

PAD = Pad(rows=16, cols=16, pitch=0.001, thickness=0.003, dome=1 / 0.015, saturation=0.8)
START = pose_of(np.array([0.1, 0.0, 0.01]), pad_rotation(0.0, 0.2))
BALL = Superquadric(np.full(3, 0.04), np.ones(2))
FINE = BALL.mesh(5)
SHAPES = {
    "superquadric": BALL,
    "mesh of 20k faces": TriangleShape(*FINE),
    "mesh of 20k faces, z-buffer": TriangleShape(*FINE, embree=False),
}


@pytest.mark.parametrize("name", SHAPES)
def bench_press(benchmark: Any, name: str) -> None:
    shape: Shape = SHAPES[name]
    assert benchmark(press, shape, PAD, START, 0.1, 0.001).outcome == "hit"


def bench_filters(benchmark: Any) -> None:
    image = press(BALL, PAD, START, 0.1, 0.001).compression
    benchmark(lambda: median_filter(adaptive_wiener(image, 1e-10), step=5e-4))


def bench_curvature(benchmark: Any) -> None:
    compression = press(BALL, PAD, START, 0.1, 0.001).compression
    touched = compression > 5e-5
    surface = np.where(touched, -(compression + PAD.sag()), 0.0)
    across = np.array([0.0, 1.0, 0.0])
    assert benchmark(feel_patch, PAD, surface, touched, across, 0.0).kind == "smooth"
