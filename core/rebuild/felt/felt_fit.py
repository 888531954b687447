"""What is kept of a fit to felt points: its figures, and how far it can be trusted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.along import SPANS
from palpate.core.rebuild.felt.coverage import Coverage
from palpate.core.rebuild.felt.felt_skin import FeltSkin
from palpate.core.rebuild.skin.contour_skin import SAFE_MOST, SAFE_RMS, Uncertainty

BANDS, BAND_TURNS = 25, 4
"""Heights at which the deviation is given, and turns over which it is averaged."""
POSE_LEFT = 0.4
"""Of the touches' pose error: what it leaves in the surface, for shifts are known against each
other alone. Measured on shipped scenes with 5 and 9 contours, where it makes the 95 % band true."""


class FeltFit(NamedTuple):
    """A fit of the side to felt points; lengths in m."""

    points: int
    """Points on the side."""
    rms: float
    """Root mean square distance of the points from the skin along their normals."""
    sigma: float
    """Standard deviation of a point, from the median distance."""
    pose_blocks: bool
    """Whether a shift of each touch was estimated with the skin."""
    pose_sigma: float
    """Standard deviation of those shifts along the normals; 0 without."""
    condition: float
    """Estimate of the system's condition number, to 2 digits."""
    unfelt_gap: float
    """The highest stretch of the side in which nothing was felt on some azimuth."""
    stretched: bool
    """Whether the side had to be drawn higher than it was felt."""
    lows: Floats
    """Lowest height that was felt in each of 24 even sectors, (24,)."""
    highs: Floats
    """Highest one, (24,)."""
    gaps: Floats
    """Heights of the stretches in which nothing was felt, in any of the sectors, (n,)."""
    band_heights: Floats
    """(25,)."""
    band: Floats
    """Standard deviation of the surface at those heights, (25,)."""

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the fit, by name."""
        numbers = self._asdict().items()
        single = {name: value for name, value in numbers if not isinstance(value, np.ndarray)}
        return {f"felt_{name}": float(value) for name, value in single.items()}

    def uncertainty(self) -> Uncertainty:
        """The whole side in three numbers."""
        extent = float(self.band_heights[-1] - self.band_heights[0])
        narrow = max(self.unfelt_gap, extent / SPANS)
        rms = float(np.sqrt(np.mean(self.band**2)))
        return Uncertainty(SAFE_RMS * rms, SAFE_MOST * float(self.band.max()), 0.5 * narrow)


def felt_fit(
    skin: FeltSkin, seen: Coverage, pose: float | None, reach: tuple[float, float], stretched: bool
) -> FeltFit:
    """What is kept of a skin.

    Parameters
    ----------
    skin : FeltSkin
        The skin.
    seen : Coverage
        Where it was felt.
    pose : float or None
        Standard deviation of the touches' shifts, m; None if they were not estimated.
    reach : pair of float
        Heights between which it is used, m.
    stretched : bool
        Whether that is more than was felt.
    """
    heights = np.linspace(*reach, BANDS)
    deviation = skin.deviation(heights, np.arange(BAND_TURNS) / BAND_TURNS)
    return FeltFit(
        points=len(skin.rows.touch),
        rms=float(np.sqrt(np.mean(skin.misfits() ** 2))),
        sigma=skin.sigma,
        pose_blocks=pose is not None,
        pose_sigma=0.0 if pose is None else pose,
        condition=skin.system.condition,
        unfelt_gap=seen.gap,
        stretched=stretched,
        lows=seen.lows,
        highs=seen.highs,
        gaps=seen.gaps,
        band_heights=heights,
        band=np.sqrt(np.mean(deviation**2, axis=1) + (POSE_LEFT * (pose or 0.0)) ** 2),
    )
