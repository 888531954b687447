"""Linear tapering along z."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats


@dataclass(frozen=True, slots=True)
class Taper:
    """Widens x and y in proportion to the height: Fung, 1999, (2.7).

    Beyond the ends of what is tapered the widths are those of the ends, so that all of space
    is mapped one to one.

    Parameters
    ----------
    along_x, along_y : float
        Widening at the top, and narrowing at the bottom, as a share of the width; between -1
        and 1, so that no section collapses.
    half_height : float
        Half the height of what is tapered, m.

    Raises
    ------
    ValueError
        If a share is not between -1 and 1.
    """

    along_x: float
    along_y: float
    half_height: float

    def __post_init__(self) -> None:
        if not (abs(self.along_x) < 1.0 and abs(self.along_y) < 1.0):
            raise ValueError(
                f"taper must lie between -1 and 1, got [{self.along_x}, {self.along_y}]"
            )

    def __call__(self, points: Floats) -> Floats:
        """Points (n, 3), tapered."""
        return points * self._widths(points[:, 2])

    def inverse(self, points: Floats) -> Floats:
        """Where tapered points (n, 3) were before."""
        return points / self._widths(points[:, 2])

    def _widths(self, height: Floats) -> Floats:
        share = np.clip(height / self.half_height, -1.0, 1.0)
        return np.column_stack(
            [1.0 + self.along_x * share, 1.0 + self.along_y * share, np.ones_like(share)]
        )
