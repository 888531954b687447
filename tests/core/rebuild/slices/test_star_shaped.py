from __future__ import annotations

import numpy as np

from palpate.core.rebuild.slices.star_shaped import are_nearly_star_shaped, are_star_shaped

TURN = 2 * np.pi * np.arange(256) / 256
CIRCLE = np.stack([np.cos(TURN), np.sin(TURN)], axis=-1)


def test_noise_that_goes_back_a_little_is_told_from_a_shape_that_does() -> None:
    rng = np.random.default_rng(0)
    noisy = CIRCLE + 0.02 * rng.normal(size=CIRCLE.shape)
    # A hook: the outline goes back behind itself by half a radian.
    angle = TURN + 0.6 * np.sin(4 * TURN)
    hooked = (1 + 0.3 * np.cos(4 * TURN))[:, None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=-1
    )
    clockwise = CIRCLE[::-1]
    figures = np.stack([CIRCLE, noisy, hooked, clockwise, CIRCLE + [3.0, 0.0]])

    assert are_star_shaped(figures).tolist() == [True, False, False, False, False]
    assert are_nearly_star_shaped(figures).tolist() == [True, True, False, False, False]
