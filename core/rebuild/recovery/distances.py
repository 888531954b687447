"""First-order distances of points from many superquadrics at once, and their derivatives.

The distance along the normal is (N - 1) / |grad N|, N being the gauge of the point after unbending
and untapering. Unlike the radial distance, it is the same for a point off the flat side of a disc
and a point as far off its rim, so that a model does not grow unnoticed. The gradient's length is
the slope of N along the normal, and to first order does not depend on how the normal turns: its
derivative is that of the slope along a fixed direction, one second derivative for each point.

Points are first unbent, then untapered. A rate is the derivative of a place along one direction,
which the caller selects for each point; slopes are derivatives by places, and are propagated back.
A bend is its curvature times its direction, two numbers that are smooth at no bend: no formula here
divides by the curvature (`palpate.core.shapes.global_deformations` has the same map for one solid).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import right_jacobians, rotations_from_vectors
from palpate.core.shapes import PNorm, PNormCurvature, p_norm, p_norm_curvature

# Parameters: 3 logarithms of the size, 2 exponents, 3 of the rotation vector, 3 of the position; 2
# more if tapered, then 2 more if bent (curvature times direction).
N_RIGID = 11
MIN_SLOPE = 1e-12
MIN_CURVATURE = 1e-150  # below it there is no bend: its square would underflow
Triple = tuple[Floats, Floats, Floats]  # three coordinates, (b, n) each


class Warps(NamedTuple):
    """Deformations that are fitted besides size, exponents and pose, and how they are smoothed."""

    taper: bool
    bend: bool
    # Beyond the ends the tapered width goes over to a constant within about this fraction of the
    # half height: a sudden stop would make derivatives jump where points of the top lie.
    end_softness: float = 0.05
    min_stretch: float = 1e-3  # fraction of the bend's radius: bounds slopes at its centre

    @property
    def total(self) -> int:
        """Number of parameters."""
        return N_RIGID + 2 * self.taper + 2 * self.bend

    @property
    def taper_columns(self) -> slice:
        """Columns of the two taper parameters; empty without a taper."""
        return slice(N_RIGID, N_RIGID + 2 * self.taper)

    @property
    def bend_columns(self) -> slice:
        """Columns of the two bend parameters; empty without a bend."""
        return slice(self.total - 2 * self.bend, self.total)


class LocalPoints(NamedTuple):
    """Points in the coordinates of each solid, and their gauge."""

    body: Triple  # in the axes of the solid
    unbent: Unbent | None
    untapered: Untapered
    across: PNorm  # of x and y
    whole: PNorm  # of `across` and z
    signs: Triple


def normal_distances(
    parameters: Floats, points: Floats, frames: Floats, warps: Warps
) -> tuple[Floats, Floats]:
    """Distances (b, n), negative inside, and their derivatives (b, n, p).

    Of solids with parameters (b, p), see `N_RIGID`, from points (n, 3) in the unit of the sizes.
    The columns of `frames` (b, 3, 3) are each solid's axes before its rotation: rotation vectors
    turn the solid's own axes, and positions are along those of its frame.
    """
    turns, body = _body(parameters, points, frames)
    local = _local(parameters, body, warps)
    gradient, length, distance = _distances(local)
    x, y, z = (part / length for part in gradient)
    columns, pull = _columns(local, parameters, warps, (x, y, z), distance)
    jacobian = np.empty((*distance.shape, warps.total))
    for i, column in columns.items():
        np.divide(column, length, out=jacobian[:, :, i])
    force = np.stack(pull, axis=-1) / length[:, :, None]
    jacobian[:, :, 5:8] = np.cross(force, body) @ right_jacobians(parameters[:, 5:8])
    jacobian[:, :, 8:11] = -force @ turns.transpose(0, 2, 1)
    return distance, jacobian


def _columns(
    local: LocalPoints, parameters: Floats, warps: Warps, normal: Triple, distance: Floats
) -> tuple[dict[int, Floats], Triple]:
    """Derivatives, times the gradient's length, by all but the pose; and by the body's places."""
    untapered, unbent = local.untapered, local.unbent
    # Rates along the normals: bent and unbent ones in the bend's axes, and straight ones.
    bent = moved = straight = normal
    if unbent is not None:
        bent = turned(unbent, normal)
        along = (unbent.cosine * bent[2] + unbent.sine * bent[0]) / unbent.stretch
        moved = unbent.cosine * bent[0] - unbent.sine * bent[2], bent[1], along
        straight = turned_back(unbent, moved)
    first, unit = _gauge_slope(local), untaper_rate(untapered, straight)
    second, by_e1, by_e2 = _gauge_curvature(local, parameters, unit)
    across, whole = local.across, local.whole
    columns = {
        3: whole.by_exponent - distance * by_e1,
        4: whole.by_x * across.by_exponent - distance * by_e2,
    }
    x, y, z = (slope - distance * bend for slope, bend in zip(first, second, strict=True))
    by_place = (x, y, z)
    by_rate = (-distance * first[0], -distance * first[1], -distance * first[2])
    for i in (0, 1):
        columns[i] = -by_place[i] * untapered.place[i] - by_rate[i] * unit[i]
    if warps.taper:
        both = slope_by_taper(untapered, unit, by_place, by_rate)
        columns.update(zip(range(N_RIGID, N_RIGID + 2), both, strict=True))
    by_straight = untaper_slope_of_both(untapered, unit, by_place, by_rate)
    by_moving = untaper_slope(untapered, by_rate)
    columns[2] = -by_straight[2] * untapered.straight[2] - by_moving[2] * straight[2]
    if unbent is None:
        return columns, by_straight
    by_straight, by_moving = turned(unbent, by_straight), turned(unbent, by_moving)
    both = slope_by_bend(unbent, bent, moved, by_straight, by_moving)
    columns.update(zip(range(warps.total - 2, warps.total), both, strict=True))
    by_bent = unbend_slope_of_both(unbent, moved, by_straight, by_moving)
    return columns, turned_back(unbent, by_bent)


def _gauge_curvature(
    local: LocalPoints, parameters: Floats, unit: Triple
) -> tuple[Triple, Floats, Floats]:
    """Derivatives of the gauge's slope along rates: by the places and by both exponents."""
    (sx, sy, sz), across, whole = local.signs, local.across, local.whole
    e1, e2 = parameters[:, 3, None], parameters[:, 4, None]
    inner: PNormCurvature = p_norm_curvature(across, sx * unit[0], sy * unit[1], e2)
    outer: PNormCurvature = p_norm_curvature(whole, inner.slope, sz * unit[2], e1)
    x = sx * (outer.by_x * across.by_x + whole.by_x * inner.by_x)
    y = sy * (outer.by_x * across.by_y + whole.by_x * inner.by_y)
    by_e2 = outer.by_x * across.by_exponent + whole.by_x * inner.by_exponent
    return (x, y, sz * outer.by_y), outer.by_exponent, by_e2


def slope_by_taper(
    at: Untapered, moving: Triple, by_place: Triple, by_rate: Triple
) -> tuple[Floats, Floats]:
    """Derivatives by both taper parameters of a function of places and of rates `moving`."""
    high, by_taper = moving[2], []
    for i in (0, 1):
        share = at.share / at.width[i]
        first = at.hold[0] / at.width[i]
        change = at.place[i] * high * (share * at.narrowing[i] - first) - share * moving[i]
        by_taper.append(by_rate[i] * change - by_place[i] * at.place[i] * share)
    return by_taper[0], by_taper[1]


def untaper_slope_of_both(
    at: Untapered, moving: Triple, by_place: Triple, by_rate: Triple
) -> Triple:
    """Derivatives by the straight places of a function of places and of rates `moving`."""
    high = moving[2]
    across = [(by_place[i] - by_rate[i] * at.narrowing[i] * high) * at.scale[i] for i in (0, 1)]
    lean = by_place[2]
    for i in (0, 1):
        narrowing = at.narrowing[i]
        lean = lean - by_place[i] * at.place[i] * narrowing
        curve = at.place[i] * (narrowing * narrowing - at.easing[i])
        lean = lean + by_rate[i] * (curve * high - narrowing * moving[i])
    return across[0], across[1], lean * at.scale[2]


def slope_by_bend(
    at: Unbent, bent: Triple, moving: Triple, by_place: Triple, by_rate: Triple
) -> tuple[Floats, Floats]:
    """Derivatives by both bend parameters of a function of places and of rates `moving`.

    `bent`: the rates before unbending.
    """
    r, z, stretch, s, c = at.inwards, at.along, at.stretch, at.sine, at.cosine
    angle = at.curvature * z
    sag = z * angle * at.rise
    turn, stretching = z * at.chord / stretch, sag - r
    along_curvature = (
        -by_place[0] * z * z * at.rise
        + by_place[2] * z * (r - z * angle * at.lag) / stretch
        - by_rate[0] * stretch * moving[2] * turn
        + by_rate[2] * (moving[0] * turn - moving[2] * stretching) / stretch
    )
    chord = z * at.chord
    along_direction = (
        -by_place[0] * at.across * sag
        - by_place[1] * stretch * z * z * at.rise
        + by_place[2] * chord * at.across / stretch
        - by_rate[0] * (bent[1] * sag + s * moving[2] * at.across)
        - by_rate[1] * (bent[0] * sag + chord * bent[2])
        + by_rate[2]
        * (chord * bent[1] + (moving[2] * c + moving[0] * s / stretch) * at.across)
        / stretch
    )
    cx, cy = at.towards
    x = along_curvature * cx - along_direction * cy
    return x, along_curvature * cy + along_direction * cx


def unbend_slope_of_both(at: Unbent, moving: Triple, by_place: Triple, by_rate: Triple) -> Triple:
    """Derivatives by the bent places of a function of straight places and of rates `moving`."""
    inwards, across, up = unbend_slope(at, by_place)
    spin = at.curvature * (by_rate[2] * moving[0] / at.stretch**2 - by_rate[0] * moving[2])
    stretching = at.curvature * by_rate[2] * moving[2] / at.stretch
    x = inwards + spin * at.sine + stretching * at.cosine
    return x, across, up + spin * at.cosine - stretching * at.sine


def untaper_rate(at: Untapered, straight: Triple) -> Triple:
    """Rates of the places, from rates of the straight places."""
    high = straight[2] * at.scale[2]
    x = straight[0] * at.scale[0] - at.place[0] * at.narrowing[0] * high
    y = straight[1] * at.scale[1] - at.place[1] * at.narrowing[1] * high
    return x, y, high


def distances_alone(parameters: Floats, points: Floats, frames: Floats, warps: Warps) -> Floats:
    """Distances (b, n) as `normal_distances`, at a third of its cost."""
    return _distances(_local(parameters, _body(parameters, points, frames)[1], warps))[2]


def _distances(local: LocalPoints) -> tuple[Triple, Floats, Floats]:
    """Gradient of the gauge by the body's coordinates, its length, and the distances."""
    gradient = untaper_slope(local.untapered, _gauge_slope(local))
    if local.unbent is not None:
        bent = unbend_slope(local.unbent, turned(local.unbent, gradient))
        gradient = turned_back(local.unbent, bent)
    length = np.sqrt(gradient[0] ** 2 + gradient[1] ** 2 + gradient[2] ** 2)
    length = np.maximum(length, MIN_SLOPE)
    return gradient, length, (local.whole.value - 1.0) / length


def untaper_slope(at: Untapered, by_place: Triple) -> Triple:
    """Derivatives by the straight places, from those by the places."""
    lean = sum(by_place[i] * at.place[i] * at.narrowing[i] for i in (0, 1))
    x, y = by_place[0] * at.scale[0], by_place[1] * at.scale[1]
    return x, y, (by_place[2] - lean) * at.scale[2]


def unbend_slope(at: Unbent, by_straight: Triple) -> Triple:
    """Derivatives by the bent places, from those by the straight ones, in the bend's axes."""
    inwards, across, along = by_straight
    along = along / at.stretch
    x, z = inwards * at.cosine + along * at.sine, along * at.cosine - inwards * at.sine
    return x, across, z


def turned(at: Unbent, vector: Triple) -> Triple:
    """A vector in the bend's axes, from the body's axes."""
    cx, cy = at.towards
    return vector[0] * cx + vector[1] * cy, vector[1] * cx - vector[0] * cy, vector[2]


def turned_back(at: Unbent, vector: Triple) -> Triple:
    """A vector in the body's axes, from the bend's axes."""
    cx, cy = at.towards
    return vector[0] * cx - vector[1] * cy, vector[0] * cy + vector[1] * cx, vector[2]


def _gauge_slope(local: LocalPoints) -> Triple:
    """Derivatives of the gauge by the places of the unit superquadric."""
    (sx, sy, sz), across, whole = local.signs, local.across, local.whole
    return sx * whole.by_x * across.by_x, sy * whole.by_x * across.by_y, sz * whole.by_y


def _local(parameters: Floats, body: Floats, warps: Warps) -> LocalPoints:
    """Unbend and untaper points (b, n, 3) in the bodies' axes, and compute their gauges."""
    places = (body[:, :, 0], body[:, :, 1], body[:, :, 2])
    unbent, straight = None, places
    if warps.bend:
        unbent = unbend(places, parameters[:, warps.bend_columns], warps.min_stretch)
        straight = turned_back(unbent, (unbent.inwards, unbent.across, unbent.along))
    taper = parameters[:, warps.taper_columns] if warps.taper else None
    untapered = untaper(straight, np.exp(parameters[:, :3]), taper, warps.end_softness)
    x, y, z = untapered.place
    e1, e2 = parameters[:, 3, None], parameters[:, 4, None]
    across = p_norm(np.abs(x), np.abs(y), e2)
    whole = p_norm(across.value, np.abs(z), e1)
    return LocalPoints(
        places, unbent, untapered, across, whole, (np.sign(x), np.sign(y), np.sign(z))
    )


def unbend(bent: Triple, bend: Floats, min_stretch: float) -> Unbent:
    """Straighten places (b, n) that bends (b, 2) have bent, each curvature times direction."""
    x, y, z = bent
    k = np.hypot(bend[:, 0], bend[:, 1])[:, None]
    none = k < MIN_CURVATURE
    safe = np.where(none, 1.0, k)
    cx = np.where(none, 1.0, bend[:, 0, None] / safe)
    cy = np.where(none, 0.0, bend[:, 1, None] / safe)
    inwards, across = x * cx + y * cy, y * cx - x * cy
    up, level = k * z, 1.0 - k * inwards
    stretch = np.maximum(np.hypot(up, level), min_stretch)
    angle = np.arctan2(up, level)
    small = np.abs(angle) < 0.3  # where the series of t - sin(t) loses fewer digits
    safe_angle, square = np.where(small, 1.0, angle), angle * angle
    chord = np.sinc(angle / np.pi)
    half = np.sinc(angle / (2.0 * np.pi))
    series = 1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0))
    lag = np.where(small, series, (angle - np.sin(angle)) / safe_angle**3)
    return Unbent(
        k,
        (cx, cy),
        (2.0 * inwards - k * (inwards * inwards + z * z)) / (1.0 + stretch),
        across,
        np.where(none, z, angle / safe),
        stretch,
        level / stretch,
        up / stretch,
        chord,
        0.5 * half * half,
        lag,
    )


def untaper(straight: Triple, size: Floats, taper: Floats | None, end_softness: float) -> Untapered:
    """Places of the unit superquadric, from semi-axes (b, 3) and taper parameters (b, 2)."""
    x, y, z = straight
    a, b, c = (1.0 / size[:, i, None] for i in range(3))
    high = z * c
    if taper is None:
        unit, zero = np.ones((1, 1)), np.zeros((1, 1))
        pair = (zero, zero)
        place = (x * a, y * b, high)
        return Untapered(place, straight, (unit, unit), high, (unit, zero), pair, pair, (a, b, c))
    share, first, second = _clamped_softly(high, end_softness)
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


def _clamped_softly(high: Floats, softness: float) -> Triple:
    """Heights clamped to little beyond -1 and 1, with their first and second derivatives."""
    excess = np.maximum(np.abs(high) - 1.0, 0.0) / softness
    bent = np.tanh(excess)
    share = np.clip(high, -1.0, 1.0) + np.sign(high) * softness * bent
    first = 1.0 - bent * bent
    return share, first, -2.0 / softness * np.sign(high) * bent * first


def _body(parameters: Floats, points: Floats, frames: Floats) -> tuple[Floats, Floats]:
    """Rotations (b, 3, 3) of solids in their frames, and points (b, n, 3) in the solids' axes."""
    turns = rotations_from_vectors(parameters[:, 5:8])
    return turns, (points @ frames - parameters[:, None, 8:11]) @ turns


class Unbent(NamedTuple):
    """Straightened places in the bend's axes; (b, n) unless a comment says otherwise."""

    curvature: Floats  # (b, 1)
    towards: tuple[Floats, Floats]  # direction of the bend, (b, 1) each
    inwards: Floats
    across: Floats
    along: Floats
    stretch: Floats  # length of the fibre, as a fraction of the axis's
    cosine: Floats
    sine: Floats
    chord: Floats  # sin(t) / t of the angle t by which the bend turned the place
    rise: Floats  # (1 - cos(t)) / t^2
    lag: Floats  # (t - sin(t)) / t^3


class Untapered(NamedTuple):
    """Places divided by the semi-axes and by the taper's widths; all (b, n)."""

    place: Triple
    straight: Triple  # the places before
    width: tuple[Floats, Floats]  # of the section, as a fraction of that at mid height
    share: Floats  # height over the half height, clamped softly beyond the ends
    hold: tuple[Floats, Floats]  # first and second derivative of `share` by height / half height
    narrowing: tuple[Floats, Floats]  # logarithmic derivative of the width by that height
    easing: tuple[Floats, Floats]  # second derivative of the width by that height, over the width
    scale: Triple  # reciprocals of the semi-axes, (b, 1), the first two over the width
