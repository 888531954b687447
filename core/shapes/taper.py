"""Linear tapering along z."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats


@dataclass(frozen=True, slots=True)
class Taper:
    """Widens x and y in proportion to the height: Fung, 1999, (2.7).

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
        share = points[:, 2] / self.half_height
        return np.column_stack(
            [
                points[:, 0] * (1.0 + self.along_x * share),
                points[:, 1] * (1.0 + self.along_y * share),
                points[:, 2],
            ]
        )
