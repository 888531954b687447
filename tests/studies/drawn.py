"""Objects by chance, by their radius: round or straight, plain, lobed, necked, stepped or wavy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from palpate.core import Floats
from palpate.core.explore.planners import Radius
from palpate.core.explore.planners.trial import _ball, _bump, _rise

KINDS = ("round", "round necked", "round wavy", "straight necked", "straight stepped", "wavy")


def drawn_objects(count: int, seed: int) -> Mapping[str, Radius]:
    """Objects by chance: round or straight, plain, lobed, twisted, necked, stepped or wavy."""
    rng = np.random.default_rng(seed)
    return {f"drawn {i}": _drawn(rng) for i in range(count)}


def _drawn(rng: np.random.Generator) -> Radius:
    kind = KINDS[rng.integers(len(KINDS))]
    power, wide, taper = rng.uniform(0.3, 1.0), rng.uniform(0.22, 0.4), rng.uniform(-0.3, 0.3)
    lobes, phase = rng.integers(2, 6), rng.uniform(0.0, 6.0)
    lobe = rng.uniform(0.0, 0.08) * (rng.random() < 0.5)
    twist = rng.uniform(0.0, 4.0) * (rng.random() < 0.4)
    at, width, depth = rng.uniform(0.25, 0.75), rng.uniform(0.06, 0.2), rng.uniform(-0.3, 0.3)
    side, pace = rng.choice([-1.0, 1.0]), rng.uniform(3.0, 10.0)

    def radius(z: Floats, t: Floats) -> Floats:
        around = 1.0 + lobe * np.cos(lobes * t + phase - twist * z)
        found = wide * (1.0 + taper * (z - 0.5)) * around
        if kind.startswith("round"):
            found = found * _ball(z, power)
        if kind.endswith("necked"):
            found = found * (1.0 + depth * _bump(z, at, width))
        if kind.endswith("wavy"):
            found = found * (1.0 + 0.6 * abs(depth) * np.sin(pace * z + phase))
        if kind.endswith("stepped"):
            found = found * (0.65 + 0.35 * _rise(z, at, side * max(0.6 * width, 0.04)))
        return np.asarray(found)

    return radius
