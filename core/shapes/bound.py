"""How far a quantity that changes along rays can go, and how fast, and how fast that changes."""

from __future__ import annotations

from typing import NamedTuple


class Bound(NamedTuple):
    """Largest absolute values, over all that some rays pass through."""

    value: float
    """Of the quantity itself."""
    slope: float
    """Of its first derivative."""
    curve: float
    """Of its second derivative."""

    def times(self, other: Bound) -> Bound:
        """That of the product of two quantities."""
        return Bound(
            self.value * other.value,
            self.slope * other.value + self.value * other.slope,
            self.curve * other.value + 2.0 * self.slope * other.slope + self.value * other.curve,
        )

    def plus(self, other: Bound) -> Bound:
        """That of the sum of two quantities."""
        return Bound(self.value + other.value, self.slope + other.slope, self.curve + other.curve)

    def scaled(self, factor: float) -> Bound:
        """That of a multiple of the quantity."""
        factor = abs(factor)
        return Bound(factor * self.value, factor * self.slope, factor * self.curve)


ONE = Bound(1.0, 0.0, 0.0)
"""That of 1."""
