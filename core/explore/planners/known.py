"""What a planner is told: the extent, the demand, the budget, and each slice with its answer.

All lengths are in one unit of the caller's choice, m in palpate itself. Planners work in shares
of the object's height, so that a plan in millimetres is the plan in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

from palpate.core.arrays import Floats, finite_array, positive

LEAST_AZIMUTHS = 4
LEAST_FEATURE = 1e-4
"""Of the object's height: finer than any pad feels, and than what was felt could be counted."""


class Outcome(StrEnum):
    """How a slice ended."""

    CLOSED = "closed"
    """All around."""
    OCCLUDED = "occluded"
    """With gaps that the pad cannot reach; what was felt is given, gaps are interpolated."""
    FAILED = "failed"
    """Touched, but of no use."""
    LOST = "lost"
    """Nothing was there to touch: the height lies beyond the object's end."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Slice:
    """One slice that was asked for; without radii if it gave no usable contour."""

    height: float
    """m."""
    outcome: Outcome
    """How it ended."""
    radii: Floats
    """Distances from the axis at k even azimuths, m; (k,), or (0,)."""
    slopes: Floats
    """Of the radius over the height, from the normals; (k,)."""
    curvatures: Floats
    """Of the side along z, positive where it bulges, 1/m; (k,)."""
    felt_low: Floats
    """Lowest height that its patches have touched, m; (k,)."""
    felt_high: Floats
    """Highest height that its patches have touched, m; (k,)."""
    deviation: float = 0.0
    """Standard deviation of the model at this height, m."""
    touches: int = 0
    """That it took."""
    seconds: float = 0.0
    """Robot time that it took, s."""

    def __post_init__(self) -> None:
        if not math.isfinite(self.height):
            raise ValueError(f"height must be finite, got {self.height} m")
        if not 0.0 <= self.deviation < math.inf:
            raise ValueError(f"deviation must be 0 or more and finite, got {self.deviation} m")
        for name, unit in (("touches", "touches"), ("seconds", "s")):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise ValueError(f"{name} must be 0 or more and finite, got {value} {unit}")
        count = len(finite_array("radii", self.radii, (None,)))
        for name in ("slopes", "curvatures", "felt_low", "felt_high"):
            finite_array(name, getattr(self, name), (count,))
        if self.usable and (count < LEAST_AZIMUTHS or not self.radii.min() > 0.0):
            raise ValueError(
                f"radii must be at least {LEAST_AZIMUTHS} positive lengths where the outcome is "
                f"{self.outcome}, got {count}"
            )

    @property
    def usable(self) -> bool:
        """Whether it tells where the surface is."""
        return self.outcome in (Outcome.CLOSED, Outcome.OCCLUDED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What may be spent and what is spent."""

    most_touches: float = math.inf
    """Touches that may be made."""
    most_seconds: float = math.inf
    """Robot time that may pass, s."""
    touches: int = 0
    """Touches made."""
    seconds: float = 0.0
    """Robot time that has passed, s."""

    def __post_init__(self) -> None:
        for name, unit in (("most_touches", "touches"), ("most_seconds", "s")):
            value = getattr(self, name)
            if not value > 0:
                raise ValueError(f"{name} must be positive, got {value} {unit}")
        for name, unit in (("touches", "touches"), ("seconds", "s")):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise ValueError(f"{name} must be 0 or more and finite, got {value} {unit}")

    @property
    def spent(self) -> bool:
        """Whether nothing is left of it."""
        return self.touches >= self.most_touches or self.seconds >= self.most_seconds


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Known:
    """All that the choice of the next slice may depend on."""

    low: float
    """Height of the object's lower end, m."""
    high: float
    """Height of its upper end, m."""
    low_deviation: float = 0.0
    """Standard deviation of the lower end, m."""
    high_deviation: float = 0.0
    """Standard deviation of the upper end, m."""
    tolerance: float
    """Root mean square error that is asked for, m."""
    resolution: float
    """Smallest difference that the sensor tells, m."""
    feature: float
    """Largest height that may stay unfelt, and least distance of two slices, m."""
    budget: Budget = field(default_factory=Budget)
    """What may be spent."""
    slices: tuple[Slice, ...] = ()
    """In the order in which they were asked for."""
    taken: tuple[float, ...] = ()
    """Heights at which other fingers are at work, m."""
    apart: float = 0.0
    """Height that two fingers keep between them, m."""
    taxels: bool = False
    """Whether the solid is rebuilt from all that was felt, and not from contours alone."""
    deviation: float | None = None
    """Standard deviation of the whole surface of that solid, ends included, m; None without one."""

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise ValueError(f"high must lie above low {self.low} m, got {self.high} m")
        for name in ("tolerance", "resolution", "feature"):
            positive(name, getattr(self, name), "m")
        if self.feature < LEAST_FEATURE * self.extent:
            raise ValueError(
                f"feature must be at least {LEAST_FEATURE:g} of the height {self.extent:g} m, "
                f"got {self.feature} m"
            )
        finite_array("taken", self.taken, (None,))
        if self.tolerance < self.resolution:
            raise ValueError(
                f"tolerance must be at least the sensor's resolution {self.resolution} m, "
                f"got {self.tolerance} m"
            )
        for name in ("low_deviation", "high_deviation", "apart"):
            if not 0.0 <= getattr(self, name) < math.inf:
                value = getattr(self, name)
                raise ValueError(f"{name} must be 0 or more and finite, got {value} m")
        if self.deviation is not None and not 0.0 <= self.deviation < math.inf:
            raise ValueError(f"deviation must be 0 or more and finite, got {self.deviation} m")
        counts = {len(one.radii) for one in self.slices if one.usable}
        if len(counts) > 1:
            raise ValueError(f"all slices must have as many azimuths, got {sorted(counts)}")

    @property
    def extent(self) -> float:
        """Height of the object, m."""
        return self.high - self.low
