from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.crossing import STEEP, crossings
from palpate.core.touch.pad import Pad


def met(pad: Pad, surface: Floats, first: int = 0, last: int = 15) -> Floats:
    """Where a surface, seen along a pad tilted by 45 degrees, meets a slice."""
    _, y = pad.grid()
    rows = np.arange(16)[:, None]
    touched = (rows >= first) & (rows <= last) & np.ones((16, 16), bool)
    return crossings(pad, 0.8 * y + surface, surface, touched).places


@pytest.mark.parametrize(("first", "last"), [(0, 15), (7, 15), (0, 8), (6, 9), (5, 8), (7, 10)])
def test_a_cubic_surface_is_met_exactly_where_four_rows_are_touched(
    first: int, last: int, flat: Pad
) -> None:
    _, y = flat.grid()
    found = met(flat, 0.2e-3 + 6.0 * y**2 + 800.0 * y**3, first, last)
    place = found[0, 1]
    assert len(found) == 16
    assert 0.8 * place + 0.2e-3 + 6.0 * place**2 + 800.0 * place**3 == pytest.approx(0, abs=1e-15)
    assert np.allclose(found[:, 2], -0.8 * place, atol=1e-15)


@pytest.mark.parametrize(("first", "last"), [(7, 9), (6, 8)])
def test_a_parabola_is_met_exactly_where_three_rows_are_touched(
    first: int, last: int, flat: Pad
) -> None:
    _, y = flat.grid()
    found = met(flat, 0.1e-3 + 9.0 * y**2, first, last)
    place = found[0, 1]
    assert 0.8 * place + 0.1e-3 + 9.0 * place**2 == pytest.approx(0.0, abs=1e-15)


def test_a_line_is_met_exactly_where_two_rows_are_touched(flat: Pad) -> None:
    _, y = flat.grid()
    found = met(flat, 0.1e-3 - 0.1 * y, 7, 8)
    assert np.allclose(found[:, 1], -0.1e-3 / 0.7, atol=1e-17)


def test_an_edge_between_two_rows_moves_no_point_off_its_rows(flat: Pad) -> None:
    _, y = flat.grid()
    for place in np.linspace(-0.5e-3, 0.5e-3, 9):
        found = met(flat, 1.2 * np.maximum(y - place, 0.0) - 0.6 * y)
        assert len(found) == 16
        assert np.abs(found[:, 1]).max() <= 0.5e-3


def test_columns_are_met_in_their_order_and_once(flat: Pad) -> None:
    x, y = flat.grid()
    found = crossings(flat, np.sin(y / 1.1e-3), 0.0 * x, np.ones((16, 16), bool))
    assert np.array_equal(found.places[:, 0], x[0])
    assert np.allclose(found.places[:, 1], 0.0, atol=1e-5)
    assert found.columns.tolist() == list(range(16))
    assert (found.rows == 7).all()


def test_two_rows_that_differ_too_much_are_not_one_surface(flat: Pad) -> None:
    _, y = flat.grid()
    jump = np.where(y > 0, STEEP * flat.pitch, 0.0)
    assert len(crossings(flat, y, 0.99 * jump, np.ones((16, 16), bool)).places) == 16
    assert len(crossings(flat, y, 1.01 * jump, np.ones((16, 16), bool)).places) == 0


def test_nothing_touched_is_met_nowhere(flat: Pad) -> None:
    _, y = flat.grid()
    assert crossings(flat, y, y, np.zeros((16, 16), bool)).places.shape == (0, 3)


def test_where_columns_have_more_rows_those_with_two_are_left_out(flat: Pad) -> None:
    _, y = flat.grid()
    touched = np.zeros((16, 16), bool)
    touched[7:9] = True
    lonely = crossings(flat, y - 0.2e-3, 0.0 * y, touched)
    assert lonely.columns.tolist() == list(range(16))
    touched[6, 4:12] = True
    assert crossings(flat, y - 0.2e-3, 0.0 * y, touched).columns.tolist() == list(range(4, 12))


def test_where_few_columns_have_more_rows_those_with_two_are_kept(flat: Pad) -> None:
    _, y = flat.grid()
    touched = np.zeros((16, 16), bool)
    touched[7:9] = True
    touched[6, 4:9] = True
    assert len(crossings(flat, y - 0.2e-3, 0.0 * y, touched).columns) == 16
