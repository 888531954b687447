from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.polish import polish
from palpate.core.shapes.superquadric import Superquadric

DOWN = np.array([0.0, 0.0, -1.0])


class Shear:
    """Moves x with the square of z."""

    def deform(self, points: Floats) -> Floats:
        x, y, z = points.T
        return np.column_stack([x + 3.0 * z * z, y, z])

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        slopes = np.tile(np.eye(3), (len(points), 1, 1))
        slopes[:, 0, 2] = 6.0 * points[:, 2]
        return self.deform(points), slopes


def test_rays_come_to_the_surface_from_above_and_from_below(ball: Superquadric) -> None:
    rng = np.random.default_rng(0)
    exact = rng.normal(size=(40, 3))
    exact[:, 2] = np.abs(exact[:, 2]) + 0.5
    exact *= 0.03 / np.linalg.norm(exact, axis=1, keepdims=True)
    near = exact * rng.uniform(0.99, 1.01, (40, 1))
    surface = Shear().deform(exact)
    wanted = rng.uniform(-1e-4, 1e-4, 40)
    ways, done = polish(ball, Shear(), near, surface - wanted[:, None] * DOWN, DOWN)
    assert done.all()
    assert np.allclose(ways, wanted, rtol=0, atol=1e-15)


def test_a_ray_that_has_nothing_to_meet_is_not_believed(ball: Superquadric) -> None:
    places = np.array([[0.0299, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.0, -0.03], [0.0, 0.0, 0.0]])
    starts = Shear().deform(places) + np.array([[0.01, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    ways, done = polish(ball, Shear(), places, starts, DOWN)
    # It passes by; it is there; it looks at the back; it starts too far away.
    assert done.tolist() == [False, True, False, False]
    assert ways[1] == 0.0
    assert np.isfinite(ways).all()
