from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.shear import Shear
from palpate.core.rebuild.solid import moved_lattice, sheared_volume
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
    missed = sheared_volume(volume, shear).at(places) - shear.slanted(volume.at(places))
    return float(np.sqrt(np.mean(missed**2)))


@pytest.mark.parametrize("weighted", [False, True])
def test_where_both_ends_are_parallel_it_is_the_slanted_volume(
    volume: SplineVolume, places: Floats, weighted: bool
) -> None:
    if weighted:
        rng = np.random.default_rng(2)
        volume = replace(volume, weights=rng.uniform(0.5, 1.0, volume.control.shape[:3]))
    assert off(volume, SHEAR, places) < 1e-14


def test_else_it_is_nearer_than_its_slanted_control_points(
    volume: SplineVolume, places: Floats
) -> None:
    control = WEDGE.slanted(volume.control.reshape(-1, 3)).reshape(volume.control.shape)
    moved = SplineVolume(control, volume.bases).at(places) - WEDGE.slanted(volume.at(places))
    assert off(volume, WEDGE, places) < 0.5 * float(np.sqrt(np.mean(moved**2))) < 1e-4


def test_what_is_not_deformed_is_not_slanted(volume: SplineVolume) -> None:
    lattice = Lattice(volume, volume)
    found = moved_lattice(lattice, None, SHEAR)
    assert found.undeformed is volume
    assert moved_lattice(lattice, None) is lattice
