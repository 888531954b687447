from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.ends import Ends, Touched, ends_along
from palpate.core.explore.grasp.misfit import corrected
from palpate.core.frames import pose_of
from palpate.core.rebuild.coarse import fit_coarse
from palpate.core.shapes.superquadric import Superquadric

Rotations = Callable[[int], Floats]
NOISE = 1e-4
HALF, RADIUS = 0.045, 0.025


def bottle(rng: np.random.Generator, count: int = 60) -> tuple[Floats, Floats]:
    """Contacts of the side of a body whose upper half is much narrower."""
    z, angle = rng.uniform(-0.8 * HALF, 0.9 * HALF, count), rng.uniform(0.0, 2 * np.pi, count)
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * z])
    radius = np.where(z > 0.0, 0.5 * RADIUS, RADIUS)
    return radius[:, None] * rim + z[:, None] * [0.0, 0.0, 1.0], rim


def ends(points: Floats, normals: Floats, lean: float = 0.0, rim: float = RADIUS) -> Ends:
    """Of a body that leans on its platform by its lower rim."""
    c, s = math.cos(lean), math.sin(lean)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    platform = -HALF * c - rim * s
    points, normals = points @ turn.T, normals @ turn.T
    found = fit_coarse(points, NOISE)
    solid = corrected(found.shape().mesh(3), points, found.residuals, found.rms, NOISE)
    pose = pose_of(np.zeros(3), turn)
    return ends_along(pose, solid, found, Touched(points, normals), platform)


@pytest.mark.parametrize("lean", [0.0, 0.4, 0.8])
def test_an_end_that_was_not_touched_is_where_the_platform_cuts_it_off(lean: float) -> None:
    found = ends(*bottle(np.random.default_rng(0)), lean)

    assert found.low == pytest.approx(-HALF, abs=1.5e-3)
    assert found.radius == pytest.approx(RADIUS, abs=1e-3)
    assert found.error > 2e-3


def test_an_end_that_was_touched_is_where_it_was_touched() -> None:
    points, normals = bottle(np.random.default_rng(1))
    top = np.array([[0.003, 0.0, HALF], [-0.004, 0.002, HALF]])
    found = ends(np.vstack([points, top]), np.vstack([normals, [[0.0, 0.0, 1.0]] * 2]))

    assert found.high == pytest.approx(HALF, abs=1e-9)


def test_a_round_end_that_was_touched_beside_its_pole_reaches_beyond() -> None:
    points, normals = bottle(np.random.default_rng(2))
    beside, radius = 0.3, 0.5 * RADIUS
    normal = np.array([[math.sin(beside), 0.0, math.cos(beside)]])
    top = radius * normal + [[0.0, 0.0, HALF - radius]]
    found = ends(np.vstack([points, top]), np.vstack([normals, normal]))

    assert found.high == pytest.approx(HALF, abs=0.1e-3)
    assert found.high > top[0, 2]


def test_a_leaning_contact_may_be_of_an_edge_and_the_error_says_so() -> None:
    points, normals = bottle(np.random.default_rng(3))
    normal = np.array([[math.sqrt(0.5), 0.0, math.sqrt(0.5)]])
    top = np.array([[0.5 * RADIUS, 0.0, HALF]])
    found = ends(np.vstack([points, top]), np.vstack([normals, normal]))

    assert HALF < found.high < HALF + 0.5 * RADIUS
    assert found.error > 0.5 * (found.high - HALF)


def test_a_solid_that_fits_tells_where_its_untouched_ends_are() -> None:
    shape = Superquadric(np.array([0.02, 0.028, 0.042]), np.ones(2))
    vertices, faces = shape.mesh(3)
    middles = vertices[faces].mean(axis=1)
    points = middles / shape.gauge(middles)[:, None]
    normals = points / np.square([0.02, 0.028, 0.042])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    side = np.flatnonzero(np.abs(points[:, 2]) < 0.03)[::8]
    found = fit_coarse(points[side], NOISE)
    solid = corrected(found.shape().mesh(4), points[side], found.residuals, found.rms, NOISE)
    seen = Touched(points[side], normals[side])
    given = ends_along(pose_of(np.zeros(3), np.eye(3)), solid, found, seen, -0.042)

    assert (given.low, given.high) == pytest.approx((-0.042, 0.042), abs=2e-4)
    assert given.error < 1.5e-3
