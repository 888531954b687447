from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import transform_points
from palpate.core.rebuild.contours.contacts import ContactPoints
from palpate.core.rebuild.ends.touched import Shear
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.solid import LatticeSolid, moved_lattice, sheared_volume, widest_untouched
from palpate.core.splines.bases import clamped_basis
from palpate.core.splines.lattices import Lattice
from palpate.core.splines.spline_volumes import SplineVolume

SHEAR = Shear(np.array([0.01, 0.0]), np.array([0.2, -0.1]), np.zeros(2))
WEDGE = SHEAR._replace(change=np.array([2.0, -1.0]))


@pytest.fixture
def volume() -> SplineVolume:
    """A block of 60 by 60 by 90 mm whose control points are a little astray."""
    bases = clamped_basis(7), clamped_basis(7), clamped_basis(20)
    sites = [basis.greville() for basis in bases]
    block = np.stack(np.meshgrid(*sites, indexing="ij"), axis=-1) * [0.06, 0.06, 0.09]
    return SplineVolume(block + np.random.default_rng(0).normal(0.0, 1e-3, block.shape), bases)


@pytest.fixture
def places() -> Floats:
    return np.random.default_rng(1).uniform(0.0, 1.0, (500, 3))


def off(volume: SplineVolume, shear: Shear, places: Floats) -> float:
    """How far the slanted volume is from the volume slanted, root mean square, m."""
    missed = sheared_volume(volume, shear).at(places) - shear.sheared(volume.at(places))
    return float(np.sqrt(np.mean(missed**2)))


@pytest.mark.parametrize("weighted", [False, True])
def test_where_both_ends_are_parallel_it_is_the_slanted_volume(volume, places, weighted):
    if weighted:
        rng = np.random.default_rng(2)
        volume = replace(volume, weights=rng.uniform(0.5, 1.0, volume.control.shape[:3]))
    assert off(volume, SHEAR, places) < 1e-14


def test_else_it_is_nearer_than_its_slanted_control_points(volume, places):
    control = WEDGE.sheared(volume.control.reshape(-1, 3)).reshape(volume.control.shape)
    moved = SplineVolume(control, volume.bases).at(places) - WEDGE.sheared(volume.at(places))
    assert off(volume, WEDGE, places) < 0.5 * float(np.sqrt(np.mean(moved**2))) < 1e-4


def test_what_is_not_deformed_is_not_slanted(volume):
    lattice = Lattice(volume, volume)
    found = moved_lattice(lattice, None, SHEAR)
    assert found.undeformed is volume
    assert moved_lattice(lattice, None) is lattice


def test_between_two_touches_of_a_rim_lies_nothing_wider_than_their_gap():
    lengths = np.full(100, 1e-3)
    lengths[40:44] = np.inf  # 4 mm of 100 in which nothing was touched
    found = widest_untouched(lengths, 0.1, 0.0)
    assert (found[lengths == 1e-3] == 1e-3).all()
    np.testing.assert_allclose(found[40:44], [3e-3, 5e-3, 5e-3, 3e-3])
    np.testing.assert_allclose(
        widest_untouched(lengths, 0.1, 1.5e-3)[40:44], [1.5e-3, 3.5e-3, 3.5e-3, 1.5e-3]
    )
    assert (widest_untouched(lengths, 10.0, 0.0)[40:44] >= 0.3).all()
    assert (widest_untouched(np.full(100, 0.02), 0.1, 0.0) == 0.02).all()


Make = Callable[..., Any]
SEVEN = np.linspace(-0.9, 0.9, 7)
BOX = ([0.03, 0.02, 0.04], [0.2, 0.2])
EGG = ([0.03, 0.025, 0.045], [1.0, 1.0])
TURN = 2 * np.pi * np.arange(80) / 80


def deviation_of(solid: LatticeSolid) -> float:
    found = solid.whole_deviation()
    assert found is not None and np.isfinite(found.whole) and 0.0 < found.ends <= found.whole
    return found.whole


def cylinder(heights: Floats, scale: float = 1.0) -> list[Floats]:
    rim = np.column_stack([0.03 * np.cos(TURN), 0.02 * np.sin(TURN)])
    return [scale * np.column_stack([rim, np.full(80, z)]) for z in heights]


def ends(low: float, high: float) -> Floats:
    return np.array([[0.0, 0.0, low], [0.0, 0.0, high]])


@pytest.mark.parametrize("shape", [BOX, EGG])
def test_it_is_of_the_size_of_the_true_error(shape, oracle):
    true = oracle(*shape)
    rng = np.random.default_rng(0)
    contours, contacts, tops = true.evidence(SEVEN)
    poses = 1e-4 * rng.normal(size=(120, 3))  # of touches, each of a part of the points
    touch = (len(poses) * np.arange(len(contacts.points)) // len(contacts.points)).astype(np.int32)
    noisy = contacts._replace(points=contacts.points + poses[touch], touch=touch)
    contours = [one + 1e-4 * rng.normal(size=one.shape) for one in contours]
    solid = reconstruct(contours, patches=noisy, tops=tops, method="skin")
    mesh = solid.mesh(5e-4)
    error = float(np.sqrt(np.mean(true.distances(mesh.vertices) ** 2)))
    assert 0.4 * error < deviation_of(solid) < 4.0 * error


def test_sharp_edges_of_the_side_that_taxels_touched_are_owned_up_to():
    rng = np.random.default_rng(0)
    turn, heights = rng.uniform(0.0, 2.0 * np.pi, 20_000), rng.uniform(-0.05, 0.05, 20_000)
    facet = (np.floor(turn / (np.pi / 3)) + 0.5) * np.pi / 3
    apothem = 0.026 / np.cos(turn - facet)
    points = np.column_stack([apothem * np.cos(turn), apothem * np.sin(turn), heights])
    normals = np.column_stack([np.cos(facet), np.sin(facet), np.zeros(20_000)])
    contacts = ContactPoints(points, normals, np.arange(20_000, dtype=np.int32) // 100)
    rings = [
        np.column_stack([points[::200, :2][np.argsort(turn[::200])], np.full(100, z)])
        for z in np.linspace(-0.045, 0.045, 9)
    ]
    solid = reconstruct(rings, patches=contacts, tops=ends(-0.05, 0.05), method="skin")
    assert solid.closed is not None and solid.closed.radial is not None
    assert solid.closed.radial.rms > 2.0 * solid.closed.radial.sigma
    error = np.sqrt(np.mean(solid.search().nearest(points[:2000]).distances ** 2))
    assert 0.5 * error < deviation_of(solid) < 4.0 * error


def test_an_end_that_nobody_touched_costs_what_it_may_hide():
    contours = cylinder(np.linspace(-0.045, 0.045, 10))
    one, neither = ends(-0.05, 0.05)[1:], None
    both, upper, none = (
        deviation_of(reconstruct(contours, tops=tops, method="skin"))
        for tops in (ends(-0.05, 0.05), one, neither)
    )
    assert 5.0 * both < upper < none
    # 10 mm that it may go on, all lengths alike, on an end that is a seventh of the surface.
    assert 1e-3 < none < 5e-3


def test_a_touched_end_hides_more_the_farther_the_last_contour_is():
    contours = cylinder(np.linspace(-0.045, 0.045, 10))
    away = [0.046, 0.048, 0.052, 0.06]
    told = [deviation_of(reconstruct(contours, tops=ends(-z, z), method="skin")) for z in away]
    assert told == sorted(told)
    assert told[-1] > 5.0 * told[0]


def test_fewer_contours_touched_alone_are_trusted_less(oracle):
    true = oracle(*EGG)
    few, many = (true.rebuilt(np.linspace(-0.9, 0.9, count)).whole_deviation() for count in (3, 9))
    assert few.ends == pytest.approx(many.ends, rel=0.2)  # which lie as far from the last contours
    assert few.whole**2 - few.ends**2 > 1.2 * (many.whole**2 - many.ends**2)


def test_noise_is_in_it(oracle):
    rng = np.random.default_rng(0)
    contours, contacts, tops = oracle(*EGG).evidence(SEVEN)
    noise = rng.normal(size=contacts.points.shape)
    noisy = (contacts._replace(points=contacts.points + sigma * noise) for sigma in (0.0, 3e-4))
    told = [
        deviation_of(reconstruct(contours, patches=one, tops=tops, method="skin")) for one in noisy
    ]
    assert told == sorted(told)


def test_what_was_touched_off_an_end_is_in_it(oracle):
    contours, contacts, tops = oracle([0.03, 0.03, 0.04], [0.1, 1.0]).evidence(SEVEN)
    assert contacts.normals is not None
    level = contacts.normals[:, 2] > 0.95
    tilted = contacts.points.copy()
    tilted[level, 2] -= 0.05 * (tilted[level, 0] + 0.03)  # 3 deg, from one side of the top on
    straight, leaning = (
        deviation_of(reconstruct(contours, patches=one, tops=tops, method="skin"))
        for one in (contacts, contacts._replace(points=tilted))
    )
    assert leaning > 2.0 * straight
    assert leaning > 1e-4


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_it_has_the_unit_of_the_contours(scale):
    heights = np.linspace(-0.045, 0.045, 10)
    one = deviation_of(reconstruct(cylinder(heights), tops=ends(-0.05, 0.05), method="skin"))
    other = deviation_of(
        reconstruct(cylinder(heights, scale), tops=scale * ends(-0.05, 0.05), method="skin")
    )
    assert other == pytest.approx(scale * one, rel=1e-6)


def test_it_is_the_same_upside_down(oracle):
    over = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # half a turn about x
    contours, contacts, tops = oracle(*EGG).evidence(SEVEN)
    assert contacts.normals is not None
    points, normals = (transform_points(over, one) for one in contacts[:2])
    upside = ContactPoints(points, normals, contacts.touch)
    one = reconstruct(contours, patches=contacts, tops=tops, method="skin")
    turned = [transform_points(over, each) for each in contours]
    other = reconstruct(turned, patches=upside, tops=transform_points(over, tops), method="skin")
    assert deviation_of(other) == pytest.approx(deviation_of(one), rel=0.05)
    assert other.volume == pytest.approx(one.volume, rel=1e-4)
