from __future__ import annotations

import numpy as np
import pytest

from palpate.bench.objects.contoured import (
    REBUILT_SHAPES,
    ROUND_OBJECTS,
    SHAPE_HEIGHT,
    WAVY,
    RoundObject,
    truth_of,
)
from palpate.core.geometry.meshes import solidity
from palpate.core.geometry.nearest import nearest_points


def test_there_are_eight_objects() -> None:
    assert len(REBUILT_SHAPES) == 8


@pytest.mark.parametrize("name", REBUILT_SHAPES)
def test_the_mesh_of_an_object_is_closed_and_its_contours_lie_on_it(name: str) -> None:
    shape, truth = REBUILT_SHAPES[name], truth_of(name)
    mesh = shape.true_mesh()
    found = solidity(mesh.vertices, mesh.faces)
    assert (found.watertight, found.genus, found.components) == (True, 0, 1)
    assert found.volume == truth.volume > 0.0
    assert mesh.vertices[:, 2].min() == pytest.approx(shape.low, abs=0.01)
    assert mesh.vertices[:, 2].max() == pytest.approx(shape.high, abs=0.01)
    assert shape.high - shape.low == pytest.approx(SHAPE_HEIGHT, rel=0.05)
    assert truth.floor < 0.01
    contours = shape.contours(np.linspace(shape.low + 0.5, shape.high - 0.5, 9), 24, 0.3)
    assert nearest_points(truth.surface.search, contours.reshape(-1, 3)).distances.max() < 0.05
    x, y = contours[..., 0], contours[..., 1]
    assert ((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1) > 0.0).all()


def test_a_mesh_is_not_off_from_itself_and_a_moved_one_is() -> None:
    truth, mesh = truth_of("vase"), REBUILT_SHAPES["vase"].true_mesh()
    same = truth.errors_of(mesh)
    assert same.chamfer < 1e-9
    assert abs(same.volume) < 1e-12
    moved = truth.errors_of(mesh._replace(vertices=mesh.vertices + [0.3, 0.0, 0.0]))
    assert 0.1 < moved.chamfer < 0.3
    assert moved.hausdorff <= 0.3 + 1e-9


EVERY = [*ROUND_OBJECTS.values(), WAVY]
NAMES = [*ROUND_OBJECTS, "wavy"]


@pytest.mark.parametrize("thing", EVERY, ids=NAMES)
def test_contours_lie_on_their_object_counter_clockwise(thing: RoundObject) -> None:
    heights = np.linspace(-1.0, 1.0, 7)
    grid = thing.contours(heights, 48)
    assert np.abs(thing.distances(grid, heights)[0]).max() < 1e-13
    x, y = grid.transpose(2, 0, 1)
    assert ((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1) > 0.0).all()


@pytest.mark.parametrize("thing", EVERY, ids=NAMES)
def test_a_place_moved_along_the_normal_is_so_far_off(thing: RoundObject) -> None:
    heights = np.linspace(-0.8, 0.8, 5)
    grid, step = thing.contours(heights, 16), 1e-4
    out = grid - thing.axis(heights)[:, None]
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    off, area = thing.distances(grid + step * out, heights)
    assert (off > 0.0).all()
    assert (off <= step * (1 + 1e-3)).all()
    assert (area > 0.0).all()


def test_objects_have_the_height_of_2_and_differ() -> None:
    radii = [thing.radius(np.array(0.3), np.array(0.7)) for thing in ROUND_OBJECTS.values()]
    assert len(set(np.round(radii, 6))) == len(ROUND_OBJECTS)
