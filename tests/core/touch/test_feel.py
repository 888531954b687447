from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch.feel import feel

PITCH = 1e-3


def pressed(radii: tuple[float, float], depth: float = 1e-3, dome: float = 0.0) -> Floats:
    """A paraboloid with these radii along x and y, pressed onto a pad."""
    side = (np.arange(16) - 7.5) * PITCH
    x, y = np.meshgrid(side, side)
    gap = 0.5 * (x**2 / radii[0] + y**2 / radii[1] + dome * (x**2 + y**2))
    image: Floats = np.maximum(depth - gap, 0.0)
    return image


def test_a_paraboloid_has_its_curvatures() -> None:
    patch = feel(pressed((0.04, 0.02)), PITCH)

    assert patch.kind == "smooth"
    # The jet has the paraboloid among its shapes: only rounding is left.
    assert patch.principal == pytest.approx((50.0, 25.0), rel=1e-6)
    assert abs(patch.principal_direction[1]) == pytest.approx(1.0, abs=1e-9)
    assert patch.normal == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)
    assert patch.across == pytest.approx(25.0, rel=1e-6)


def test_a_domed_pad_is_taken_off() -> None:
    patch = feel(pressed((0.02, 0.02), dome=1 / 0.015), PITCH, radius=0.015)

    assert patch.principal == pytest.approx((50.0, 50.0), rel=1e-6)


def test_under_noise_the_error_is_what_it_says() -> None:
    noise, rng = 5e-6, np.random.default_rng(3)
    clear = pressed((0.03, 0.03), depth=2e-3)
    patches = [
        feel(clear + noise * rng.standard_normal(clear.shape), PITCH, noise=noise)
        for _ in range(40)
    ]

    off = [
        (k - 1 / 0.03) / e
        for p in patches
        for k, e in zip(p.principal, p.principal_error)  # noqa: B905
    ]
    # Of 80, in units of their standard errors; k1 >= k2 pushes both outwards, by less than half.
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.6


def test_what_does_not_touch_is_a_miss() -> None:
    assert feel(np.zeros((16, 16)), PITCH).kind == "miss"
    assert feel(pressed((0.02, 0.02), depth=4e-4), PITCH, contact=5e-4).kind == "miss"


@pytest.mark.parametrize(
    ("image", "given", "words"),
    [
        (np.zeros((3, 16)), {}, r"must be at least 4 by 4, got \(3, 16\)"),
        (np.zeros(256), {}, r"compression must have shape \(any, any\), got \(256,\)"),
        (np.full((8, 8), np.nan), {}, "compression must be finite"),
        (np.zeros((8, 8)), {"pitch": 0.0}, "pitch must be positive and finite, got 0.0 m"),
        (np.zeros((8, 8)), {"radius": -1.0}, "radius must be positive"),
        (np.zeros((8, 8)), {"contact": 0.0}, "contact must be positive"),
        (np.zeros((8, 8)), {"noise": -1.0}, "noise must not be negative, got -1.0 m"),
    ],
)
def test_what_is_no_touch_is_refused(image: Floats, given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        feel(image, **{"pitch": PITCH, **given})
