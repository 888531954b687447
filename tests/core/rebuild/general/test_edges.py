"""Sharp edges: found where touched points tell of both sides, and nowhere else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.geometry import nearest_points, nearest_search, self_intersection, solidity
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.rebuild.general import find_edges, rebuild_general, sharpened
from palpate.core.shapes import Mesh
from tests.core.rebuild.objects import contacts, only

NOISE = 0.02e-3
BENT = np.column_stack([0.4e-3 * np.ones(9), np.linspace(-0.012, 0.012, 9), -0.3e-3 * np.ones(9)])


def two_faces(lean: float, nearest: float = 0.3e-3, radius: float = 0.0) -> ContactPoints:
    """Points of two faces that meet along the y axis, each leaning by `lean` [rad].

    From a distance `nearest` on [m]; rounded with a radius [m]. Negative leans make a groove.
    """
    way, along = np.meshgrid(np.arange(nearest, 0.012, 0.7e-3), np.arange(-0.02, 0.02, 1e-3))
    way, along = way.ravel(), along.ravel()
    noise = NOISE * np.random.default_rng(0).normal(size=(2, len(way)))
    points, normals = [], []
    for side, off in zip((-1.0, 1.0), noise, strict=True):
        normal = np.array([side * math.sin(lean), 0.0, math.cos(lean)])
        down = np.array([side * math.cos(lean), 0.0, -math.sin(lean)])
        own = way[:, None] * down + along[:, None] * [0.0, 1.0, 0.0]
        facing = np.broadcast_to(normal, own.shape)
        if radius:  # the middle of the circle that touches both faces
            middle = own * [0.0, 1.0, 0.0] - [0.0, 0.0, radius / math.cos(lean)]
            around = own - middle
            around /= np.linalg.norm(around, axis=1, keepdims=True)
            is_round = way[:, None] < radius * math.tan(lean)
            own = np.where(is_round, middle + radius * around, own)
            facing = np.where(is_round, around, facing)
        points.append(own + off[:, None] * facing)
        normals.append(facing)
    return contacts(np.concatenate(points), np.concatenate(normals), np.arange(2 * len(way)))


@pytest.mark.parametrize("degrees", [30, 45, 60, -30, -45])
def test_edge_lies_where_both_faces_meet(degrees: float):
    lean = math.radians(degrees)
    found = find_edges(BENT, *two_faces(lean)[:2])
    assert found is not None and len(found.places) > 5
    assert np.abs(found.places[:, [0, 2]]).max() < 0.05e-3
    x, y = np.meshgrid(np.linspace(-3e-3, 3e-3, 14), np.linspace(-8e-3, 8e-3, 17))
    blunt = -np.sqrt(1e-6 + (x * math.tan(lean)) ** 2) * np.sign(lean)
    vertices = np.column_stack([x.ravel(), y.ravel(), blunt.ravel()])
    corner = np.arange(17 * 14).reshape(17, 14)[:-1, :-1].ravel()
    halves = ([0, 1, 15], [0, 15, 14])
    faces = np.concatenate([corner[:, None] + half for half in halves]).astype(np.int32)
    moved = sharpened(found, vertices, faces)
    near = np.abs(x.ravel()) < 2.5e-3 * math.cos(lean)
    wanted = -np.abs(moved[:, 0]) * math.tan(lean)
    assert moved[near, 2] == pytest.approx(wanted[near], abs=0.06e-3)
    on_edge = np.abs(moved[:, 0]) < 0.05e-3
    sides = np.where(on_edge, 0, np.sign(moved[:, 0]))[faces]
    assert on_edge.sum() >= 17 and (sides.max(axis=1) - sides.min(axis=1) < 2).all()
    untouched = vertices + [0.0, 0.0, 0.02]
    assert np.array_equal(sharpened(found, untouched, faces), untouched)


@pytest.mark.parametrize(
    "touched",
    [
        two_faces(math.radians(45), radius=3.0e-3),
        two_faces(math.radians(45), nearest=2.2e-3),  # it may be rounded: nobody touched it
        two_faces(math.radians(12)),
        only(two_faces(math.radians(45)), slice(680)),
    ],
    ids=["rounded", "untouched", "flat", "one side"],
)
def test_what_points_do_not_confirm_is_no_edge(touched: ContactPoints):
    assert find_edges(BENT, *touched[:2]) is None


def test_solid_of_a_box_has_its_edges():
    """Within a tenth of a millimetre, where the spline rounds them off; and it stays closed."""
    size, step = np.array([0.03, 0.024, 0.02]), 1.25e-3
    parts = []  # up to a quarter of a step from the edges
    for axis in range(3):
        across = [other for other in range(3) if other != axis]
        rows = [np.arange(0.25 * step, size[one], step) for one in across]
        grid = np.stack(np.meshgrid(*rows), axis=-1).reshape(-1, 2)
        for side in (0.0, 1.0):
            points = np.insert(grid, axis, side * size[axis], axis=1)
            normals = np.broadcast_to((2.0 * side - 1.0) * np.eye(3)[axis], points.shape)
            parts.append(contacts(points, normals, np.arange(len(points))))
    solid = rebuild_general(stack_points(parts), outward=True, pose=0.0)
    assert solid.edges is not None
    mesh = solid.mesh()
    body = solidity(*mesh)
    assert body.watertight and body.genus == 0 and not self_intersection(*mesh).count
    away = np.abs(np.linspace(0.0, size[0], 40)[:, None] * [1.0, 0.0, 0.0])
    for corner in ([0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]):
        places = away + size * corner
        off = {
            name: nearest_points(nearest_search(one.vertices[one.faces]), places).distances
            for name, one in (("sharp", mesh), ("spline", solid.rough_mesh))
        }
        assert np.quantile(off["sharp"], 0.9) < 0.1e-3 < 0.3e-3 < off["spline"].max()
        assert off["sharp"][[0, -1]].max() < 0.1e-3  # its corners
    assert isinstance(mesh, Mesh)
    assert abs(solid.closest([size * [0.5, 0.0, 0.0]]).distances[0]) < 0.1e-3


@pytest.mark.slow  # a fit of some 3,000 cells
def test_faces_of_a_block_do_not_move_with_their_touches():
    """A spline rounds its edges off: points there do not say how a touch is displaced."""
    rng, half, step = np.random.default_rng(0), np.array([0.03, 0.022, 0.025]), 8e-3
    touches = []
    for axis, side in ((axis, side) for axis in range(3) for side in (-1.0, 1.0)):
        across = [other for other in range(3) if other != axis]
        rows = [np.arange(0.5 * step - half[other], half[other], step) for other in across]
        for middle in np.stack(np.meshgrid(*rows), axis=-1).reshape(-1, 2):
            flat = middle + rng.uniform(-5e-3, 5e-3, (60, 2))
            flat = flat[(np.abs(flat) < half[across]).all(axis=1)]
            points = np.insert(flat, axis, side * half[axis], axis=1)
            normals = np.broadcast_to(side * np.eye(3)[axis], points.shape)
            touches.append(contacts(points + rng.normal(0.0, 0.1e-3, 3), normals))
    solid = rebuild_general(stack_points(touches), outward=True)
    places, off = solid.mesh().vertices, []
    for axis in range(3):
        across = [other for other in range(3) if other != axis]
        inner = (np.abs(places[:, across]) < half[across] - 4e-3).all(axis=1)
        off.append(np.abs(places[inner, axis]) - half[axis])
    assert np.sqrt(np.mean(np.concatenate(off) ** 2)) < 0.1e-3  # 0.2 mm if all points take part
