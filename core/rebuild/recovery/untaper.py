"""Scaling and untapering of many solids' points at once, with what derivatives need of it.

Places and rates go forwards; slopes come back. A rate is how a place changes along one direction,
which the caller picks for each point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

SOFT_END = 0.05
"""Of the half height: beyond the ends, the widths go over to constants within about that, without
the sudden stop that would make derivatives jump where the top's own points lie."""

Triple = tuple[Floats, Floats, Floats]
"""Three coordinates, (b, n) each."""


class Untapered(NamedTuple):
    """Places divided by the semi-axes and by the taper's widths; (b, n) all."""

    place: Triple
    straight: Triple
    """The places before."""
    width: tuple[Floats, Floats]
    """Of the section, as a share."""
    share: Floats
    """Height as a share of the half height, held near 1 beyond the ends."""
    hold: tuple[Floats, Floats]
    """Its first and second derivative by the height in half heights."""
    narrowing: tuple[Floats, Floats]
    """Logarithmic derivative of the width by the height in half heights."""
    easing: tuple[Floats, Floats]
    """Second derivative of the width by that height, as a share of the width."""
    scale: Triple
    """Reciprocals of the semi-axes, (b, 1), the first two over the width."""


def untaper(straight: Triple, size: Floats, taper: Floats | None) -> Untapered:
    """Places of the unit superquadric, from semi-axes (b, 3) and widenings (b, 2)."""
    x, y, z = straight
    a, b, c = (1.0 / size[:, i, None] for i in range(3))
    high = z * c
    if taper is None:
        one, none = np.ones((1, 1)), np.zeros((1, 1))
        pair = (none, none)
        place = (x * a, y * b, high)
        return Untapered(place, straight, (one, one), high, (one, none), pair, pair, (a, b, c))
    share, first, second = _held(high)
    along_x, along_y = taper[:, 0, None], taper[:, 1, None]
    wide, deep = 1.0 + along_x * share, 1.0 + along_y * share
    scale = (a / wide, b / deep, c)
    return Untapered(
        (x * scale[0], y * scale[1], high),
        straight,
        (wide, deep),
        share,
        (first, second),
        (along_x * first / wide, along_y * first / deep),
        (along_x * second / wide, along_y * second / deep),
        scale,
    )


def _held(high: Floats) -> Triple:
    """Heights that do not go far beyond 1, with their first and second derivatives."""
    beyond = np.maximum(np.abs(high) - 1.0, 0.0) / SOFT_END
    bent = np.tanh(beyond)
    share = np.clip(high, -1.0, 1.0) + np.sign(high) * SOFT_END * bent
    first = 1.0 - bent * bent
    return share, first, -2.0 / SOFT_END * np.sign(high) * bent * first


def rate(at: Untapered, straight: Triple) -> Triple:
    """How the places change, from how the straight ones do."""
    high = straight[2] * at.scale[2]
    return (
        straight[0] * at.scale[0] - at.place[0] * at.narrowing[0] * high,
        straight[1] * at.scale[1] - at.place[1] * at.narrowing[1] * high,
        high,
    )


def slope(at: Untapered, by_place: Triple) -> Triple:
    """Derivatives by the straight places, from those by the places."""
    lean = sum(by_place[i] * at.place[i] * at.narrowing[i] for i in (0, 1))
    return (
        by_place[0] * at.scale[0],
        by_place[1] * at.scale[1],
        (by_place[2] - lean) * at.scale[2],
    )


def slope_of_both(at: Untapered, moving: Triple, by_place: Triple, by_rate: Triple) -> Triple:
    """Derivatives by the straight places, of what depends on places and on rates `moving`."""
    high = moving[2]
    across = [(by_place[i] - by_rate[i] * at.narrowing[i] * high) * at.scale[i] for i in (0, 1)]
    lean = by_place[2]
    for i in (0, 1):
        narrowing = at.narrowing[i]
        lean = lean - by_place[i] * at.place[i] * narrowing
        curve = at.place[i] * (narrowing * narrowing - at.easing[i])
        lean = lean + by_rate[i] * (curve * high - narrowing * moving[i])
    return across[0], across[1], lean * at.scale[2]


def slope_by_taper(
    at: Untapered, moving: Triple, by_place: Triple, by_rate: Triple
) -> tuple[Floats, Floats]:
    """Derivatives by the two widenings."""
    high, found = moving[2], []
    for i in (0, 1):
        share = at.share / at.width[i]
        first = at.hold[0] / at.width[i]
        change = at.place[i] * high * (share * at.narrowing[i] - first) - share * moving[i]
        found.append(by_rate[i] * change - by_place[i] * at.place[i] * share)
    return found[0], found[1]
