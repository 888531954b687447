"""Verdicts on a touched surface: smooth, edge, corner, insufficient or a miss."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch import Patch, fit_patch
from tests.core.touch.surfaces import SURFACES, draw_touch
from tests.core.touch.touches import FLAT, X, Y

ALL, ALONG_Y = np.ones((16, 16), bool), np.array([0.0, 1.0, 0.0])
RNG = np.random.default_rng(0)


def test_each_kind_is_called_by_its_name_19_times_of_20():
    rng, calls = np.random.default_rng(1234), Counter()
    for known in (draw_touch(rng, name) for name in SURFACES for _ in range(30)):
        height = known.pad.surface(known.compression, known.touched)
        found = fit_patch(known.pad, height, known.touched, ALONG_Y, known.noise)
        calls[known.kind, found.kind] += 1
    kinds = Counter(kind for kind, _ in calls.elements())
    for kind in ("smooth", "edge", "corner"):
        assert calls[kind, kind] >= 0.95 * kinds[kind], calls


ROOF, SQUARE = np.abs(X), np.maximum(np.abs(X), np.abs(Y))
THREE = np.maximum(0.4 * X, np.maximum(0.3 * Y - 0.2 * X, -0.4 * Y - 0.2 * X))
SIDE = (0.02 - np.sqrt(0.02**2 - Y**2)) / 0.7 - 0.8 * X  # of a cylinder
BOARD = (np.add.outer(range(16), range(16)) % 2).astype(bool)
CASES = [
    ("edge", ROOF),
    ("edge", -ROOF),
    ("edge", 0.25 * ROOF),
    ("edge", -0.5 * np.abs(X + 0.3 * Y)),
    ("edge", np.where(X > 0, 1e-3, 0.0)),
    ("edge", np.where(X + Y > 3e-3, 0.2e-3, 0.0)),
    ("edge", np.maximum(0.6 * X, SIDE)),  # a cylinder's rim, although one face is curved
    ("edge", 0.5 * np.sqrt(X**2 + 0.2e-3**2)),  # rounded to 0.4 mm
    ("edge", 0.5 * 501.0 * X**2),  # it curves within two pitches, however well a jet fits
    ("edge", np.where(BOARD, 0.0, 2e-4)),  # a board of touches that differ in height
    ("corner", SQUARE),
    ("corner", 0.5 * SQUARE),
    ("corner", THREE),
    ("corner", -THREE),
    ("smooth", 0.5 * (X**2 + Y**2) / 0.008),
    ("smooth", 0.3 * X - 0.2 * Y),
    ("smooth", X * Y / 0.02),
    ("smooth", 0.5 * np.sqrt(X**2 + 8e-3**2)),  # a wide rounding
    ("smooth", 0.5 * 499.0 * X**2),
]


@pytest.mark.parametrize(("kind", "height"), CASES)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_verdicts_do_not_depend_on_noise_turn_or_unit(kind, height, scale):
    pad = replace(FLAT, pitch=scale * FLAT.pitch)
    noisy = height + 2e-6 * np.random.default_rng(0).normal(size=height.shape)
    for frame, noise in ((height, 2e-6), (noisy, 2e-6), (noisy[::-1].T, 2e-6)):
        patch = fit_patch(pad, scale * np.ascontiguousarray(frame), ALL, ALONG_Y, scale * noise)
        assert patch.kind == kind


@pytest.mark.parametrize("height", [ROOF, SQUARE, np.where(X > 0, 1e-3, 0.0), -ROOF])
def test_edges_and_corners_have_a_normal_and_no_curvature(height):
    patch = fit_patch(FLAT, height, ALL, ALONG_Y, 10e-6)
    assert patch.kind in ("edge", "corner") and patch.jet is not None
    assert patch.principal == patch.principal_error == (0.0, 0.0)
    assert patch.across == patch.across_error == patch.gaussian == patch.mean == 0.0
    assert patch.umbilic and patch.shape is patch.shape_covariance is None
    assert (patch.principal_direction == 0.0).all() and 0.0 <= patch.confidence < 0.5
    assert patch.residual > 40e-6 and 0.0 < patch.normal_error < math.pi


def test_a_comb_is_an_edge_where_a_jet_misses_it():
    comb = np.zeros((16, 16), bool)
    comb[::2] = True  # no square of four is touched
    rough = 0.1e-3 * np.random.default_rng(0).normal(size=comb.shape)
    for share, kind in ((1.0, "edge"), (0.12, "smooth")):
        assert fit_patch(FLAT, share * rough, comb, ALONG_Y, 1e-6).kind == kind


def spoiled(*places: tuple[int, int]) -> Patch:
    """A ball of 30 mm with noise, and single taxels that stand off it by 1 mm."""
    noise = 10e-6 * np.random.default_rng(0).normal(size=X.shape)
    height: Floats = 0.5 * (X**2 + Y**2) / 0.03 + noise
    for place in places:
        height[place] += 1e-3
    return fit_patch(FLAT, height, ALL, ALONG_Y, 10e-6)


@pytest.mark.parametrize(
    "places", [[], [(4, 4)], [(0, 15)], [(0, 0), (9, 12)], [(2, 3), (2, 5), (15, 15)]]
)
def test_up_to_three_single_outliers_make_no_edge(places):
    patch = spoiled(*places)
    assert patch.kind == "smooth"
    assert np.allclose(patch.principal, 1 / 0.03, rtol=0, atol=4.0 * max(patch.principal_error))


@pytest.mark.parametrize("places", [[(4, 4), (4, 5)], [(4, 4), (5, 5)], [(4, 4), (5, 3)]])
def test_outliers_that_lie_together_are_a_face(places):
    assert spoiled(*places).kind != "smooth"


def test_many_outliers_are_not_left_out():
    assert spoiled(*[(i, j) for i in range(0, 16, 5) for j in range(0, 16, 5)]).kind != "smooth"
