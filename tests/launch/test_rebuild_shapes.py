from __future__ import annotations

import numpy as np
import pytest

from palpate.core.measure.nearest import nearest_points
from palpate.core.measure.solidity import solidity
from palpate.launch.rebuild_shapes import HEIGHT, SHAPES, truth_of


def test_there_are_eight_objects() -> None:
    assert len(SHAPES) == 8


@pytest.mark.parametrize("name", SHAPES)
def test_the_mesh_of_an_object_is_closed_and_its_contours_lie_on_it(name: str) -> None:
    shape, truth = SHAPES[name], truth_of(name)
    mesh = shape.true_mesh()
    found = solidity(mesh.vertices, mesh.faces)
    assert (found.watertight, found.genus, found.components) == (True, 0, 1)
    assert found.volume == truth.volume > 0.0
    assert mesh.vertices[:, 2].min() == pytest.approx(shape.low, abs=0.01)
    assert mesh.vertices[:, 2].max() == pytest.approx(shape.high, abs=0.01)
    assert shape.high - shape.low == pytest.approx(HEIGHT, rel=0.05)
    assert truth.floor < 0.01
    contours = shape.contours(np.linspace(shape.low + 0.5, shape.high - 0.5, 9), 24, 0.3)
    assert nearest_points(truth.surface.search, contours.reshape(-1, 3)).distances.max() < 0.05
    x, y = contours[..., 0], contours[..., 1]
    assert ((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1) > 0.0).all()


def test_a_mesh_is_not_off_from_itself_and_a_moved_one_is() -> None:
    truth, mesh = truth_of("vase"), SHAPES["vase"].true_mesh()
    same = truth.errors_of(mesh)
    assert same.chamfer < 1e-9
    assert abs(same.volume) < 1e-12
    moved = truth.errors_of(mesh._replace(vertices=mesh.vertices + [0.3, 0.0, 0.0]))
    assert 0.1 < moved.chamfer < 0.3
    assert moved.hausdorff <= 0.3 + 1e-9
