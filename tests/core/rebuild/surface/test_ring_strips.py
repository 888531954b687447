from __future__ import annotations

import numpy as np
import pytest

from palpate.core.measure.solidity import solidity
from palpate.core.rebuild.surface.ring_strips import join_rings


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
