"""Points of superquadrics that stand anywhere, and how far a model is from the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.distances import sample_surface
from palpate.core.geometry.nearest import nearest_points, nearest_search
from palpate.core.poses import pose_of, transform_points
from palpate.core.rebuild.recovery.report import Recovery
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.protocol import PosedShape, Shape
from palpate.core.shapes.superquadrics import Superquadric

LEVEL, SAMPLES = 3, 500


class Cloud(NamedTuple):
    """Points of a solid, and the solid."""

    points: Floats
    truth: PosedShape
    diameter: float


def cloud(
    size: Sequence[float],
    exponents: Sequence[float],
    *,
    count: int = 60,
    noise: float = 0.005,
    seed: int = 0,
    taper: Sequence[float] = (0.0, 0.0),
    bend: Bend | None = None,
    turned: bool = True,
) -> Cloud:
    """Points where rays meet the solid, with noise that is a share of its diameter."""
    rng, bending = np.random.default_rng(seed), bend or Bend(0.0)
    base = Superquadric(np.array(size), np.array(exponents))
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes[:, 0] *= np.linalg.det(axes)
    pose = pose_of(rng.normal(size=3), axes if turned else np.eye(3))
    solid = DeformedSuperquadric(base, np.array(taper), bending)
    rays = rng.normal(size=(count, 3)) * base.size
    tapering = Taper(float(taper[0]), float(taper[1]), float(size[2]))
    points = bending(tapering(rays / base.gauge(rays)[:, None]))
    diameter = float(np.ptp(solid.mesh(LEVEL).vertices, axis=0).max())
    points = points + noise * diameter * rng.normal(size=points.shape)
    return Cloud(transform_points(pose, points), PosedShape(solid, pose), diameter)


def chamfer(found: Recovery, made: Cloud) -> float:
    """Mean of the mean distances both ways, as a share of the diameter."""
    model, truth = (_triangles(shape) for shape in (found.shape(), made.truth))
    return 0.5 * (_mean_distance(model, truth) + _mean_distance(truth, model)) / made.diameter


def _triangles(shape: Shape) -> Floats:
    vertices, faces = shape.mesh(LEVEL)
    return vertices[faces]


def _mean_distance(source: Floats, target: Floats) -> float:
    samples = sample_surface(source, SAMPLES, np.random.default_rng(0)).points
    return float(nearest_points(nearest_search(target), samples).distances.mean())


@pytest.fixture(name="cloud")
def cloud_fixture() -> Callable[..., Cloud]:
    return cloud


@pytest.fixture(name="chamfer")
def chamfer_fixture() -> Callable[[Recovery, Cloud], float]:
    return chamfer
