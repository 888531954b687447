"""Control lattices that follow a side: accuracy, folds, derivatives, refinement."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild import LatticeSolid, reconstruct
from palpate.core.rebuild.lattice import fit_lattice, lattice_grid, refine_lattice
from palpate.core.rebuild.side import ContourLoft, fit_contour_loft
from palpate.core.splines import Basis, Lattice, SplineVolume, box_lattice
from tests.core.rebuild import objects
from tests.core.rebuild.objects import SECTIONS, at_height, circle, slow

TURNS = np.arange(96) / 96


@cache
def loft(name: str, rows: int = 27, around: int = 80, noise: float = 0.0) -> ContourLoft:
    heights = np.linspace(-0.98, 0.98, rows)
    grid = np.stack([SECTIONS[name](np.arange(around) / around, float(z)) for z in heights])
    grid = grid + noise * np.random.default_rng(0).normal(size=grid.shape)
    return fit_contour_loft(heights, grid, low=-1.0, high=1.0)


def prism(plane: Floats) -> ContourLoft:
    """A loft of one section, between -1 and 1."""
    heights = np.linspace(-0.98, 0.98, 9)
    return fit_contour_loft(heights, np.repeat(plane[None], 9, axis=0), low=-1.0, high=1.0)


@pytest.mark.parametrize(
    ("name", "noise"), [("lobed", 2e-3), ("four lobes", 0.0), ("bent tube", 2e-3)]
)
def test_lattice_is_as_accurate_as_loft_without_folds(name, noise):
    skin = loft(name, noise=noise)
    fit = fit_lattice(skin.patch, 0.1 * skin.uncertainty().rms)
    assert fit.health.folded == 0.0
    assert fit.health.rms < max(0.1 * skin.uncertainty().rms, 1e-5)
    v, turns = np.random.default_rng(1).uniform(0.05, 0.95, (2, 400))
    errors = []
    for side in (fit.side, skin.patch):
        points = side.at(v, turns)
        rims = [SECTIONS[name](np.arange(1600) / 1600, float(z)) for z in points[:, 2]]
        pairs = zip(rims, points[:, None, :2], strict=True)
        errors.append(np.mean([objects.curve_distances(*pair) for pair in pairs]))
    assert errors[0] < 1.05 * errors[1] + 1e-5


def test_side_is_deformed_prism():
    skin = loft("lobed")
    fit = fit_lattice(skin.patch)
    v, turns = np.random.default_rng(0).random((2, 300))
    side, there = fit.side.at(v, turns), skin.patch.at(v, turns)
    local = np.column_stack([fit.section.rim(turns), v])
    assert np.allclose(fit.lattice.deform(fit.prism.points(local)), side, rtol=0, atol=1e-12)
    assert np.linalg.norm(side - there, axis=1).max() < 3e-3
    assert np.abs(side[:, 2] - there[:, 2]).max() < 4e-6
    assert fit.lattice.control[0, 0, :, 2] == pytest.approx(fit.lattice.control[3, 2, :, 2])


@pytest.mark.parametrize("weighted", [False, True])
def test_derivatives_of_side_are_those_of_differences(weighted):
    fit = fit_lattice(loft("lobed", 9, 40).patch, 1e-4)
    if weighted:
        weights = np.random.default_rng(1).uniform(0.5, 2.0, fit.lattice.control.shape[:3])
        fit = replace(fit, lattice=fit.lattice.with_control(fit.lattice.control, weights))
    v, turns = np.random.default_rng(0).uniform(0.02, 0.98, (2, 60))
    # Except at knots.
    objects.assert_derivatives(fit.side.at, v, turns, 1e-3, 0.8, fit.side.on_grid)


def test_folds_of_lattices_are_reported():
    sound = fit_lattice(loft("bent tube", 9, 24).patch, size=(4, 5))
    assert sound.folds().verdict == "sound"
    kidney = fit_lattice(prism(SECTIONS["kidney"](np.arange(80) / 80, 0.0)).patch, 1e-3)
    assert 0.0 < kidney.health.folded < 0.4
    assert kidney.health.rms < 1e-3
    steps = np.diff(np.unwrap(np.arctan2(*(kidney.section.rim(TURNS) - 0.5).T)))
    assert (steps < 0.0).all() or (steps > 0.0).all()  # it runs around once


@pytest.mark.parametrize("exponent", [1.0, 0.45, 0.2])
def test_prism_has_section_of_side_or_grasp(exponent):
    c, s = np.cos(0.6), np.sin(0.6)
    plane = objects.superellipse(TURNS, exponent, 0.5, 0.3) @ np.array([[c, s], [-s, c]])
    section = fit_lattice(prism(plane + [0.1, -0.2]).patch, 1e-3).section
    assert section.exponent == pytest.approx(exponent, abs=0.15)
    assert np.sort(section.half_extent) == pytest.approx([0.3, 0.5], rel=0.05)
    assert section.middle == pytest.approx([0.1, -0.2], abs=5e-3)
    pose = np.array([0.1, 0.2, 0.3, 0.0, 0.0, np.sin(0.2), np.cos(0.2)])
    size, exponents = np.array([0.5, 0.3, 0.7]), np.array([0.4, exponent])
    grasp: Any = SimpleNamespace(size=size, exponents=exponents, pose=pose)
    taken = fit_lattice(prism(0.4 * circle(60)).patch, 1e-2, grasp=grasp).section
    assert (taken.exponent, *taken.half_extent) == pytest.approx((exponent, 0.5, 0.3))
    assert taken.middle == pytest.approx([0.1, 0.2])
    assert np.arctan2(taken.axes[0, 1], taken.axes[0, 0]) == pytest.approx(0.4)


@pytest.mark.parametrize(("size", "off"), [((4, 4), 0.1), ((6, 9), 1e-2), ((9, 60), 1e-2)])
def test_lattice_has_requested_size_and_converges(size, off):
    fit = fit_lattice(loft("bent tube").patch, size=size)
    assert fit.lattice.control.shape == (size[0], size[0], size[1], 3)
    assert fit.health.rms < off
    misses = [fit_lattice(loft("star").patch, size=(n, 27)).health.rms for n in (5, 9, 17)]
    assert misses[2] < 0.5 * misses[1] < 0.25 * misses[0]
    with pytest.raises(ValueError, match="size must be at least 4 each way, got"):
        fit_lattice(loft("star").patch, size=(size[0], 3))


def test_lattice_grid_restores_lattice():
    rng, box = np.random.default_rng(0), box_lattice(np.zeros(3), np.ones(3), (4, 5, 6))
    control = box.control + 0.1 * rng.normal(size=(4, 5, 6, 3))
    lattice = box.with_control(control, rng.uniform(0.5, 1.0, (4, 5, 6)))
    grid, points = lattice_grid(lattice), rng.random((20, 3))
    s, t, u = (Basis(k, d) for k, d in zip(grid.knots, grid.degrees, strict=True))
    again = Lattice(SplineVolume(grid.control, (s, t, u), grid.weights), lattice.undeformed)
    assert np.array_equal(again.deform(points), lattice.deform(points))
    plain = Lattice(SplineVolume(grid.undeformed, (s, t, u)), lattice.undeformed)
    assert np.allclose(plain.deform(points), points, rtol=0, atol=1e-14)
    volume = lattice_grid(Lattice(box.volume, box.volume))
    assert np.array_equal(volume.undeformed, box.control) and (volume.weights == 1.0).all()


@cache
def ball() -> LatticeSolid:
    """A ball of radius 50."""
    heights = np.linspace(-49.5, 49.5, 11)
    rings = [at_height(np.sqrt(2500.0 - z**2) * circle(40), z) for z in heights]
    return reconstruct(rings, tops=[[0.0, 0.0, 50.0], [0.0, 0.0, -50.0]])


@cache
def tube() -> LatticeSolid:
    plane = circle(60) * [0.3, 0.2]
    return reconstruct([at_height(plane + [0.1 * z, 0.0], z) for z in np.linspace(0.0, 1.0, 9)])


def outwards(v: float, turns: float, by: float) -> Floats:
    surface = ball().surface
    return np.asarray((surface.at(v, turns) + by * surface.normals(v, turns))[None])


@pytest.mark.parametrize("weights", [slow(False), True])
def test_refined_side_passes_point_and_stays_elsewhere(weights):
    point = outwards(0.55, 0.2, 3.0)
    refined = ball().refined(point, weights=weights)
    assert abs(refined.search().nearest(point).distances[0]) < 1e-6
    refinement = refined.lattice.refinement
    assert refinement.before == pytest.approx(3.0, rel=1e-3)
    assert (refinement.points, refinement.beyond, refinement.folded) == (1, 0, 0.0)
    assert max(refinement.after, refinement.most) < 1e-6
    assert (refined.lattice.lattice.volume.weights is not None) == weights
    v, turns = np.random.default_rng(0).random((2, 500))
    before, after = (solid.surface.at(v, turns) for solid in (ball(), refined))
    moved = np.linalg.norm(after - before, axis=1)
    far = np.linalg.norm(before - ball().surface.at(0.55, 0.2), axis=1) > 70.0
    assert moved.max() > 0.5
    assert far.sum() > 100 and moved[far].max() < 3e-4
    own = ball().refined(np.zeros((0, 3))).surface  # that of the lattice
    on_surface = own.at([0.3, 0.5, 0.7], [0.1, 0.4, 0.9])
    same = ball().refined(on_surface, weights=weights).lattice
    assert same.refinement.steps == 0
    assert np.array_equal(same.lattice.control, ball().lattice.lattice.control)
    health = refined.health()
    names = ("points", "beyond", "before", "after", "moved")
    assert [health[f"refined_{name}"] for name in names] == [getattr(refinement, n) for n in names]
    assert health["lattice_folded"] == 0.0
    if weights:  # then control points move less
        plain = ball().refined(point).lattice.refinement
        assert refinement.moved < plain.moved


@pytest.mark.slow
def test_contradictory_and_uncertain_points_are_met_halfway():
    both = np.concatenate([outwards(0.5, 0.3, 2.0), outwards(0.5, 0.3, -1.0)])
    refined = ball().refined(both)
    assert abs(refined.search().nearest(outwards(0.5, 0.3, 0.5)).distances[0]) < 0.05
    assert refined.lattice.refinement.most == pytest.approx(1.5, rel=0.05)
    point = outwards(0.5, 0.3, 2.0)
    left = [ball().refined(point, sigma=s).lattice.refinement.after for s in (0.02, 2.0, 20.0)]
    assert left[0] < 0.01 and left[2] > 1.8
    assert left[1] == pytest.approx(1.0, rel=0.1)


def test_ends_and_poles_are_not_refined():
    refined = tube().refined([[0.1, 0.0, 1.2], [0.0, 0.0, -0.1]])
    refinement = refined.lattice.refinement
    assert (refinement.beyond, refinement.points) == (2, 0)
    assert refined.health()["refined_beyond"] == 2.0
    assert np.array_equal(refined.lattice.lattice.control, tube().lattice.lattice.control)
    pulled = ball().refined(outwards(0.97, 0.2, 2.0))
    for v in (0.0, 1.0):
        end = pulled.surface.at(np.full(20, v), np.arange(20) / 20)
        assert np.ptp(end, axis=0).max() < 1e-12
    assert pulled.lattice.refinement.after < 0.2
    # A refinement through the other side folds.
    refined = tube().refined([[-0.6, 0.0, 0.5]])
    point, place = np.array([[-0.8, 0.0, 0.5]]), np.array([[0.5, 0.0]])
    through = refine_lattice(tube().lattice, point, place)
    assert refined.lattice.refinement.folded == 0.0 < through.refinement.folded
