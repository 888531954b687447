"""Expected cost of an exploration: before it begins, and again after the grasp.

The cost of slices depends on tolerance over height, as in the shipped scenes; a wider object has
longer contours. The cost of single touches depends on the area, as in scans. Before the grasp, in a
simulation, the area follows from the object's box; after it, from the coarse model. Neither shows
hollows and thin walls: such an object takes many times as many touches.
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

ELLIPSOID_POWER = 1.6075  # of Thomsen's formula for the area, exact to 1.1 %


class ExpectedCost(NamedTuple):
    """Cost of the shipped scenes at one tolerance: lower quartile, median, upper quartile."""

    touches: tuple[float, float, float]
    seconds: tuple[float, float, float]  # robot time of one finger of the preset ``modern`` [s]


# By the tolerance over the object's height [%]: `palpate bench planners --only tolerances`.
EXPECTED_COSTS: Mapping[float, ExpectedCost] = {
    1.0: ExpectedCost((44, 64, 99), (155, 195, 251)),
    0.5: ExpectedCost((51, 80, 106), (165, 196, 260)),
    0.2: ExpectedCost((88, 94, 162), (205, 226, 322)),
    0.1: ExpectedCost((137, 150, 171), (270, 298, 325)),
    0.05: ExpectedCost((183, 200, 293), (334, 367, 498)),
}
# Processor time of a whole run over that with quality normal.
QUALITY_COST_RATIOS: Mapping[str, float] = {"draft": 0.85, "normal": 1.0, "fine": 1.5}


@dataclass(frozen=True, slots=True, kw_only=True)
class ForecastSettings:
    """How the cost depends on the size of the object; from the shipped scenes and ten scans.

    The number of single touches grows with a power of the area, since larger objects have no more
    features. It depends on the tolerance as that of slices of an object of `typical_height` does.
    """

    area_ratio: float = 1.2  # of an object to the ellipsoid in its box; used before the grasp
    typical_perimeter: float = 0.22  # of the shipped scenes: area over height [m]
    typical_touches: float = 80.0  # single touches on `typical_area` for `typical_tolerance`
    typical_area: float = 0.02  # [m^2]
    area_power: float = 0.7  # exponent of the area in the number of single touches
    typical_tolerance: float = 2e-4  # [m]
    typical_height: float = 0.1  # divides tolerances of single touches, to look up their cost [m]
    quartile_ratio: float = 1.5  # upper quartile over median, and median over lower, of touches
    grasp_seconds: float = 110.0  # robot time until the first contour [s]
    seconds_per_touch: float = 2.0  # robot time of a single touch and its approach [s]
    compute_per_slice_touch: float = 0.05  # processor time on one core of 2020 [s]
    compute_per_single_touch: float = 0.15  # the same where a general solid is fitted [s]


class Forecast(NamedTuple):
    """Expected cost of an exploration."""

    touches: tuple[float, float, float]  # lower quartile, median, upper quartile
    seconds: tuple[float, float, float]  # robot time, same quartiles [s]
    compute: float  # processor time [s]

    def texts(self) -> list[str]:
        """The cost in words: touches, robot time and processor time."""
        (low, middle, high), seconds = self.touches, self.seconds
        return [
            f"about {middle:.0f} touches ({low:.0f} to {high:.0f})",
            f"robot {seconds[1]:.0f} s ({seconds[0]:.0f} to {seconds[2]:.0f})",
            f"computing {self.compute:.0f} s",
        ]


def forecast(
    asked: planner.Params,
    size: Sequence[float],
    area: float | None = None,
    quality: str = "normal",
    settings: ForecastSettings = ForecastSettings(),
) -> Forecast:
    """Expected cost of an object of this size, by slices or by single touches as `asked`.

    `size`: of the object's box, (3,) [m]. `area`: of its surface [m^2]; estimated if None.
    """
    if area is None:
        area = settings.area_ratio * ellipsoid_area(size)
    height = float(size[2])
    if asked.makes_single_touches:
        expected = _single_touches(asked.tolerance, area, settings)
    else:
        cost = expected_cost(asked.tolerance / height)
        expected = _slices(cost, area / height / settings.typical_perimeter, settings)
    return expected._replace(compute=expected.compute * QUALITY_COST_RATIOS[quality])


class SizeCost(NamedTuple):
    """Cost of an object, estimated from its size."""

    touches: float
    seconds: float  # processor time [s]
    memory: float  # of the node that needs most [bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeLimits:
    """Limits on the cost of an object, and estimates of the cost from its size.

    A ball of 0.3 m takes 717 touches of a pad 16 mm wide. An archive stores 8 kB of each touch, and
    a message that is being made holds some copies.
    """

    max_seconds: float = 600.0  # processor time beyond which a run is refused [s]
    max_memory: float = 2e9  # of the largest node, beyond which a run is refused [bytes]
    max_extent: float = 1.0  # of a fit [m]: `core.rebuild.general.GridSettings`
    touch_area: float = 1.54  # area of surface that one touch covers [pad widths squared]
    touch_memory: float = 40e3  # memory for each touch [bytes]
    fit_memory: float = 0.45e9  # maximum of one fit [bytes]: `core.rebuild.general.GridSettings`
    touch_seconds: float = 0.05  # minimum processor time of a touch [s]


def size_cost(
    asked: planner.Params,
    size: Sequence[float],
    area: float,
    pad_width: float,
    quality: str = "normal",
    limits: SizeLimits = SizeLimits(),
) -> SizeCost:
    """Cost of an object of this size, with at most the touches that are `asked`.

    `size`: of the object's box, (3,) [m]. `area`: of its surface [m^2]. `pad_width` is in m.
    """
    expected = forecast(asked, size, area, quality)
    touches = max(expected.touches[1], area / (limits.touch_area * pad_width**2))
    seconds = max(expected.compute, limits.touch_seconds * touches)
    share = 1.0 if asked.most_touches is None else min(1.0, asked.most_touches / touches)
    memory = limits.fit_memory + limits.touch_memory * share * touches
    return SizeCost(share * touches, share * seconds, memory)


def renewed_forecast(
    asked: planner.Params, coarse: Superquadric, quality: str = "normal", mesh_level: int = 4
) -> Forecast | None:
    """Expected cost by the coarse model after the grasp; None if that is no solid.

    The area is that of a mesh of the model with `mesh_level` subdivisions of an icosahedron.
    """
    from palpate.core.geometry import areas_and_normals  # imported late: a run starts without it

    try:
        mesh = fitted_superquadric(coarse).shape().mesh(mesh_level)
    except ValueError:  # it is bent into itself
        return None
    area = float(areas_and_normals(mesh.vertices[mesh.faces])[0].sum())
    return forecast(asked, np.ptp(mesh.vertices, axis=0).tolist(), area, quality)


def expected_cost(relative_tolerance: float) -> ExpectedCost:
    """Cost at a tolerance over the height, interpolated between measured ones on log scales."""
    known = np.log(sorted(EXPECTED_COSTS))
    costs = np.log([EXPECTED_COSTS[percent] for percent in sorted(EXPECTED_COSTS)])

    def interpolated(kind: int) -> tuple[float, float, float]:
        x, columns = math.log(100.0 * relative_tolerance), costs[:, kind].T
        low, median, high = (float(np.exp(np.interp(x, known, column))) for column in columns)
        return low, median, high

    return ExpectedCost(touches=interpolated(0), seconds=interpolated(1))


def ellipsoid_area(size: Sequence[float]) -> float:
    """Area of the ellipsoid in a box of this size, (3,) [m]: K. Thomsen's formula [m^2]."""
    a, b, c = ((0.5 * float(side)) ** ELLIPSOID_POWER for side in size)
    return float(4.0 * math.pi * ((a * b + a * c + b * c) / 3.0) ** (1.0 / ELLIPSOID_POWER))


def _slices(cost: ExpectedCost, perimeter_ratio: float, settings: ForecastSettings) -> Forecast:
    """Cost of an object with contours that are `perimeter_ratio` times as long as typical ones."""
    low, middle, high = (perimeter_ratio * touches for touches in cost.touches)
    grasp = settings.grasp_seconds
    short, median, long = (
        grasp + perimeter_ratio * max(seconds - grasp, 0.0) for seconds in cost.seconds
    )
    compute = settings.compute_per_slice_touch * middle
    return Forecast((low, middle, high), (short, median, long), compute)


def _single_touches(tolerance: float, area: float, settings: ForecastSettings) -> Forecast:
    requested, typical = (
        expected_cost(value / settings.typical_height).touches[1]
        for value in (tolerance, settings.typical_tolerance)
    )
    area_factor = (area / settings.typical_area) ** settings.area_power
    middle = settings.typical_touches * area_factor * requested / typical
    touches = middle / settings.quartile_ratio, middle, middle * settings.quartile_ratio
    low, median, high = (
        settings.grasp_seconds + settings.seconds_per_touch * count for count in touches
    )
    return Forecast(touches, (low, median, high), settings.compute_per_single_touch * middle)
