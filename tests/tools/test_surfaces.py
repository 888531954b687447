from __future__ import annotations

import numpy as np
import pytest

from palpate.tools.surfaces import hex_colour, scale_top, viridis


def test_viridis_is_that_of_matplotlib_to_a_fortieth():
    import matplotlib

    values = np.linspace(0.0, 1.0, 256)
    theirs = 255.0 * matplotlib.colormaps["viridis"](values)[:, :3]
    assert np.abs(viridis(values, 1.0) - theirs).max() < 6.0
    assert hex_colour(0.0, 2.0) == "#440154"
    assert hex_colour(5.0, 2.0) == "#fde725"


@pytest.mark.parametrize(
    ("most", "top"), [(0.00013, 0.00015), (0.0001, 0.0001), (0.9, 1.0), (0.0, 1e-6)]
)
def test_a_scale_ends_at_a_round_value_over_nearly_all(most, top):
    assert scale_top(np.linspace(0.0, most, 50) ** 0 * most) == pytest.approx(top)


def test_few_outliers_do_not_take_the_colours_from_all_others():
    values = np.full(1000, 1e-4)
    values[:5] = 1.0
    assert scale_top(values) == pytest.approx(1e-4)
