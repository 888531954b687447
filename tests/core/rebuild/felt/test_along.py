from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.rebuild.felt import along
from palpate.core.rebuild.felt.along import HALVED, SPANS, along_basis, bending_root, even_spans
from palpate.core.rebuild.felt.felt_skin import fit_skin
from palpate.core.rebuild.felt.spine import fit_spine
from palpate.core.rebuild.skin.bending import bending_along

Make = Callable[..., Any]


def test_spans_are_even_but_for_those_at_the_ends_which_are_halved_and_halved_again() -> None:
    breaks = np.unique(along_basis().knots)
    widths = np.diff(breaks) * SPANS
    assert len(widths) == SPANS + 2 * HALVED
    assert np.allclose(widths[: HALVED + 1], [1 / 16, 1 / 16, 1 / 8, 1 / 4, 1 / 2])
    assert np.allclose(widths, widths[::-1])
    assert np.allclose(widths[HALVED + 1 : -HALVED - 1], 1)
    assert np.array_equal(np.bincount(even_spans())[[0, 1, SPANS - 2, SPANS - 1]], [5, 1, 1, 5])


def test_bending_counts_on_a_span_by_the_third_power_of_its_width() -> None:
    parabola = along_basis().greville() ** 2
    even, counted = (root @ parabola for root in (bending_along(along_basis()), bending_root()))
    shares = counted**2 / even**2
    assert np.allclose(shares[:2], 1 / 16**3) and np.allclose(shares[len(shares) // 2], 1)


def blunt_error(oracle: Make) -> float:
    """Misfit along the normals next to the ends of a solid blunter than an ellipsoid, m."""
    solid = oracle([0.04, 0.025, 0.03], [0.5, 1.0])
    felt = solid.felt(np.concatenate([solid.section(s) for s in np.linspace(-0.995, 0.995, 133)]))
    skin = fit_skin(felt, fit_spine(np.array([0.0]), np.zeros((1, 2))), 0.0, 0.06)
    next_to_ends = np.abs(skin.rows.heights / 0.03 - 1.0) > 0.95
    return float(np.sqrt(np.mean(skin.misfits()[next_to_ends] ** 2)))


def test_halved_spans_follow_a_blunt_end_where_even_ones_swing(
    oracle: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    halved = blunt_error(oracle)
    tables = (along_basis, even_spans, bending_root)
    monkeypatch.setattr(along, "HALVED", 0)
    for table in tables:
        table.cache_clear()
    even = blunt_error(oracle)
    for table in tables:
        table.cache_clear()
    assert halved < 2e-6 < 1e-5 < even
