"""An oracle for casts at superquadrics: slow, plain, and in extended precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.core.arrays import Floats

Wide = np.longdouble
SAMPLES = 700
GOLDEN = Wide(0.5) * (np.sqrt(Wide(5)) - 1)


class Entry(NamedTuple):
    ranges: Any  # First entry, inf if there is none, -inf for a start inside
    least: Any  # Least logarithm of the gauge up to there


@dataclass(frozen=True)
class Oracle:
    """A superquadric, tapered and bent, by its definition."""

    size: Floats
    exponents: Floats
    taper: tuple[float, float] = (0.0, 0.0)
    curvature: float = 0.0
    azimuth: float = 0.0

    def log_gauge(self, points):
        """Logarithm of the base's gauge at straightened points (..., 3)."""
        x, y, z = np.moveaxis(np.asarray(points, Wide), -1, 0)
        k, cosine, sine = (
            Wide(self.curvature),
            np.cos(Wide(self.azimuth)),
            np.sin(Wide(self.azimuth)),
        )
        if k != 0:
            inwards = x * cosine + y * sine
            distance = np.hypot(k * z, 1 - k * inwards)
            before = (2 * inwards - k * (inwards**2 + z**2)) / (1 + distance)
            x, y = x + cosine * (before - inwards), y + sine * (before - inwards)
            z = np.arctan2(k * z, 1 - k * inwards) / k
        a, b, c = self.size.astype(Wide)
        share = np.clip(z / c, -1, 1)
        kx, ky = (Wide(t) for t in self.taper)
        e1, e2 = self.exponents.astype(Wide)
        with np.errstate(divide="ignore"):
            log_x = np.log(np.abs(x / (a * (1 + kx * share))))
            log_y = np.log(np.abs(y / (b * (1 + ky * share))))
            log_z = np.log(np.abs(z / c))
        across = _log_norm(log_x, log_y, e2)
        return _log_norm(across, log_z, e1)

    def entries(self, origins, direction, reach):
        """Where rays first enter: by samples, by the minima between them, and by bisection."""
        start, along = origins.astype(Wide), direction.astype(Wide)

        def depth(ray, way):
            return self.log_gauge(start[ray] + way[:, None] * along)

        ways = np.linspace(Wide(0), Wide(reach), SAMPLES)
        seen = self.log_gauge(start[:, None] + ways[None, :, None] * along)
        found = np.full(len(origins), np.inf, Wide)
        low, high = np.zeros_like(found), np.full_like(found, np.nan)
        first = np.where((seen <= 0).any(axis=1), (seen <= 0).argmax(axis=1), SAMPLES)
        crossing = (first > 0) & (first < SAMPLES)
        low[crossing], high[crossing] = ways[first[crossing] - 1], ways[first[crossing]]
        least = seen.min(axis=1)
        # Dips between samples, latest first, so that the earliest is kept.
        dips = (seen[:, 1:-1] <= seen[:, :-2]) & (seen[:, 1:-1] <= seen[:, 2:])
        ray, place = np.nonzero(dips & (np.arange(1, SAMPLES - 1) < first[:, None]))
        bottom = _bottoms(depth, ray, ways[place], ways[place + 2])
        depths = depth(ray, bottom)
        np.minimum.at(least, ray, depths)
        for i in np.flatnonzero(depths <= 0)[::-1]:
            low[ray[i]], high[ray[i]] = ways[place[i]], bottom[i]
        met = np.flatnonzero(np.isfinite(high))
        near, far = low[met], high[met]
        for _ in range(75):
            middle = (near + far) / 2
            within = depth(met, middle) <= 0
            near, far = np.where(within, near, middle), np.where(within, middle, far)
        found[met] = far
        found[seen[:, 0] <= 0] = -np.inf
        return Entry(found, least)


def _bottoms(depth, ray, low, high):
    """Places of the minima by golden section."""
    for _ in range(60):
        first, second = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left = depth(ray, first) <= depth(ray, second)
        low, high = np.where(left, low, first), np.where(left, second, high)
    return (low + high) / 2


def _log_norm(x, y, e):
    """Logarithm of the norm of power 2 / e, from logarithms that may be -inf."""
    larger = np.maximum(np.maximum(x, y), Wide(-1e4))
    return larger + e / 2 * np.log(np.exp(2 / e * (x - larger)) + np.exp(2 / e * (y - larger)))


@pytest.fixture
def oracle():
    return Oracle


Level = Callable[[Any], Any]  # Points (..., 3) in extended precision to values, positive outside


def entries_of(level, origins, direction, reach):
    """Ranges at which rays first enter, by many samples and bisection; inf if none is seen."""
    start, along = origins.astype(Wide), direction.astype(Wide)
    ways = np.linspace(Wide(0), Wide(reach), 900)
    seen = level(start[:, None] + ways[:, None] * along) <= 0
    first = np.where(seen.any(axis=1), seen.argmax(axis=1), 0)
    found = np.where(seen[:, 0], -np.inf, np.where(first > 0, Wide(0), Wide(np.inf)))
    met = np.flatnonzero(first > 0)
    near, far = ways[first[met] - 1], ways[first[met]]
    for _ in range(62):
        middle = (near + far) / 2
        within = level(start[met] + middle[:, None] * along) <= 0
        near, far = np.where(within, near, middle), np.where(within, middle, far)
    found[met] = far
    return found


def check_cast(shape, level, origins, direction, reach):
    """Check a cast against samples: nothing seen is passed, and all that is met is there."""
    found = shape.cast(origins, direction, reach)
    wanted = entries_of(level, origins, direction, reach)
    inside = wanted == -np.inf
    assert np.array_equal(found == -np.inf, inside)
    assert (found[~inside] <= wanted[~inside] + 1e-11).all()
    # What the samples did not see, or saw later, must be a thin part of the solid.
    early = np.flatnonzero(~inside & (found < wanted - 1e-11))
    places = origins[early] + found[early, None] * direction
    assert np.abs(level(places.astype(Wide)).astype(float)).max(initial=0.0) < 1e-9
    return int(np.isfinite(found).sum())


@pytest.fixture
def cast_check():
    return check_cast
