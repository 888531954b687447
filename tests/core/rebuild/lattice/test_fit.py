from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.rebuild.lattice.fit import LatticeFit, fit_lattice, lattice_grid, refine_lattice
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.side.lofting import fit_contour_loft
from palpate.core.rebuild.side.surfaces import SidePatch
from palpate.core.rebuild.solid import LatticeSolid
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


def test_the_side_is_the_deformed_prism_and_close_to_the_loft(sampled):
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


def test_a_section_bent_around_its_middle_folds_and_tells_so():
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


def test_more_control_points_come_nearer_to_the_loft(sampled):
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


HALF = 50.0


@cache
def ball() -> LatticeSolid:
    """A ball of 100 mm, lattice and all."""
    turn = 2 * np.pi * np.arange(60) / 60
    contours = []
    for z in np.linspace(-HALF + 0.5, HALF - 0.5, 15):
        radius = np.sqrt(HALF**2 - z**2)
        ring = [radius * np.cos(turn), radius * np.sin(turn), np.full(60, z)]
        contours.append(np.column_stack(ring))
    return reconstruct(contours, tops=[[0.0, 0.0, HALF], [0.0, 0.0, -HALF]])


@cache
def tube() -> LatticeSolid:
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([0.3 * np.cos(turn), 0.2 * np.sin(turn), np.zeros(60)])
    return reconstruct([rim + [0.1 * z, 0.0, z] for z in np.linspace(0.0, 1.0, 9)])


def outwards(solid: LatticeSolid, v: float, turns: float, by: float) -> np.ndarray:
    at, way = solid.surface.at(v, turns), solid.surface.normals(v, turns)
    return np.asarray((at + by * way)[None])


@pytest.mark.parametrize("weights", [False, True])
def test_a_point_that_was_pulled_out_is_passed(weights):
    point = outwards(ball(), 0.55, 0.2, 3.0)
    refined = ball().refined(point, weights=weights)
    assert abs(refined.search().nearest(point).distances[0]) < 1e-6
    found = refined.lattice.refinement
    assert found.before == pytest.approx(3.0, rel=1e-3)
    assert found.after < 1e-6 and found.folded == 0.0
    assert (refined.lattice.lattice.volume.weights is not None) == weights


def test_weights_spare_control_points_a_part_of_the_way():
    point = outwards(ball(), 0.55, 0.2, 3.0)
    moved = [ball().refined(point, weights=w).lattice.refinement.moved for w in (False, True)]
    assert moved[1] < moved[0]


@pytest.mark.parametrize("weights", [False, True])
def test_points_on_the_surface_change_nothing(weights):
    points = ball().surface.at([0.3, 0.5, 0.7], [0.1, 0.4, 0.9])
    refined = ball().refined(points, weights=weights)
    assert np.array_equal(refined.lattice.lattice.control, ball().lattice.lattice.control)
    assert refined.lattice.refinement.steps == 0


@pytest.mark.parametrize("weights", [False, True])
def test_what_is_far_away_stays_as_it_was(weights):
    refined = ball().refined(outwards(ball(), 0.55, 0.2, 3.0), weights=weights)
    v, turns = np.random.default_rng(0).random((2, 500))
    before, after = (solid.surface.at(v, turns) for solid in (ball(), refined))
    centre = ball().surface.at(0.55, 0.2)
    moved = np.linalg.norm(after - before, axis=1)
    far = np.linalg.norm(before - centre, axis=1) > 1.4 * HALF
    assert moved.max() > 0.5
    assert far.sum() > 100 and moved[far].max() < 1e-4 * 3.0


def test_many_points_that_contradict_each_other_are_met_in_the_middle():
    out, back = outwards(ball(), 0.5, 0.3, 2.0), outwards(ball(), 0.5, 0.3, -1.0)
    refined = ball().refined(np.concatenate([out, back]))
    middle = outwards(ball(), 0.5, 0.3, 0.5)
    assert abs(refined.search().nearest(middle).distances[0]) < 0.05
    assert refined.lattice.refinement.most == pytest.approx(1.5, rel=0.05)


def test_doubtful_points_draw_less():
    point = outwards(ball(), 0.5, 0.3, 2.0)
    left = [
        ball().refined(point, sigma=sigma).lattice.refinement.after for sigma in (0.02, 2.0, 20.0)
    ]
    assert left[0] < 0.01
    assert left[1] == pytest.approx(1.0, rel=0.1)
    assert left[2] > 1.8


def test_a_touch_on_a_dent_that_nobody_touched_brings_the_surface_nearer_there():
    def dent(points: np.ndarray) -> np.ndarray:
        """A ball with a shallow dent at +x."""
        way = points / np.linalg.norm(points, axis=1, keepdims=True)
        angle = np.arccos(np.clip(way[:, 0], -1.0, 1.0))
        return np.asarray((HALF - 3.0 * np.exp(-((angle / 0.3) ** 2)))[:, None] * way)

    rng = np.random.default_rng(0)
    near = dent(np.array([1.0, 0.0, 0.0]) + 0.2 * rng.normal(size=(200, 3)))
    touches = dent(np.array([[1.0, 0.0, 0.0], [1.0, 0.15, 0.0], [1.0, -0.1, 0.12]]))
    refined = ball().refined(touches)
    before, after = (
        np.sqrt(np.mean(np.square(solid.search().nearest(near).distances)))
        for solid in (ball(), refined)
    )
    assert after < 0.5 * before


def test_points_at_an_end_are_counted_and_change_nothing():
    refined = tube().refined([[0.1, 0.0, 1.2], [0.0, 0.0, -0.1]])
    found = refined.lattice.refinement
    assert (found.beyond, found.points) == (2, 0)
    assert refined.health()["refined_beyond"] == 2.0
    assert np.array_equal(refined.lattice.lattice.control, tube().lattice.lattice.control)


def test_the_refined_solid_stays_closed_and_tells_what_was_done():
    refined = ball().refined(outwards(ball(), 0.7, 0.6, -4.0))
    assert refined.mesh(1.0).faces.shape[1] == 3
    health = refined.health()
    assert health["refined_before"] == pytest.approx(4.0, rel=1e-3)
    assert health["refined_after"] < 1e-6
    assert health["lattice_folded"] == refined.lattice.refinement.folded == 0.0


def test_a_pull_through_the_other_side_is_a_fold_and_told():
    refined = tube().refined([[-0.6, 0.0, 0.5]], weights=False)
    through = refine_lattice(tube().lattice, np.array([[-0.8, 0.0, 0.5]]), np.array([[0.5, 0.0]]))
    assert refined.lattice.refinement.folded == 0.0
    assert through.refinement.folded > 0.0


def test_a_pole_stays_a_point():
    point = outwards(ball(), 0.97, 0.2, 2.0)
    refined = ball().refined(point)
    top = refined.surface.at(np.ones(20), np.arange(20) / 20)
    assert np.ptp(top, axis=0).max() < 1e-12
    assert refined.lattice.refinement.after < 0.2


def test_only_a_lattice_can_be_refined():
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(60)])
    skin = reconstruct([rim, rim + [0.0, 0.0, 1.0]], method="skin")
    with pytest.raises(ValueError, match="method must be lattice for a solid to be refined"):
        skin.refined([[0.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("points", "sigma", "words"),
    [
        ([[0.0, np.nan, 0.0]], None, "points must be finite"),
        ([[0.0, 0.0]], None, "points must have shape"),
        ([[0.0, 0.0, 60.0]], 0.0, "sigma must be positive"),
    ],
)
def test_what_is_no_point_is_refused(points, sigma, words):
    with pytest.raises(ValueError, match=words):
        ball().refined(points, sigma=sigma)
