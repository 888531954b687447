"""First-order distances of points from many superquadrics at once, and their derivatives.

The distance along the normal is (N - 1) / |grad N|, N being the gauge of the straightened point.
It is what the radial distance is not: as large for a point off a disc's flat side as for one off
its rim, so that a model cannot grow unnoticed. Because the gradient's length is the slope along
the normal, and to first order does not feel how the normal turns, its derivative is that of the
slope along a fixed direction: one second derivative for each point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import right_jacobians, rotations_from_vectors
from palpate.core.rebuild.recovery.straightening import (
    Triple,
    Unbent,
    Untapered,
    slope_by_bend,
    slope_by_taper,
    straight_places,
    turned,
    turned_back,
    unbend,
    unbend_rate,
    unbend_slope,
    unbend_slope_of_both,
    untaper,
    untaper_rate,
    untaper_slope,
    untaper_slope_of_both,
)
from palpate.core.shapes import PNorm, PNormCurvature, p_norm, p_norm_curvature

# Parameters: 3 logarithms of the size, 2 exponents, 3 of the rotation vector, 3 of the position; 2
# more if tapered, then 2 more if bent (curvature times direction).
RIGID = 11
LEAST_SLOPE = 1e-12


class Warps(NamedTuple):
    """What is fitted beside size, exponents and pose."""

    taper: bool
    bend: bool

    @property
    def total(self) -> int:
        """Number of parameters."""
        return RIGID + 2 * self.taper + 2 * self.bend

    @property
    def taper_columns(self) -> slice:
        """Where the widenings are."""
        return slice(RIGID, RIGID + 2 * self.taper)

    @property
    def bend_columns(self) -> slice:
        """Where the two numbers of the bend are."""
        return slice(self.total - 2 * self.bend, self.total)


class Seen(NamedTuple):
    """Points, as each of the solids sees them."""

    body: Triple
    unbent: Unbent | None
    untapered: Untapered
    across: PNorm
    whole: PNorm
    signs: Triple


def normal_distances(
    parameters: Floats, points: Floats, frames: Floats, warps: Warps
) -> tuple[Floats, Floats]:
    """Distances and their derivatives.

    Parameters
    ----------
    parameters : (b, p) array
        Of each solid, see `RIGID`. Rotation vectors turn the solid's own axes, and positions are
        along the axes of its frame: so nothing depends on how points and frames lie together.
    points : (n, 3) array
        In the unit of the sizes.
    frames : (b, 3, 3) array
        Axes, as columns, in which each solid stands where no rotation leaves it.
    warps : Warps
        Which parameters there are.

    Returns
    -------
    distances : (b, n) array
        Negative inside.
    jacobian : (b, n, p) array
        Their derivatives by the parameters.
    """
    turns, body = _body(parameters, points, frames)
    seen = _see(parameters, body, warps)
    gradient, length, distance = _distances(seen)
    normal = (gradient[0] / length, gradient[1] / length, gradient[2] / length)
    columns, pull = _columns(seen, parameters, warps, _rates(seen, normal), distance)
    jacobian = np.empty((*distance.shape, warps.total))
    for i, column in columns.items():
        np.divide(column, length, out=jacobian[:, :, i])
    force = np.stack(pull, axis=-1) / length[:, :, None]
    jacobian[:, :, 5:8] = np.cross(force, body) @ right_jacobians(parameters[:, 5:8])
    jacobian[:, :, 8:11] = -force @ turns.transpose(0, 2, 1)
    return distance, jacobian


def distances_alone(parameters: Floats, points: Floats, frames: Floats, warps: Warps) -> Floats:
    """Distances (b, n), at a third of the cost; see `normal_distances`."""
    return _distances(_see(parameters, _body(parameters, points, frames)[1], warps))[2]


def _body(parameters: Floats, points: Floats, frames: Floats) -> tuple[Floats, Floats]:
    """How solids are turned in their frames (b, 3, 3), and points (b, n, 3) in their own axes."""
    turns = rotations_from_vectors(parameters[:, 5:8])
    return turns, (points @ frames - parameters[:, None, 8:11]) @ turns


def _distances(seen: Seen) -> tuple[Triple, Floats, Floats]:
    """Gradient of the gauge by the body's coordinates, its length, and the distances."""
    gradient = _back(seen, _gauge_slope(seen))
    length = np.sqrt(gradient[0] ** 2 + gradient[1] ** 2 + gradient[2] ** 2)
    length = np.maximum(length, LEAST_SLOPE)
    return gradient, length, (seen.whole.value - 1.0) / length


def _see(parameters: Floats, body: Floats, warps: Warps) -> Seen:
    """Straighten points (b, n, 3) of the bodies' axes and work out their gauges."""
    places = (body[:, :, 0], body[:, :, 1], body[:, :, 2])
    unbent, straight = None, places
    if warps.bend:
        unbent = unbend(places, parameters[:, warps.bend_columns])
        straight = straight_places(unbent)
    taper = parameters[:, warps.taper_columns] if warps.taper else None
    untapered = untaper(straight, np.exp(parameters[:, :3]), taper)
    x, y, z = untapered.place
    e1, e2 = parameters[:, 3, None], parameters[:, 4, None]
    across = p_norm(np.abs(x), np.abs(y), e2)
    whole = p_norm(across.value, np.abs(z), e1)
    return Seen(places, unbent, untapered, across, whole, (np.sign(x), np.sign(y), np.sign(z)))


def _gauge_slope(seen: Seen) -> Triple:
    """Derivatives of the gauge by the places of the unit superquadric."""
    (sx, sy, sz), across, whole = seen.signs, seen.across, seen.whole
    return sx * whole.by_x * across.by_x, sy * whole.by_x * across.by_y, sz * whole.by_y


def _back(seen: Seen, by_place: Triple) -> Triple:
    """Derivatives by the body's coordinates."""
    by_straight = untaper_slope(seen.untapered, by_place)
    if seen.unbent is None:
        return by_straight
    bent = unbend_slope(seen.unbent, turned(seen.unbent, by_straight))
    return turned_back(seen.unbent, bent)


class Rates(NamedTuple):
    """How places change along the normals."""

    bent: Triple  # The body's, in the bend's axes
    unbent: Triple  # The straight ones, in the bend's axes
    straight: Triple  # The straight ones, in the body's axes
    unit: Triple  # Those of the unit superquadric


def _rates(seen: Seen, normal: Triple) -> Rates:
    unbent, untapered = seen.unbent, seen.untapered
    if unbent is None:
        return Rates(normal, normal, normal, untaper_rate(untapered, normal))
    bent = turned(unbent, normal)
    moved = unbend_rate(unbent, bent)
    straight = turned_back(unbent, moved)
    return Rates(bent, moved, straight, untaper_rate(untapered, straight))


def _columns(
    seen: Seen, parameters: Floats, warps: Warps, rates: Rates, distance: Floats
) -> tuple[dict[int, Floats], Triple]:
    """Derivatives, times the gradient's length, by all but the pose; and by the body's places.

    Of the gauge less the distance times the slope: `by_place` is their derivative by the places
    of the unit superquadric, `by_rate` that by the rates of these.
    """
    first, unit = _gauge_slope(seen), rates.unit
    second, by_e1, by_e2 = _gauge_curve(seen, parameters, unit)
    across, whole = seen.across, seen.whole
    columns = {
        3: whole.by_exponent - distance * by_e1,
        4: whole.by_x * across.by_exponent - distance * by_e2,
    }
    by_place = _less(first, distance, second)
    by_rate = (-distance * first[0], -distance * first[1], -distance * first[2])
    untapered = seen.untapered
    for i in (0, 1):
        columns[i] = -by_place[i] * untapered.place[i] - by_rate[i] * unit[i]
    if warps.taper:
        both = slope_by_taper(untapered, unit, by_place, by_rate)
        columns.update(zip(range(RIGID, RIGID + 2), both, strict=True))
    by_straight = untaper_slope_of_both(untapered, unit, by_place, by_rate)
    by_moving = untaper_slope(untapered, by_rate)
    columns[2] = -by_straight[2] * untapered.straight[2] - by_moving[2] * rates.straight[2]
    unbent = seen.unbent
    if unbent is None:
        return columns, by_straight
    by_straight, by_moving = turned(unbent, by_straight), turned(unbent, by_moving)
    both = slope_by_bend(unbent, rates.bent, rates.unbent, by_straight, by_moving)
    columns.update(zip(range(warps.total - 2, warps.total), both, strict=True))
    bent = unbend_slope_of_both(unbent, rates.unbent, by_straight, by_moving)
    return columns, turned_back(unbent, bent)


def _gauge_curve(seen: Seen, parameters: Floats, unit: Triple) -> tuple[Triple, Floats, Floats]:
    """Derivatives of the gauge's slope along rates: by the places and by both exponents."""
    (sx, sy, sz), across, whole = seen.signs, seen.across, seen.whole
    e1, e2 = parameters[:, 3, None], parameters[:, 4, None]
    inner: PNormCurvature = p_norm_curvature(across, sx * unit[0], sy * unit[1], e2)
    outer: PNormCurvature = p_norm_curvature(whole, inner.slope, sz * unit[2], e1)
    by_place = (
        sx * (outer.by_x * across.by_x + whole.by_x * inner.by_x),
        sy * (outer.by_x * across.by_y + whole.by_x * inner.by_y),
        sz * outer.by_y,
    )
    by_e2 = outer.by_x * across.by_exponent + whole.by_x * inner.by_exponent
    return by_place, outer.by_exponent, by_e2


def _less(first: Triple, distance: Floats, second: Triple) -> Triple:
    return (
        first[0] - distance * second[0],
        first[1] - distance * second[1],
        first[2] - distance * second[2],
    )
