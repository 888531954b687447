"""The three common shapes to which a grasp may be restricted."""

from __future__ import annotations

from palpate.core.arrays import Floats

CHOICES: dict[str, tuple[float, float]] = {
    "sphere": (1.0, 1.0),
    "box": (0.2, 0.2),
    "cylinder": (0.2, 1.0),
}
"""Exponents e1 and e2: Fung, 1999, 3.2.2, step 1."""


def name_of(exponents: Floats) -> str:
    """Which of the three has these exponents (2,)."""
    return next(name for name, pair in CHOICES.items() if pair == tuple(exponents.tolist()))
