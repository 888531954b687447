from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.lattice.system import layers_of
from palpate.core.rebuild.loft.lofting import fit_contour_loft
from palpate.core.splines.bases import PeriodicBasis

TURN = 2 * np.pi * np.arange(24) / 24
RIM = np.column_stack([np.cos(TURN), np.sin(TURN)])


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
@pytest.mark.parametrize("poles", [(False, False), (True, True), (True, False)])
def test_layers_are_the_skin_itself_with_heights_to_a_millionth(
    count: int, poles: tuple[bool, bool]
) -> None:
    heights = np.linspace(-0.8, 0.8, count) if count > 1 else np.zeros(1)
    radius = np.sqrt(1 - heights**2)
    grid = radius[:, None, None] * RIM
    surface = fit_contour_loft(heights, grid, low=-1.0, high=1.0, pole=poles).surface

    layers = layers_of(surface)

    v, turns = np.linspace(0.0, 1.0, 50), np.arange(50) / 50
    low, high = surface.along.domain
    wanted = surface.places(low + (high - low) * v, turns)
    along = layers.basis.matrix(v).toarray()
    around = PeriodicBasis(layers.curves.shape[1]).matrix(turns).toarray()
    plane = np.einsum("nl,nk,lkd->nd", along, around, layers.curves)
    assert np.allclose(plane, wanted[:, :2], rtol=0, atol=1e-12)
    assert np.allclose(along @ layers.heights, wanted[:, 2], rtol=0, atol=4e-6)
    assert layers.pinned == poles
    assert (layers.basis.degree, layers.basis.domain) == (3, (0.0, 1.0))


def test_too_few_layers_are_refused() -> None:
    surface = fit_contour_loft([-0.5, 0.5], np.stack([RIM, RIM]), low=-1.0, high=1.0).surface

    with pytest.raises(ValueError, match="layers must be at least 4, got 3"):
        layers_of(surface, 3)
