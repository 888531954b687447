"""Random touches whose kind is known."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch import Pad, PatchKind
from tests.core.touch.touches import FLAT, X, Y

# Heights over a pad, in units of its pitch, by places u, v, a slope s and a side (1 or -1).
SURFACES = {
    "ball": lambda u, v, s, side: 12 / s - np.sqrt(144 / s**2 - u**2 - v**2),
    "cylinder": lambda u, v, s, side: 12 / s - np.sqrt(144 / s**2 - u**2) + 0.1 * s * v,
    "saddle": lambda u, v, s, side: 0.02 * (u**2 - s * v**2),
    "plane": lambda u, v, s, side: 0.2 * s * u,
    "edge": lambda u, v, s, side: side * s * np.abs(u) + 0.15 * v,
    "step": lambda u, v, s, side: 0.1 * v + 0.8 * s * (u > 0.0),
    "rim": lambda u, v, s, side: np.maximum(s * u, 30 - np.sqrt(900 - v**2) - s * u),
    "corner": lambda u, v, s, side: side * s * np.maximum(u, np.abs(0.9 * v) - 0.5 * u),
    "pyramid": lambda u, v, s, side: s * np.maximum(np.abs(u), np.abs(v)),
}
KINDS: dict[str, PatchKind] = {"edge": "edge", "step": "edge", "rim": "edge"}
KINDS |= {"corner": "corner", "pyramid": "corner"}


class KnownTouch(NamedTuple):
    """A touch whose kind is known."""

    kind: PatchKind
    pad: Pad
    compression: Floats  # (rows, cols) [m]
    touched: Bools  # (rows, cols)
    noise: float  # standard deviation of one taxel [m]


def draw_touch(rng: np.random.Generator, name: str) -> KnownTouch:
    """One touch of a surface, turned, with its feature within two pitches of the pad's middle.

    It is pressed so deep that each face owns enough taxels.
    """
    pad = FLAT if rng.random() < 0.5 else replace(FLAT, dome=1.0 / rng.uniform(12e-3, 25e-3))
    turn, steep, side = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8), rng.choice([-1.0, 1.0])
    x, y = X / pad.pitch - rng.uniform(-2, 2), Y / pad.pitch - rng.uniform(-2, 2)
    u, v = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    over = pad.pitch * SURFACES[name](u, v, steep, side) + pad.sag()
    noise = 10.0 ** rng.uniform(-6.0, -4.7)
    depth = np.quantile(over, rng.uniform(0.5, 1.0)) - over.min()
    compression = np.maximum(over.min() + depth - over, 0.0) + noise * rng.normal(size=X.shape)
    touched = compression > max(50e-6, 5.0 * noise)
    return KnownTouch(KINDS.get(name, "smooth"), pad, compression, touched, noise)
