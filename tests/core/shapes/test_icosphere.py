from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.protocol import Mesh


@pytest.mark.parametrize("level", [0, 1, 2, 3, 5])
def test_each_level_splits_every_face_in_four(level: int) -> None:
    directions, faces = icosphere(level)
    assert directions.shape == (10 * 4**level + 2, 3)
    assert faces.shape == (20 * 4**level, 3)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize("level", [0, 1, 3])
def test_it_is_closed_and_every_face_looks_outwards(
    level: int, is_closed: Callable[[Mesh], bool]
) -> None:
    directions, faces = icosphere(level)
    assert is_closed(Mesh(directions, faces))
    a, b, c = directions[faces].transpose(1, 0, 2)
    assert (np.einsum("ni,ni->n", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_its_faces_are_nearly_even() -> None:
    directions, faces = icosphere(4)
    a, b, c = directions[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert area.max() / area.min() < 2.0  # 20 for rings of latitude


def test_it_is_the_same_object_each_time_and_cannot_be_written() -> None:
    directions, faces = icosphere(1)
    assert icosphere(1)[0] is directions
    with pytest.raises(ValueError, match="read-only"):
        directions[0, 0] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        faces[0, 0] = 2


@pytest.mark.parametrize("level", [-1, 9])
def test_levels_out_of_range_are_refused(level: int) -> None:
    with pytest.raises(ValueError, match=f"level must be between 0 and 8, got {level}"):
        icosphere(level)
