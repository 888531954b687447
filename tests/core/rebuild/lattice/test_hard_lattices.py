"""Inputs on which a control lattice is easily lost; sizes are about 2, from -1 to 1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.geometry.meshes import solidity
from palpate.core.rebuild.lattice.fit import fit_lattice
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.side.lofting import fit_contour_loft
from palpate.core.rebuild.solid import LatticeSolid

Making = Callable[..., Any]
SIZE = 2.0


def side_points(solid: LatticeSolid, count: int = 400) -> np.ndarray:
    rng = np.random.default_rng(0)
    assert solid.lattice is not None
    return solid.lattice.side.at(rng.random(count), rng.random(count))


def rms(sampled: Any, solid: LatticeSolid) -> float:
    points = side_points(solid)
    points = points[np.abs(points[:, 2]) < 0.98]
    return float(np.sqrt(np.mean(np.square(sampled.off(points))))) / SIZE


def is_closed(solid: LatticeSolid) -> bool:
    mesh = solid.mesh(0.02)
    found = solidity(mesh.vertices, mesh.faces)
    return bool(np.isfinite(mesh.vertices).all() and found.watertight and found.genus == 0)


def test_fewer_points_than_unknowns_keep_the_control_points_near(sampled):
    one = sampled("bent tube", rows=24, around=41)
    fit = fit_lattice(one.loft().surface, size=(7, 24))
    solid = reconstruct(one.contours(), size=(7, 24))
    for lattice in (fit.lattice, solid.lattice.lattice):
        assert lattice.control.shape == (7, 7, 24, 3)
        assert np.abs(lattice.control).max() < 2 * SIZE
    assert rms(one, solid) < 5e-4


def test_a_contour_that_is_missing_costs_little(sampled):
    one = sampled("lobed")
    contours = one.contours()
    del contours[13]
    solid = reconstruct(contours)
    assert rms(one, solid) < 1.5e-3


def test_a_contour_of_another_size_is_left_out_and_a_clean_one_is_not(sampled):
    one = sampled("lobed", noise=0.002)
    contours = one.contours()
    clean = reconstruct(contours)
    contours[13] = contours[13] * [1.3, 1.3, 1.0]
    solid = reconstruct(contours)
    assert clean.slices.dropped == ()
    assert [found.which for found in solid.slices.dropped] == [13]
    assert rms(one, solid) < 2e-3


def test_strong_noise_is_not_followed(sampled):
    one = sampled("lobed", noise=0.015 * SIZE)
    solid = reconstruct(one.contours())
    # A fit to points that correspond leaves 0.003 of the size; raw points cost as much again.
    assert rms(one, solid) < 0.6 * 0.015
    assert is_closed(solid)
    assert np.isfinite(solid.lattice.lattice.control).all()


def test_a_top_contour_that_is_a_point_closes_there(sampled):
    contours = sampled("bent tube", rows=15, around=60).contours()
    contours.append(np.tile([1.2, 0.1, 1.0], (60, 1)))
    solid = reconstruct(contours)
    assert is_closed(solid)
    assert solid.mesh(0.02).vertices[:, 2].max() == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("rows", [2, 3])
def test_two_or_three_contours_make_a_cubic_lattice(sampled, rows):
    solid = reconstruct(sampled("rounded box", rows=rows, around=60).contours())
    assert is_closed(solid)
    assert solid.lattice.lattice.volume.bases[2].degree == 3
    assert solid.lattice.health.folded == 0.0


def test_uneven_and_repeated_heights_do_not_fold(sampled):
    one = sampled("rounded box", rows=15, around=60)
    contours = one.contours()
    for contour, height in zip(contours, np.sort(one.heights**3), strict=True):
        contour[:, 2] = height
    heights = np.array([contour[0, 2] for contour in contours])
    grid = np.stack([contour[:, :2] for contour in contours])
    skin = fit_contour_loft(
        np.append(heights, heights[7]), np.concatenate([grid, grid[7:8]]), low=-1.0, high=1.0
    )
    fit = fit_lattice(skin.surface, 1e-4)
    solid = reconstruct([*contours, contours[7]])
    assert skin.health.merged == 1
    assert fit.health.folded == solid.lattice.health.folded == 0.0
    assert is_closed(solid)


def test_forty_control_points_each_way_are_solved_for_many_points():
    heights, turn = np.linspace(-1, 1, 200), 2 * np.pi * np.arange(400) / 400
    radius = np.sqrt(1.04 - heights**2)[:, None] * (1 + 0.12 * np.cos(3 * turn))
    grid = radius[..., None] * np.column_stack([np.cos(turn), np.sin(turn)])
    skin = fit_contour_loft(heights, grid, low=-1.02, high=1.02)
    fit = fit_lattice(skin.surface, size=(40, 40))
    assert fit.lattice.control.shape == (40, 40, 40, 3)
    assert fit.health.rms < 1e-3
    assert np.abs(fit.lattice.control).max() < 2 * SIZE


@pytest.mark.parametrize("name", ["lobed", "rounded box", "star"])
@pytest.mark.parametrize(("rows", "around", "noise"), [(27, 81, 0.0), (27, 81, 4e-3), (9, 24, 0.0)])
def test_the_lattice_is_as_near_to_the_object_as_the_loft(sampled, name, rows, around, noise):
    one = sampled(name, rows=rows, around=around, noise=noise)
    lattice, skin = (reconstruct(one.contours(), method=way) for way in ("lattice", "skin"))
    v, turns = np.random.default_rng(1).uniform(0.05, 0.95, (2, 400))
    errors = [float(one.off(solid.surface.at(v, turns)).mean()) for solid in (lattice, skin)]
    assert errors[0] < 1.05 * errors[1] + 1e-5
