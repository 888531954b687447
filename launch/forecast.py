"""What an exploration is expected to cost: before it begins, and again once the hand has grasped.

Slices cost by tolerance over height, as the shipped scenes did; a wider object has longer
contours. Single touches cost by the area, as scans did. Before the grasp the object's box tells its
area, in a simulation; after it the coarse model does. Neither sees hollows and thin walls: such an
object takes many times more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.messages.types import Superquadric
from palpate.nodes import planner
from palpate.nodes.planning.knowledge import fitted_superquadric

ELLIPSOID_POWER = 1.6075  # Of Thomsen's formula for the area, within 1.1 %
COARSE_LEVEL = 4  # Of the icosphere by which the coarse model's area is measured


class ExpectedCost(NamedTuple):
    """What shipped scenes took at one tolerance: lower quartile, median, upper quartile."""

    touches: tuple[float, float, float]
    seconds: tuple[float, float, float]  # Robot time, one finger of the preset ``modern``, s


# By the tolerance over the object's height, %: `palpate bench planners --only tolerances`.
COSTS: Mapping[float, ExpectedCost] = {
    1.0: ExpectedCost((44, 64, 99), (155, 195, 251)),
    0.5: ExpectedCost((51, 80, 106), (165, 196, 260)),
    0.2: ExpectedCost((88, 94, 162), (205, 226, 322)),
    0.1: ExpectedCost((137, 150, 171), (270, 298, 325)),
    0.05: ExpectedCost((183, 200, 293), (334, 367, 498)),
}
# Processor time of a whole run over that of quality normal.
QUALITY_COST: Mapping[str, float] = {"draft": 0.85, "normal": 1.0, "fine": 1.5}


@dataclass(frozen=True, slots=True, kw_only=True)
class ForecastSettings:
    """How the cost follows from the object's size; from the shipped scenes and ten scans."""

    # Area of a box's content over that of the ellipsoid in it; only until the grasp is known.
    fullness: float = 1.2
    typical_perimeter: float = 0.22  # of the shipped scenes: area over height [m]
    # Single touches on `typical_area` [m^2] for `typical_tolerance` [m], and how they grow with a
    # power of the area: large objects have no more features. With the tolerance as slices do, of
    # an object of `typical_height` [m], whatever its own: the error of the poses is the same.
    typical_touches: float = 80.0
    typical_area: float = 0.02
    area_power: float = 0.7
    typical_tolerance: float = 2e-4
    typical_height: float = 0.1
    spread: float = 1.5  # factor between the middle and either quartile of single touches
    grasp_seconds: float = 110.0  # robot time until the first contour [s]
    seconds_per_touch: float = 2.0  # robot time of a single touch with its way [s]
    compute_per_slice_touch: float = 0.05  # processor time on one core of 2020 [s]
    compute_per_single_touch: float = 0.15  # the same where a general solid is fitted [s]


class Forecast(NamedTuple):
    """What an exploration is expected to take."""

    touches: tuple[float, float, float]  # lower quartile, median, upper quartile
    seconds: tuple[float, float, float]  # the same of robot time [s]
    compute: float  # processor time [s]

    def texts(self) -> list[str]:
        """The same in words."""
        (low, middle, high), seconds = self.touches, self.seconds
        return [
            f"about {middle:.0f} touches ({low:.0f} to {high:.0f})",
            f"robot {seconds[1]:.0f} s ({seconds[0]:.0f} to {seconds[2]:.0f})",
            f"computing {self.compute:.0f} s",
        ]


def forecast(
    asked: planner.Params,
    size: Sequence[float],  # Of the object's box, (3,), m
    area: float | None = None,  # Of its surface, m^2; None: as its box lets expect
    quality: str = "normal",
    settings: ForecastSettings = ForecastSettings(),
) -> Forecast:
    """What an object of this size is expected to take, by slices or by single touches."""
    if area is None:
        area = settings.fullness * ellipsoid_area(size)
    height = float(size[2])
    if asked.makes_single_touches:
        found = _single_touches(asked.tolerance, area, settings)
    else:
        cost = expected_cost(asked.tolerance / height)
        found = _slices(cost, area / height / settings.typical_perimeter, settings)
    return found._replace(compute=found.compute * QUALITY_COST[quality])


class SizeCost(NamedTuple):
    """What an object takes at least by its size."""

    touches: float
    seconds: float  # of processor time [s]
    memory: float  # of the node that takes the most [bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeLimits:
    """Which objects are begun, and how their size is weighed.

    A ball of 0.3 m takes 717 touches of a pad 16 mm wide, of which an archive keeps 8 kB each and a
    message in the making some copies.
    """

    max_seconds: float = 600.0  # of processor time [s]
    max_memory: float = 2e9  # [bytes]
    max_extent: float = 1.0  # [m], of a fit: `core.rebuild.general.GridSettings`
    touch_area: float = 1.54  # [pad widths squared] of surface that one touch covers
    touch_memory: float = 40e3  # [bytes] of a touch
    fit_memory: float = 0.45e9  # [bytes] of one fit at most: `core.rebuild.general.GridSettings`
    touch_seconds: float = 0.05  # of processor time, of a touch at least [s]


def size_cost(
    asked: planner.Params,
    size: Sequence[float],  # Of the object's box, (3,), m
    area: float,  # Of its surface, m^2
    pad_width: float,  # m
    quality: str = "normal",
    limits: SizeLimits = SizeLimits(),
) -> SizeCost:
    """What an object of this size takes, and no more than the touches that are allowed."""
    expected = forecast(asked, size, area, quality)
    touches = max(expected.touches[1], area / (limits.touch_area * pad_width**2))
    seconds = max(expected.compute, limits.touch_seconds * touches)
    share = 1.0 if asked.most_touches is None else min(1.0, asked.most_touches / touches)
    memory = limits.fit_memory + limits.touch_memory * share * touches
    return SizeCost(share * touches, share * seconds, memory)


def renewed_forecast(
    asked: planner.Params, coarse: Superquadric, quality: str = "normal"
) -> Forecast | None:
    """The same by the coarse model that the grasp has given; None if that is no solid."""
    from palpate.core.geometry import areas_and_normals  # which nobody needs before the grasp

    try:
        mesh = fitted_superquadric(coarse).shape().mesh(COARSE_LEVEL)
    except ValueError:  # its bend folds it
        return None
    area = float(areas_and_normals(mesh.vertices[mesh.faces])[0].sum())
    return forecast(asked, np.ptp(mesh.vertices, axis=0).tolist(), area, quality)


def expected_cost(share: float) -> ExpectedCost:
    """For a tolerance over the height, between those that were measured by powers."""
    known = np.log(sorted(COSTS))
    rows = np.log([COSTS[one] for one in sorted(COSTS)])

    def between(which: int) -> tuple[float, float, float]:
        at, columns = math.log(100.0 * share), rows[:, which].T
        low, middle, high = (float(np.exp(np.interp(at, known, one))) for one in columns)
        return low, middle, high

    return ExpectedCost(touches=between(0), seconds=between(1))


def ellipsoid_area(size: Sequence[float]) -> float:
    """Area of the ellipsoid in a box of this size (3,), m^2: K. Thomsen's formula."""
    a, b, c = ((0.5 * float(side)) ** ELLIPSOID_POWER for side in size)
    return float(4.0 * math.pi * ((a * b + a * c + b * c) / 3.0) ** (1.0 / ELLIPSOID_POWER))


def _slices(cost: ExpectedCost, wider: float, settings: ForecastSettings) -> Forecast:
    """By the cost of a typical object and by how much longer than its contours these are."""
    low, middle, high = (wider * one for one in cost.touches)
    grasp = settings.grasp_seconds
    begins, median, ends = (grasp + wider * max(one - grasp, 0.0) for one in cost.seconds)
    compute = settings.compute_per_slice_touch * middle
    return Forecast((low, middle, high), (begins, median, ends), compute)


def _single_touches(tolerance: float, area: float, settings: ForecastSettings) -> Forecast:
    asked, typical = (
        expected_cost(one / settings.typical_height).touches[1]
        for one in (tolerance, settings.typical_tolerance)
    )
    larger = (area / settings.typical_area) ** settings.area_power
    middle = settings.typical_touches * larger * asked / typical
    touches = middle / settings.spread, middle, middle * settings.spread
    low, median, high = (
        settings.grasp_seconds + settings.seconds_per_touch * one for one in touches
    )
    return Forecast(touches, (low, median, high), settings.compute_per_single_touch * middle)
