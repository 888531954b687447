"""The templates of the thesis' step sizes (section 3.6): from 1 at 0, falling, never below 0.

As printed some leave that range: a / ln(b x + c) is infinite where b x + c is 1, and
1 / (a x + b)^c begins at 1 only where b is 1. Both are written so that they begin at 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from palpate.core.arrays import Floats

Template = Literal["exponential", "inverse_power", "logarithmic"]
Shape = Callable[[Floats, float], Floats]
"""Of x, 0 or more, and a number that only the last two take."""


def exponential(x: Floats, power: float) -> Floats:
    """e^-x."""
    return np.asarray(np.exp(-x))


def inverse_power(x: Floats, power: float) -> Floats:
    """1 / (1 + x)^power."""
    return np.asarray((1.0 + x) ** -power)


def logarithmic(x: Floats, power: float) -> Floats:
    """ln(c) / ln(x + c) with c = 1 + power, which keeps it above 1."""
    offset = 1.0 + power
    return np.asarray(np.log(offset) / np.log(x + offset))


TEMPLATES: Mapping[Template, Shape] = {
    "exponential": exponential,
    "inverse_power": inverse_power,
    "logarithmic": logarithmic,
}
