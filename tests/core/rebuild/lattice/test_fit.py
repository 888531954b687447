from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.rebuild.lattice.fit import LatticeFit, fit_lattice, lattice_grid
from palpate.core.rebuild.side.lofting import fit_contour_loft
from palpate.core.rebuild.side.surfaces import SidePatch
from palpate.core.splines.bases import Basis
from palpate.core.splines.lattices import Lattice, box_lattice, fold_report
from palpate.core.splines.spline_volumes import SplineVolume

Making = Callable[..., Any]
STARLIKE = ["lobed", "rounded box", "flat ellipse", "twisted lobes", "star", "bent tube"]


def places(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.random(count), rng.random(count)


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("name", STARLIKE)
def test_sections_seen_whole_from_the_middle_do_not_fold(sampled, name, noise):
    skin = sampled(name, noise=noise).loft()
    fit = fit_lattice(skin.surface, 0.1 * skin.uncertainty().rms)
    assert fit.health.folded == 0.0
    assert fit.health.rms < max(0.1 * skin.uncertainty().rms, 1e-5)


def test_the_side_is_the_deformed_prism_and_close_to_the_skin(sampled):
    skin = sampled("lobed").loft()
    fit = fit_lattice(skin.surface)
    v, turns = places(300)
    side = fit.side.at(v, turns)
    local = np.column_stack([fit.section.rim(turns), v])
    assert np.allclose(fit.lattice.deform(fit.prism.points(local)), side, rtol=0, atol=1e-12)
    there = SidePatch(skin.surface).at(v, turns)
    assert np.linalg.norm(side - there, axis=1).max() < 3e-3
    assert np.abs(side[:, 2] - there[:, 2]).max() < 2e-6


@pytest.mark.parametrize("by", [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
@pytest.mark.parametrize("weighted", [False, True])
def test_derivatives_of_the_side_are_those_of_differences(sampled, by, weighted):
    fit = fit_lattice(sampled("rounded box").loft().surface, 1e-4)
    if weighted:
        weights = np.random.default_rng(1).uniform(0.5, 2.0, fit.lattice.control.shape[:3])
        lattice = fit.lattice.with_control(fit.lattice.control, weights)
        fit = LatticeFit(lattice, fit.section, fit.health)
    v, turns = places(60)
    v = 0.02 + 0.96 * v
    step = np.array([1e-5, 1e-6])
    first = 0 if by[0] else 1
    lower = (by[0] - 1, by[1]) if first == 0 else (by[0], by[1] - 1)
    moves = np.array([1.0, 0.0]) if first == 0 else np.array([0.0, 1.0])
    ahead, back = (
        fit.side.at(v + way * step[first] * moves[0], turns + way * step[first] * moves[1], lower)
        for way in (1, -1)
    )
    slopes = (ahead - back) / (2 * step[first])
    found = fit.side.at(v, turns, by)
    # A corner between two places: there differences are no measure.
    assert np.median(np.abs(found - slopes)) < 1e-4 * max(np.abs(found).max(), 1.0)
    assert np.quantile(np.abs(found - slopes), 0.9) < 1e-2 * max(np.abs(found).max(), 1.0)


def test_a_round_end_closes_in_a_point_exactly():
    heights, turn = np.linspace(-0.9, 0.9, 15), 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    grid = np.sqrt(1 - heights**2)[:, None, None] * rim
    poles = (np.array([0.0, 0.0]), np.array([0.0, 0.0]))
    surface = fit_contour_loft(heights, grid, low=-1.0, high=1.0, pole=poles).surface
    fit = fit_lattice(surface)
    for v, height in ((0.0, -1.0), (1.0, 1.0)):
        end = fit.side.at(np.full(50, v), np.arange(50) / 50)
        assert np.ptp(end, axis=0).max() < 1e-14
        assert end[0] == pytest.approx([0.0, 0.0, height], abs=1e-9)
    side = fit.side.at(*places(500))
    assert np.abs(np.linalg.norm(side, axis=1) - 1.0).max() < 1e-4


def test_a_sound_lattice_is_proved_sound(sampled):
    fit = fit_lattice(sampled("bent tube", rows=9, around=24).loft().surface, 1e-3)
    assert fold_report(fit.lattice).verdict == "sound"
    assert fit.folds().verdict == "sound"


def test_a_section_bent_around_its_middle_folds_and_says_so():
    turn = 2 * np.pi * np.arange(80) / 80
    bend, width = 1.9 * np.sin(turn), 0.52 + 0.16 * np.cos(turn)
    kidney = np.column_stack([width * np.cos(bend), width * np.sin(bend)])
    heights = np.linspace(-0.98, 0.98, 9)
    skin = fit_contour_loft(heights, np.stack([kidney] * 9), low=-1.0, high=1.0)
    fit = fit_lattice(skin.surface, 1e-3)
    assert 0.0 < fit.health.folded < 0.4
    assert fit.health.rms < 1e-3


def test_the_lattice_is_the_same_in_micrometres_and_kilometres(sampled):
    one = sampled("twisted lobes", rows=9, around=40)
    lattice = fit_lattice(one.loft().surface, 1e-3).lattice
    for scale in (1e6, 1e-3):
        skin = fit_contour_loft(scale * one.heights, scale * one.grid, low=-scale, high=scale)
        other = fit_lattice(skin.surface, 1e-3 * scale).lattice
        assert np.allclose(other.control, scale * lattice.control, rtol=0, atol=1e-7 * scale)


def test_an_offset_changes_nothing_but_the_place(sampled):
    one, offset = sampled("lobed", rows=15, around=60), np.array([300.0, -200.0])
    near = fit_lattice(one.loft().surface, 1e-3)
    skin = fit_contour_loft(one.heights, one.grid + offset, low=-1.0, high=1.0)
    far = fit_lattice(skin.surface, 1e-3)
    v, turns = places(200)
    moved = far.side.at(v, turns)[:, :2] - offset
    assert np.allclose(moved, near.side.at(v, turns)[:, :2], rtol=0, atol=1e-5)


@pytest.mark.parametrize("size", [(4, 4), (6, 9), (9, 60)])
def test_the_size_that_is_wanted_is_taken(sampled, size):
    fit = fit_lattice(sampled("bent tube").loft().surface, size=size)
    assert fit.lattice.control.shape == (size[0], size[0], size[1], 3)
    # four layers cannot follow every bend of the tube
    assert fit.health.rms < (0.1 if size[1] == 4 else 1e-2)


@pytest.mark.parametrize("size", [(3, 9), (9, 3)])
def test_a_size_below_four_is_refused(sampled, size):
    with pytest.raises(ValueError, match="size must be at least 4 each way, got"):
        fit_lattice(sampled("bent tube").loft().surface, size=size)


def test_more_control_points_come_nearer_to_the_skin(sampled):
    surface = sampled("star").loft().surface
    misfits = [fit_lattice(surface, size=(side, 27)).health.rms for side in (5, 9, 17)]
    assert misfits[1] < 0.5 * misfits[0]
    assert misfits[2] < 0.5 * misfits[1]


def moved() -> Lattice:
    lattice = box_lattice(np.zeros(3), np.ones(3), (4, 5, 6))
    rng = np.random.default_rng(0)
    weights = rng.uniform(0.5, 1.0, (4, 5, 6))
    return lattice.with_control(lattice.control + 0.1 * rng.normal(size=(4, 5, 6, 3)), weights)


def test_the_arrays_are_the_whole_lattice():
    lattice = moved()
    grid = lattice_grid(lattice)
    s, t, u = (Basis(k, d) for k, d in zip(grid.knots, grid.degrees, strict=True))
    again = Lattice(SplineVolume(grid.control, (s, t, u), grid.weights), lattice.undeformed)
    points = np.random.default_rng(1).random((20, 3))
    assert np.array_equal(again.deform(points), lattice.deform(points))
    plain = Lattice(SplineVolume(grid.undeformed, (s, t, u)), lattice.undeformed)
    assert np.allclose(plain.deform(points), points, rtol=0, atol=1e-14)


def test_any_undeformed_volume_will_do_and_no_weights_are_ones():
    lattice = box_lattice(np.zeros(3), np.ones(3), (4, 4, 4))
    grid = lattice_grid(Lattice(lattice.volume, lattice.volume))
    assert np.array_equal(grid.undeformed, lattice.control)
    assert (grid.weights == 1.0).all()
