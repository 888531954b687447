"""Straight homogeneous generalised cones through touched points, with their axis.

A point at height s along the axis and azimuth theta about it has the radius f(s) g(theta): Fung,
1999, (1.4) with B = 0 absorbed, and 2.5.1. Three kinds are fitted: a surface of revolution, g = 1
and f a spline; a *linear* cone or cylinder, f straight and g free; and both free. Axis, f and g are
fitted together by damped Gauss-Newton steps, solved by QR.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.geometry import close_rings
from palpate.core.poses import axes_along
from palpate.core.shapes import Mesh
from palpate.core.splines import clamped_basis

ConeKind = Literal["revolution", "linear", "free"]
Longs = NDArray[np.integer]
AXIS_TILT = slice(2, 4)  # place of the axis's direction among the parameters


@dataclass(frozen=True, slots=True, kw_only=True)
class ConeFitSettings:
    """How finely a generalised cone is modelled, and when its fit has converged."""

    knot_spacing: float = 5.0e-3  # [m] along the profile
    min_knots: int = 4
    max_knots: int = 80
    n_harmonics: int = 8  # of a free section
    n_touch_points: int = 40  # to which a larger touch is thinned; less than twice as many are kept
    smoothing: float = 1e-4  # weight of second differences and harmonics over that of all points
    max_slope: float = 5.0  # [1] of the profile, where radial offsets are converted to distances
    max_steps: int = 30  # damped Gauss-Newton steps
    initial_damping: float = 1e-3  # fraction of a column's mean square
    damping_factor: float = 10.0  # divides damping after a good step, multiplies it after a bad one
    max_damping: float = 1e6  # beyond it, the fit ends
    min_gain: float = 1e-10  # [extent of the points] least decrease of the rms by a step
    min_relative_gain: float = 1e-4  # [rms] the same; the larger limit counts


DEFAULT_CONE_FIT = ConeFitSettings()


class ConeFit(NamedTuple):
    """A generalised cone, its axis, and its residuals."""

    kind: ConeKind
    point: Floats  # on the axis, (3,) [m]; heights count from here
    axis: Floats  # unit vector, (3,)
    low: float  # [m] least touched height
    high: float  # [m] largest touched height
    profile: Floats  # coefficients of the radius along the axis [m]
    section: Floats  # (2 h,): factors of cos and sin of 1 to h times the azimuth
    across: Floats  # unit vectors at azimuths 0 and pi / 2, (3, 2)
    rms: float  # [m] of the points' distances
    worst: float  # [m] largest root mean square distance of a touch
    axis_error: float  # [rad] standard deviation of the axis's angle

    def radius(self, heights: Floats, azimuths: Floats) -> Floats:
        """The radius (n,) at heights [m] and azimuths [rad], (n,) each; linear beyond the ends."""
        return np.asarray(
            _profile(self, heights)[0] @ self.profile * _section_factor(self, azimuths)
        )


def fit_cone(
    touches: Sequence[Floats],
    kind: ConeKind,
    point: Floats,
    axis: Floats,
    sigma: float,
    *,
    is_axis_fixed: bool = False,
    settings: ConeFitSettings = DEFAULT_CONE_FIT,
) -> ConeFit:
    """The cone through touches, (n, 3) points each [m], from an approximate axis.

    `point`, `axis` (3,): a point of the axis [m] and its unit vector. `sigma`: standard deviation
    of a touch across the surface [m], from which the axis's error follows. `is_axis_fixed`: keep
    the direction of the axis. Raises ValueError if there are fewer than 4 touches.
    """
    if len(touches) < 4:
        raise ValueError(f"a cone needs 4 touches, got {len(touches)}")
    thinned = [touch[:: max(len(touch) // settings.n_touch_points, 1)] for touch in touches]
    points = np.concatenate(thinned)
    numbers = np.repeat(np.arange(len(thinned)), list(map(len, thinned)))
    cone = _initial_cone(points, kind, point, axis, settings)
    damping, extent = settings.initial_damping, float(np.ptp(points, axis=0).max())
    offsets = _offsets(cone, points, settings)
    for _ in range(settings.max_steps):
        jacobian = _jacobian(cone, points, settings)
        jacobian[:, AXIS_TILT] *= not is_axis_fixed
        step = _damped_step(jacobian, offsets, cone, damping, settings)
        moved = _stepped(cone, step)
        after = _offsets(moved, points, settings)
        if after @ after < offsets @ offsets:
            before, rms = (math.sqrt(values @ values / len(values)) for values in (offsets, after))
            cone, offsets, damping = moved, after, damping / settings.damping_factor
            if before - rms < max(settings.min_gain * extent, settings.min_relative_gain * rms):
                break
        elif damping > settings.max_damping:
            break
        else:
            damping *= settings.damping_factor
    return _with_errors(cone, points, numbers, offsets, sigma, settings)


def _initial_cone(
    points: Floats, kind: ConeKind, point: Floats, axis: Floats, settings: ConeFitSettings
) -> ConeFit:
    """A cone of round section about the given axis, its profile fitted to the points' radii."""
    heights = (points - point) @ axis
    low, high = float(heights.min()), float(heights.max())
    count = 2
    if kind != "linear":
        n_knots = round((high - low) / settings.knot_spacing)
        count = min(max(n_knots, settings.min_knots), settings.max_knots)
    frame, section = axes_along(axis), 0 if kind == "revolution" else 2 * settings.n_harmonics
    shape = np.zeros(count), np.zeros(section), frame[:, :2]
    start = ConeFit(kind, point, axis, low, high, *shape, rms=0.0, worst=0.0, axis_error=0.0)
    radii = np.linalg.norm(np.cross(points - point, axis), axis=1)
    rows, smoothing = _profile(start, heights)[0], settings.smoothing
    rough = smoothing * math.sqrt(len(rows)) * _roughness(start)[:, 4 : 4 + count]
    rows = np.vstack([rows, rough, smoothing**2 * np.eye(count)])
    targets = np.concatenate([radii, np.zeros(len(rows) - len(radii))])
    return start._replace(profile=least_squares(rows, targets))


def _polar(cone: ConeFit, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Heights, azimuths and radii (n,) of points."""
    local = points - cone.point
    x, y = (local @ cone.across).T
    return local @ cone.axis, np.arctan2(y, x), np.hypot(x, y)


def _profile(cone: ConeFit, heights: Floats) -> tuple[Floats, Floats]:
    """Basis functions of the profile at heights, (n, k), and their slopes [1/m]."""
    length = max(cone.high - cone.low, 1e-9)
    x = (heights - cone.low) / length
    inside = np.clip(x, 0.0, 1.0)
    if len(cone.profile) == 2:
        ones = np.ones_like(x)
        return np.column_stack([1.0 - x, x]), np.column_stack([-ones, ones]) / length
    local = clamped_basis(len(cone.profile)).nonzero(inside, 1)
    rows, slopes = np.zeros((2, len(x), len(cone.profile)))
    np.put_along_axis(rows, local.columns(), local.values[0], axis=1)
    np.put_along_axis(slopes, local.columns(), local.values[1], axis=1)
    rows += (x - inside)[:, None] * slopes
    return rows, slopes / length


def _section_factor(cone: ConeFit, azimuths: Floats) -> Floats:
    """Radius of the section (n,) over its mean."""
    harmonics, _ = _harmonics(cone, azimuths)
    return np.asarray(1.0 + harmonics @ cone.section)


def _harmonics(cone: ConeFit, azimuths: Floats) -> tuple[Floats, Floats]:
    """Cosines and sines (n, 2 h) of the section, and their slopes."""
    orders = np.arange(1, len(cone.section) // 2 + 1)
    angles = np.outer(azimuths, orders)
    cosine, sine = np.cos(angles), np.sin(angles)
    return np.hstack([cosine, sine]), np.hstack([-orders * sine, orders * cosine])


def _offsets(cone: ConeFit, points: Floats, settings: ConeFitSettings) -> Floats:
    """Distances (n,) of points from the cone, to first order [m]; positive outside."""
    heights, azimuths, radii = _polar(cone, points)
    stretch = _radial_stretch(cone, heights, azimuths, settings)
    return np.asarray((radii - cone.radius(heights, azimuths)) / stretch)


def _radial_stretch(
    cone: ConeFit, heights: Floats, azimuths: Floats, settings: ConeFitSettings
) -> Floats:
    """Ratio of the radial offset and the distance of a point near the surface, (n,)."""
    _, slopes = _profile(cone, heights)
    harmonics, derivatives = _harmonics(cone, azimuths)
    factor = 1.0 + harmonics @ cone.section
    steep = np.clip(slopes @ cone.profile * factor, -settings.max_slope, settings.max_slope)
    around = derivatives @ cone.section / np.maximum(factor, 0.1)
    return np.asarray(np.sqrt(1.0 + steep**2 + around**2))


def _jacobian(cone: ConeFit, points: Floats, settings: ConeFitSettings) -> Floats:
    """Derivatives (n, 4 + k) of distances by the axis's place and tilt, profile and section."""
    heights, azimuths, radii = _polar(cone, points)
    rows, slopes = _profile(cone, heights)
    harmonics, derivatives = _harmonics(cone, azimuths)
    base, factor = rows @ cone.profile, 1.0 + harmonics @ cone.section
    slope = slopes @ cone.profile * factor
    outward = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    onward = np.column_stack([-np.sin(azimuths), np.cos(azimuths)])
    # A sideways shift of the axis changes the azimuth of a point.
    swing = (base * (derivatives @ cone.section) / np.maximum(radii, 1e-6))[:, None] * onward
    place = -outward + swing
    tilt = heights[:, None] * place - (slope * radii)[:, None] * outward
    jacobian = np.hstack([place, tilt, -rows * factor[:, None], -base[:, None] * harmonics])
    return np.asarray(jacobian / _radial_stretch(cone, heights, azimuths, settings)[:, None])


def _roughness(cone: ConeFit) -> Floats:
    """Rows to be kept small: second differences of the profile, high harmonics of the section."""
    profile, section = len(cone.profile), len(cone.section)
    bends = np.diff(np.eye(profile), n=2, axis=0) if profile > 2 else np.zeros((0, profile))
    orders = np.tile(np.arange(1, section // 2 + 1), 2)
    waves = np.diag(orders**2 * float(np.mean(cone.profile)))
    rows = np.zeros((len(bends) + section, 4 + profile + section))
    rows[: len(bends), 4 : 4 + profile] = bends
    rows[len(bends) :, 4 + profile :] = waves
    return rows


def _damped_step(
    jacobian: Floats, offsets: Floats, cone: ConeFit, damping: float, settings: ConeFitSettings
) -> Floats:
    """The damped step (4 + k,) that reduces the offsets."""
    rough = settings.smoothing * math.sqrt(len(offsets)) * _roughness(cone)
    held = rough @ np.concatenate([np.zeros(4), cone.profile, cone.section])
    sizes = np.sqrt(np.mean(jacobian**2, axis=0)) + 1e-12
    damped = np.diag(math.sqrt(damping * len(offsets)) * sizes)
    rows = np.vstack([jacobian, rough, damped])
    targets = np.concatenate([-offsets, -held, np.zeros(len(damped))])
    return np.asarray(least_squares(rows / sizes, targets) / sizes)


def least_squares(rows: Floats, targets: Floats) -> Floats:
    """The solution (k,) of a system of full rank, by QR."""
    factor = np.asarray(np.linalg.qr(np.column_stack([rows, targets]), mode="r"))
    count = rows.shape[1]
    return np.asarray(np.linalg.solve(factor[:count, :count], factor[:count, count]))


def _stepped(cone: ConeFit, step: Floats) -> ConeFit:
    """The cone after a step."""
    axis = cone.axis + cone.across @ step[AXIS_TILT]
    axis /= np.linalg.norm(axis)
    first = cone.across[:, 0] - (cone.across[:, 0] @ axis) * axis
    first /= np.linalg.norm(first)
    profile = len(cone.profile)
    return cone._replace(
        point=cone.point + cone.across @ step[:2],
        axis=axis,
        across=np.column_stack([first, np.cross(axis, first)]),
        profile=cone.profile + step[4 : 4 + profile],
        section=cone.section + step[4 + profile :],
    )


def _with_errors(
    cone: ConeFit,
    points: Floats,
    numbers: Longs,
    offsets: Floats,
    sigma: float,
    settings: ConeFitSettings,
) -> ConeFit:
    """The cone with its residuals and the error of its axis; `numbers` (n,): touch of a point."""
    jacobian = _jacobian(cone, points, settings)
    counts = np.bincount(numbers)
    # The points of a touch share its error, so that all together have the weight of one.
    weighted = jacobian / (sigma * np.sqrt(counts[numbers]))[:, None]
    rough = settings.smoothing * math.sqrt(len(counts)) / sigma * _roughness(cone)
    sizes = np.sqrt(np.mean(weighted**2, axis=0)) + 1e-12
    inverse = np.linalg.pinv(np.vstack([weighted, rough]) / sizes)
    spread = np.sqrt((inverse**2).sum(axis=1)) / sizes
    by_touch = np.sqrt(np.bincount(numbers, offsets**2) / counts)
    return cone._replace(
        rms=float(np.sqrt(np.mean(offsets**2))),
        worst=float(by_touch.max()),
        axis_error=float(np.hypot(*spread[AXIS_TILT])),
    )


def side_points(
    cone: ConeFit,
    points: Floats,
    max_offset: float,
    rim: float,
    settings: ConeFitSettings = DEFAULT_CONE_FIT,
) -> Floats:
    """Those of points (n, 3) that are not on the rim of an end.

    On a rim they lie more than `max_offset` from the side, and less than `rim` from an end [m].
    """
    heights, _, _ = _polar(cone, points)
    at_end = np.minimum(heights - cone.low, cone.high - heights) < rim
    return points[~(at_end & (np.abs(_offsets(cone, points, settings)) > max_offset))]


def widest_gap(cone: ConeFit, touches: Sequence[Floats]) -> float:
    """The widest untouched angle about the axis [rad]."""
    azimuths = np.sort(_polar(cone, np.concatenate(touches))[1])
    return float(np.diff(np.append(azimuths, azimuths[0] + 2.0 * math.pi)).max())


class RoundEnd(NamedTuple):
    """A smooth end: its squared radius is a polynomial of the depth below its pole."""

    pole: float  # [m] height
    edge: float  # [m] height at which it meets the profile
    powers: Floats  # factors of the first, second and third power of the depth [m, 1, 1/m]
    rms: float  # [m] of the points' distances

    def radius(self, heights: Floats) -> Floats:
        """The radius (n,) between the edge and the pole [m]."""
        depths = np.abs(self.pole - heights)
        return np.sqrt(np.maximum(depths[:, None] ** np.arange(1, 4) @ self.powers, 0.0))


def fit_round_end(cone: ConeFit, points: Floats, pole: float, edge: float) -> RoundEnd:
    """A smooth end through points (n, 3) [m], from its pole to the edge where the profile ends.

    Where the section is not round, its mean radius is fitted.
    """
    heights, azimuths, radii = _polar(cone, points)
    radii = radii / _section_factor(cone, azimuths)
    between = np.linspace(edge, edge + 0.1 * (edge - pole), 10)
    heights = np.concatenate([heights, np.repeat(between, max(len(points) // 20, 1))])
    inner = cone.radius(between, np.zeros(10)) / _section_factor(cone, np.zeros(10))
    radii = np.concatenate([radii, np.repeat(inner, max(len(points) // 20, 1))])
    rows = np.abs(pole - heights)[:, None] ** np.arange(1, 4)
    # The error of a squared radius is that of the point, times the slope.
    weights = 1.0 / np.maximum(2.0 * radii + np.abs(pole - edge), 1e-6)
    powers = np.linalg.lstsq(rows * weights[:, None], radii**2 * weights, rcond=None)[0]
    residuals = (radii**2 - rows @ powers) * weights
    return RoundEnd(pole, edge, powers, float(np.sqrt(np.mean(residuals**2))))


def cone_mesh(
    cone: ConeFit,
    low: float | RoundEnd,
    high: float | RoundEnd,
    *,
    n_azimuths: int = 144,
    n_heights: int = 120,
    n_end_rings: int = 24,
) -> Mesh:
    """Its closed surface between two ends: each a height [m], where it is plane, or round.

    It has `n_azimuths` by `n_heights` vertices, and `n_end_rings` - 1 rings on each round end.
    """
    ends = [end.edge if isinstance(end, RoundEnd) else end for end in (low, high)]
    heights, zeros = np.linspace(ends[0], ends[1], n_heights), np.zeros(n_heights)
    azimuths = 2.0 * math.pi * np.arange(n_azimuths) / n_azimuths
    radii = cone.radius(heights, zeros) / _section_factor(cone, zeros)
    poles = [ends[0], ends[1]]
    for number, end in enumerate((low, high)):
        if not isinstance(end, RoundEnd):
            continue
        # Rings lie closer together towards the pole, where the surface turns into it.
        share = 1.0 - np.arange(1, n_end_rings) ** 2 / n_end_rings**2
        step = -1 if number == 0 else 1
        levels = end.pole + share[::step] * (end.edge - end.pole)
        heights = np.concatenate([levels, heights][::-step])
        radii = np.concatenate([end.radius(levels), radii][::-step])
        poles[number] = end.pole
    outward = np.cos(azimuths)[:, None] * cone.across[:, 0]
    outward = outward + np.sin(azimuths)[:, None] * cone.across[:, 1]
    rings = (cone.point + heights[:, None] * cone.axis)[:, None] + (
        np.outer(np.maximum(radii, 1e-6), _section_factor(cone, azimuths))[:, :, None] * outward
    )
    bottom, top = (cone.point + pole * cone.axis for pole in poles)
    return Mesh(*close_rings(bottom, rings, top))
