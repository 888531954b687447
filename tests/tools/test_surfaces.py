from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from palpate.launch import COLOURS, rgb
from palpate.tools.surfaces import hex_colour, scale_top, shades, viridis


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


def test_a_surface_is_light_where_its_value_is_nothing():
    values = np.array([-1.0, 0.0, 0.3, 1.0, 2.0])
    assert (shades(values, 1.0)[1:4] == viridis(1.0 - values[1:4], 1.0)).all()
    assert (shades(values, 1.0)[[0, 4]] == shades(values, 1.0)[[1, 3]]).all()


# What a colour becomes for people without red, green or blue cones (Machado et al., 2009, Table 1,
# severity 1), in linear RGB.
CONES = {
    "all": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def seen_as(quantity, cones):
    """Lightness and both hues in CIE 1976 L*a*b*, by formula."""
    share = np.array(rgb(quantity)) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    x, y, z = np.cbrt(XYZ @ np.clip(np.array(cones) @ linear, 0.0, 1.0) / XYZ.sum(axis=1))
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("cones", CONES)
def test_everybody_tells_the_colours_of_any_two_quantities_apart(cones):
    seen = [seen_as(quantity, CONES[cones]) for quantity in COLOURS]
    apart = [np.linalg.norm(one - other) for one, other in combinations(seen, 2)]
    assert min(apart) > 15.0  # 2.3 is just noticeable
