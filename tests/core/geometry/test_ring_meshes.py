from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.geometry.meshes import solidity
from palpate.core.geometry.ring_meshes import close_rings, join_rings
from palpate.core.shapes.protocol import Mesh


def stack(count: int, size: int) -> Mesh:
    """Rings of an upright cylinder of radius 1 and height 2, closed."""
    turn = 2 * np.pi * np.arange(size) / size
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = np.stack([np.column_stack([rim, np.full(size, z)]) for z in np.linspace(-1, 1, count)])
    return Mesh(*close_rings(np.array([0, 0, -1.0]), rings, np.array([0, 0, 1.0])))


@pytest.mark.parametrize("count", [2, 3, 20])
@pytest.mark.parametrize("size", [3, 4, 50])
def test_rings_become_a_closed_surface_without_handles(
    count: int, size: int, is_closed: Callable[[Mesh], bool]
) -> None:
    mesh = stack(count, size)
    assert mesh.vertices.shape == (count * size + 2, 3)
    assert mesh.faces.shape == (2 * count * size, 3)
    assert mesh.faces.dtype == np.int32
    assert is_closed(mesh)


def test_faces_look_outwards(signed_volume: Callable[[Mesh], float]) -> None:
    polygon = 0.5 * 50 * np.sin(2 * np.pi / 50)
    assert signed_volume(stack(5, 50)) == pytest.approx(2 * polygon)
    mesh = stack(5, 50)
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert (np.einsum("ni,ni->n", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_a_single_ring_is_a_closed_disc(is_closed: Callable[[Mesh], bool]) -> None:
    assert is_closed(stack(1, 8))


@pytest.mark.parametrize(
    "sizes", [[3], [8, 8], [4, 8, 16, 16, 8, 4], [16, 8], [8, 16], [12, 6, 3, 6, 12]]
)
def test_rings_are_joined_without_holes_and_face_outwards(sizes: list[int]) -> None:
    rings = []
    for height, size in enumerate(sizes, 1):
        angle = 2 * np.pi * np.arange(size) / size
        rings.append(np.column_stack([np.cos(angle), np.sin(angle), np.full(size, height)]))
    top = [0.0, 0.0, len(sizes) + 1.0]

    found = solidity(np.concatenate([[[0.0, 0.0, 0.0]], *rings, [top]]), join_rings(sizes))

    assert found[:3] == (True, 1, 0)
    assert found.volume > 0.0


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        ([], "sizes must be at least one ring of 3 points"),
        ([8, 2], "sizes must be at least one ring of 3 points"),
        ([8, 6], "sizes of neighbours must be equal, half or twice, got 8 and 6"),
        ([8, 32], "sizes of neighbours must be equal, half or twice"),
    ],
)
def test_rings_that_do_not_fit_each_other_are_refused(sizes: list[int], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        join_rings(sizes)
