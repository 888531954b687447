from __future__ import annotations

import numpy as np

from palpate.core.rebuild.lattice.lattice_grid import lattice_grid
from palpate.core.splines.basis import Basis
from palpate.core.splines.lattice import Lattice, box_lattice
from palpate.core.splines.volume import Volume


def moved() -> Lattice:
    lattice = box_lattice(np.zeros(3), np.ones(3), (4, 5, 6))
    rng = np.random.default_rng(0)
    weights = rng.uniform(0.5, 1.0, (4, 5, 6))
    return lattice.with_control(lattice.control + 0.1 * rng.normal(size=(4, 5, 6, 3)), weights)


def test_the_arrays_are_the_whole_lattice() -> None:
    lattice = moved()

    grid = lattice_grid(lattice)

    s, t, u = (Basis(k, d) for k, d in zip(grid.knots, grid.degrees, strict=True))
    again = Lattice(Volume(grid.control, (s, t, u), grid.weights), lattice.undeformed)
    points = np.random.default_rng(1).random((20, 3))
    assert np.array_equal(again.deform(points), lattice.deform(points))
    plain = Lattice(Volume(grid.undeformed, (s, t, u)), lattice.undeformed)
    assert np.allclose(plain.deform(points), points, rtol=0, atol=1e-14)


def test_any_undeformed_volume_will_do_and_no_weights_are_ones() -> None:
    lattice = box_lattice(np.zeros(3), np.ones(3), (4, 4, 4))

    grid = lattice_grid(Lattice(lattice.volume, lattice.volume))

    assert np.array_equal(grid.undeformed, lattice.control)
    assert (grid.weights == 1.0).all()
