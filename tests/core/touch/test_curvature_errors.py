from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch.curvature_errors import graph_errors
from palpate.core.touch.forms import angle_between, curvature_along, graph_shape, principal

DIRECTION = np.array([0.3, 0.9, 0.1])
DEVIATION = 1e-3


def scatter(derivatives: Floats, factor: Floats, draws: int = 4000) -> Floats:
    """Root mean square change of normal, k1, k2 and the curvature along a direction."""
    rng = np.random.default_rng(0)

    def known(five: Floats) -> tuple[Floats, list[float]]:
        p, q, r, s, t = five.tolist()
        shape = graph_shape((p, q), (r, s, t))
        k1, k2, *_ = principal(shape)
        return shape.normal, [k1, k2, curvature_along(shape, DIRECTION)]

    normal, numbers = known(derivatives)
    found = []
    for _ in range(draws):
        other, changed = known(derivatives + DEVIATION * factor @ rng.normal(size=factor.shape[1]))
        found.append([angle_between(normal, other), *(np.array(changed) - numbers)])
    return np.asarray(np.sqrt(np.mean(np.square(found), axis=0)))


def promised(derivatives: Floats, factor: Floats) -> Floats:
    p, q, r, s, t = derivatives.tolist()
    shape = graph_shape((p, q), (r, s, t))
    errors = graph_errors(derivatives, factor, DEVIATION, shape, DIRECTION)
    return np.array([errors.normal, *errors.principal, errors.across])


@pytest.mark.parametrize("seed", range(6))
def test_errors_are_the_scatter_under_noise_however_the_surface_leans(seed: int) -> None:
    rng = np.random.default_rng(seed)
    derivatives = rng.normal(size=5)
    factor = rng.normal(size=(5, 7))
    assert np.allclose(scatter(derivatives, factor), promised(derivatives, factor), rtol=0.06)


def test_near_an_umbilic_the_errors_are_neither_nothing_nor_without_bound() -> None:
    factor = np.eye(5)
    for apart in (0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 50.0):
        derivatives = np.array([0.0, 0.0, 1.0 + apart * DEVIATION, 0.0, 1.0])
        ratio = promised(derivatives, factor) / scatter(derivatives, factor)
        assert ratio.min() > 0.85
        assert (
            ratio.max() < 1.35
        )  # on the safe side where their difference is as large as its error


def test_a_pad_that_is_turned_makes_no_difference() -> None:
    rng = np.random.default_rng(3)
    p, q, r, s, t = rng.normal(size=5)
    before = promised(np.array([p, q, r, s, t]), np.diag([1.0, 1.0, 1.0, 0.5**0.5, 1.0]))
    turned = np.array([q, -p, t, -s, r])  # by a right angle
    after = graph_errors(
        turned,
        np.diag([1.0, 1.0, 1.0, 0.5**0.5, 1.0]),
        DEVIATION,
        graph_shape((q, -p), (t, -s, r)),
        np.array([DIRECTION[1], -DIRECTION[0], DIRECTION[2]]),
    )
    assert np.allclose(before, [after.normal, *after.principal, after.across], rtol=1e-12)


def test_without_noise_there_is_no_error() -> None:
    derivatives = np.array([0.1, 0.2, 3.0, 0.5, 2.0])
    shape = graph_shape((0.1, 0.2), (3.0, 0.5, 2.0))
    errors = graph_errors(derivatives, np.eye(5), 0.0, shape, DIRECTION)
    assert errors.normal == errors.across == 0.0
    assert errors.principal == (0.0, 0.0)
    assert (errors.parts == 0.0).all()
