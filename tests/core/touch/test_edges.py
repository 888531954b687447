from dataclasses import replace

import numpy as np
import pytest

from palpate.core.touch.curvature import fit_patch
from palpate.core.touch.edges import (
    curved_faces_deviation,
    fit_faces,
    isolated_outliers,
    slopes_of_cells,
)
from palpate.core.touch.jet import fit_jet
from tests.studies.curvature import VERDICTS, confusion, right_share

ALL = np.ones((16, 16), bool)
ACROSS = np.array([0.0, 1.0, 0.0])
# Seeds: the thresholds were chosen on the first, and have never seen the second.
TUNED_WITH, HELD_OUT = 0, 1234


def kind_of(pad, height, noise=5e-6):
    noisy = height + noise * np.random.default_rng(0).normal(size=height.shape)
    return fit_patch(pad, noisy, ALL, ACROSS, noise).kind


@pytest.mark.parametrize("seed", [TUNED_WITH, HELD_OUT])
def test_each_kind_is_called_by_its_name_19_times_of_20(seed):
    # Which kind a random touch truly is, and which touches are left out because some face
    # owns too few taxels to be measured, is stated in `draw_touch`.
    calls, _ = confusion(draws=60, seed=seed)
    assert sum(calls.values()) >= 600
    for kind in VERDICTS:
        assert sum(calls[kind, called] for called in VERDICTS) >= 40
        assert right_share(calls, kind) >= 0.95, (kind, calls)


def test_edges_corners_and_steps_are_told_apart(flat):
    x, y = flat.grid()
    cases = [
        ("edge", np.abs(x)),
        ("edge", 0.25 * np.abs(x)),
        ("edge", -0.5 * np.abs(x + 0.3 * y)),
        ("edge", np.where(x > 0, 1e-3, 0.0)),
        ("edge", np.where(x + y > 3e-3, 0.2e-3, 0.0)),
        ("corner", 0.5 * np.maximum(np.abs(x), np.abs(y))),
        ("corner", np.maximum(0.4 * x, np.maximum(0.3 * y - 0.2 * x, -0.4 * y - 0.2 * x))),
        ("corner", -np.maximum(0.4 * x, np.maximum(0.3 * y - 0.2 * x, -0.4 * y - 0.2 * x))),
        ("smooth", 0.5 * (x**2 + y**2) / 0.008),
        ("smooth", 0.3 * x - 0.2 * y),
        ("smooth", x * y / 0.02),
    ]
    for wanted, height in cases:
        assert kind_of(flat, height) == wanted


def test_a_step_through_the_middle_has_no_curvature_of_zero(flat):
    x, _ = flat.grid()
    patch = fit_patch(flat, np.where(x > 0, 1e-3, 0.0), ALL, ACROSS, 5e-6)
    assert patch.kind == "edge"
    assert patch.shape is None


def test_a_cylinders_rim_is_an_edge_although_one_face_is_curved(flat):
    x, y = flat.grid()
    side = (0.02 - np.sqrt(0.02**2 - y**2)) / 0.7 - 0.8 * x
    assert kind_of(flat, np.maximum(0.6 * x, side)) == "edge"


def test_a_rounded_edge_is_an_edge_and_a_wide_rounding_is_smooth(flat):
    x, _ = flat.grid()
    for blend, wanted in ((0.2e-3, "edge"), (8e-3, "smooth")):
        assert kind_of(flat, 0.5 * np.sqrt(x**2 + blend**2)) == wanted


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_verdicts_do_not_depend_on_the_unit(scale, flat):
    pad = replace(flat, pitch=scale * flat.pitch)
    x, y = pad.grid()
    roof = 0.4 * np.abs(x + 0.2 * y)
    corner = 0.5 * np.maximum(np.abs(x), np.abs(y))
    ball = 0.5 * (x**2 + y**2) / (0.03 * scale)
    found = [fit_patch(pad, h, ALL, ACROSS, 5e-6 * scale).kind for h in (roof, corner, ball)]
    assert found == ["edge", "corner", "smooth"]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_faces_are_found_with_their_slopes(side, flat):
    x, y = flat.grid()
    wanted = np.array([[0.5, 0.1], [-0.3, 0.2], [0.0, -0.4]])
    height = side * np.max([a * x + b * y for a, b in wanted], axis=0)
    cells = slopes_of_cells(flat, height, ALL)
    three = fit_faces(flat, height, ALL, cells, 3)
    assert three.deviation < 1e-15
    assert np.allclose(sorted((side * three.slopes).tolist()), sorted(wanted.tolist()), atol=1e-9)
    two = fit_faces(flat, height, ALL, cells, 2)
    assert two.deviation > 1e-5
    assert curved_faces_deviation(flat, height, ALL, two) < two.deviation


def test_too_few_squares_of_four_have_no_faces(flat):
    touched = np.zeros((16, 16), bool)
    touched[4:6, 4:6] = True
    cells = slopes_of_cells(flat, np.zeros((16, 16)), touched)
    assert cells.slopes.shape == (1, 2)
    assert fit_faces(flat, np.zeros((16, 16)), touched, cells, 2) is None


def test_a_comb_of_taxels_that_no_face_fits_is_an_edge_only_if_a_jet_misses_it(flat):
    comb = np.zeros((16, 16), bool)
    comb[::2] = True  # no square of four is touched
    rng = np.random.default_rng(0)
    rough = 0.1e-3 * rng.normal(size=comb.shape)
    assert fit_patch(flat, rough, comb, ACROSS, 1e-6).kind == "edge"
    assert fit_patch(flat, 0.12 * rough, comb, ACROSS, 1e-6).kind == "smooth"


NOISE = 10e-6


def find(pad, height):
    fit = fit_jet(pad, height, ALL)
    assert fit is not None
    return isolated_outliers(pad, height, ALL, fit, NOISE)


def surface(pad):
    x, y = pad.grid()
    return 0.5 * (x**2 + y**2) / 0.03 + NOISE * np.random.default_rng(0).normal(size=x.shape)


@pytest.mark.parametrize("places", [[(4, 4)], [(0, 0), (9, 12)], [(2, 3), (2, 5), (15, 15)]])
def test_up_to_three_single_taxels_are_outliers(places, flat):
    height = surface(flat)
    for place in places:
        height[place] += 0.4e-3
    found = find(flat, height)
    assert found is not None
    assert [tuple(place) for place in np.argwhere(found).tolist()] == places


def test_taxels_that_lie_together_are_a_face(flat):
    for others in ((4, 5), (5, 5), (5, 3)):
        height = surface(flat)
        height[4, 4] += 0.4e-3
        height[others] += 0.4e-3
        assert find(flat, height) is None


def test_many_are_no_outliers_and_neither_is_noise(flat):
    height = surface(flat)
    assert find(flat, height) is None
    height[::5, ::5] += 0.4e-3
    assert find(flat, height) is None
