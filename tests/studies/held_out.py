"""Objects that had no say in the numbers of any planner."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from palpate.core.explore.planners import Radius
from palpate.core.explore.planners.trial import _ball, _bump, _oval, _rise, _square

HELD_OUT: Mapping[str, Radius] = {
    "spheroid": lambda z, t: 0.3 * _ball(z) * _oval(t, 1.2),
    "pillow": lambda z, t: 0.4 * _ball(z, 0.7) * _square(t, 4.0),
    "tile": lambda z, t: 0.35 * _ball(z, 0.3) * _square(t, 8.0) * (1.0 - 0.2 * z),
    "barrel": lambda z, t: 0.36 - 0.4 * (z - 0.5) ** 2 + 0.01 * np.cos(2.0 * t),
    "ogive": lambda z, t: np.sqrt(2.0 - z**2) - 0.9 + 0.008 * np.cos(5.0 * t),
    "drop": lambda z, t: 0.75 * np.sqrt(z * np.maximum(1.0 - z, 1e-9)) * (1.2 - z) + 0.0 * t,
    "flask": lambda z, t: 0.13 + 0.2 * _rise(z, 0.6, -0.07) * (1.0 - 0.4 * z) + 0.0 * t,
    "jar": lambda z, t: 0.24 + 0.07 * _rise(z, 0.75, -0.05) + 0.02 * _bump(z, 0.3, 0.2) + 0.0 * t,
    "goblet": lambda z, t: 0.12 + 0.18 * _rise(z, 0.55, 0.1) + 0.14 * _bump(z, 0.0, 0.13) + 0.0 * t,
    "spindle": lambda z, t: 0.2 + 0.06 * np.sin(11.0 * z) + 0.05 * z + 0.0 * t,
    "collar": lambda z, t: 0.27 + 0.035 * _bump(z, 0.63, 0.075) + 0.0 * t,
    "waist": lambda z, t: 0.33 - 0.09 * _bump(z, 0.37, 0.12) + 0.01 * np.cos(3.0 * t),
    "screw": lambda z, t: (0.3 - 0.05 * z) * (1.0 + 0.08 * np.cos(3.0 * t - 2.6 * z)),
    "clover": lambda z, t: 0.3 * _ball(z, 0.8) * (1.0 + 0.06 * np.cos(4.0 * t + 1.0)),
    "dimple": lambda z, t: (
        0.36 * _ball(z, 0.8) * (1.0 - 0.08 * _bump(z, 0.35, 0.1) * (1.0 + np.cos(t)) / 2.0)
    ),
    "potato": lambda z, t: (
        0.34 * _ball(z, 0.9) * (1.0 + 0.08 * np.sin(4.0 * z + t) + 0.05 * np.cos(3.0 * z - 2.0 * t))
    ),
    "cone": lambda z, t: 0.4 - 0.25 * z + 0.0 * t,
    "two steps": lambda z, t: (
        0.18 + 0.07 * _rise(z, 0.35, -0.045) + 0.07 * _rise(z, 0.7, -0.045) + 0.0 * t
    ),
    "knob": lambda z, t: np.sqrt(0.02 + 0.3 * (z - 0.35) ** 2 * (1.25 - z)) + 0.0 * t,
    "leaning": lambda z, t: 0.3 * _ball(z, 0.5) * (1.0 + 0.25 * (z - 0.4) * np.cos(t)),
}
