from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bracketed_root import bracketed_roots


def test_roots_are_found_whichever_side_is_outside() -> None:
    wanted = np.array([0.1, 0.5, 0.9, 1.0, 0.0])

    def cubic(t: Floats) -> tuple[Floats, Floats]:
        return (t - wanted) * (1 + t * t), 1 + t * t + 2 * t * (t - wanted)

    found = bracketed_roots(cubic, np.ones(5) * 1.1, np.zeros(5), 1e-14)
    assert np.allclose(found, wanted, rtol=0, atol=1e-13)

    def fall(t: Floats) -> tuple[Floats, Floats]:
        value, slope = cubic(t)
        return -value, -slope

    found = bracketed_roots(fall, -0.1 * np.ones(5), np.full(5, 1.2), 1e-14)
    assert np.allclose(found, wanted, rtol=0, atol=1e-13)


def test_kinks_and_wrong_slopes_only_cost_steps() -> None:
    def step(t: Floats) -> tuple[Floats, Floats]:
        return np.where(t > 0.3, 1.0, -1.0), np.zeros_like(t)

    assert abs(bracketed_roots(step, np.ones(1), np.zeros(1), 1e-13)[0] - 0.3) < 1e-12

    def misled(t: Floats) -> tuple[Floats, Floats]:
        return np.cbrt(t - 0.7), np.full_like(t, -3.0)

    assert abs(bracketed_roots(misled, np.ones(1), np.zeros(1), 1e-13)[0] - 0.7) < 1e-12


def test_what_is_exactly_met_is_kept() -> None:
    def half(t: Floats) -> tuple[Floats, Floats]:
        return t - 0.5, np.ones_like(t)

    assert bracketed_roots(half, np.ones(1), np.zeros(1), 1e-13)[0] == 0.5
