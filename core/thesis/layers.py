"""One layer of the deformed lattice, of shell and core; closed curves and point inversion for it.

Fung, 1999, 4.4.3, corrected and as printed. As printed (buildgrid.m and isint.m) the search for the
core's ellipse takes the edges of a polygon for infinite lines, uses the first few only, loses a
sign, and moves on to places that it has not tested. The curves of 4.4.2 have clamped knots and
pseudo-vertices: their equations contradict each other, so that they never close. Inversion, 4.2.2,
is Newton's method on the derivative of the distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import splines
from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry import inscribed_circle, turn_between, winding_number

N_PSEUDO_VERTICES = splines.CUBIC  # of a closed curve


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerSettings:
    """How a layer's core is placed in its shell."""

    core_margin: float = 0.95  # fraction of the largest core that fits; from the thesis's program
    min_core_scale: float = 0.25  # fraction of the box; below it a better middle is looked for
    min_aspect: float = 1e-9  # shorter side of the box over the longer one; below: no core


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedCurveSettings:
    """When the iteration of (4.27) to (4.40) ends, and how it is damped."""

    max_gap: float = 0.02  # fraction of the mean width, between vertices and pseudo-vertices
    max_steps: int = 300
    damping: float = 0.5  # factor of the parameters' steps; in the program, not in (4.40)
    svd_cutoff: float = 1e-10  # of the pseudo-inverse, fraction of the largest singular value


@dataclass(frozen=True, slots=True, kw_only=True)
class InversionSettings:
    """When the inversion of points, (4.8) to (4.16), ends."""

    max_steps: int = 50
    max_distance: float = 1e-6  # fraction of the volume's size; in (4.14), (4.16) it is in metres
    max_cosine: float = 1e-6  # (4.15), between offset and tangents; less is a right angle


class ThesisLayer(NamedTuple):
    """Control points of one layer."""

    control: Floats  # (l, m, 2), along s and t
    core_scale: float  # sides of the core over those of the box around the shell; 0: no room
    moved: bool  # whether the core is off the middle of that box, which has little room
    gap: float  # between the ends of the shell's curve, over its mean width


def make_layer(
    points: Floats, sides: tuple[int, int], settings: LayerSettings = LayerSettings()
) -> ThesisLayer:
    """A layer whose rim is the control polygon of a contour.

    `points` (k, 2): of the contour, counter-clockwise, starting where all layers start. `sides`:
    control points along s and t, at least 4. The polygon is that of a periodic spline, which
    closes. The core is the largest rectangle inside it with the proportions of the box around it;
    as printed it is the box around the largest such ellipse, whose corners stick out.
    """
    polygon = _polygon(points, 2 * (sides[0] + sides[1]) - 4)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    scale, moved = 0.0, False
    if (half > settings.min_aspect * half.max()).all():
        scale = rectangle_scale(polygon, middle, half)
        if scale < settings.min_core_scale:
            deepest = inscribed_circle(polygon).middle
            deepest_scale = rectangle_scale(polygon, deepest, half)
            if deepest_scale > scale:
                middle, scale, moved = deepest, deepest_scale, True
    control = np.empty((*sides, 2))
    cells = rim_cells(sides)
    phase = nearest_phase(polygon, 0.5 * (low + high), np.array([low[0], high[1]]))
    control[cells[:, 0], cells[:, 1]] = np.roll(polygon, -phase, axis=0)
    reach = settings.core_margin * scale * half
    x, y = (np.linspace(-1.0, 1.0, side - 2) for side in sides)
    control[1:-1, 1:-1, 0] = middle[0] + reach[0] * x[:, None]
    control[1:-1, 1:-1, 1] = middle[1] + reach[1] * y
    return ThesisLayer(control, scale, moved, 0.0)


def _polygon(points: Floats, count: int) -> Floats:
    """Control polygon (count, 2) of the periodic cubic nearest to points by (4.27) to (4.30)."""
    different = points[(points != np.roll(points, 1, axis=0)).any(axis=1)]
    if len(different) < 2:
        return np.repeat(points[:1], count, axis=0)
    places, least = (
        splines.curve_parameters(different, "chord"),
        splines.DEFAULT_CURVE_FIT.min_smoothing,
    )
    return splines.fit_closed_least_squares(different, places, count, least).control


def rectangle_scale(polygon: Floats, middle: Floats, half_sides: Floats) -> float:
    """The largest factor of a rectangle's half sides for which it lies inside a polygon, or 0.

    In the plane in which the rectangle is the square from -1 to 1 this is the distance of the
    middle from the edges, by the larger coordinate: least at an end, where one is 0, or at a tie.
    """
    starts = (polygon - middle) / half_sides
    if winding_number(starts, np.zeros((1, 2)))[0] == 0:
        return 0.0
    along = np.roll(starts, -1, axis=0) - starts
    (x, y), (dx, dy) = starts.T, along.T
    needed, rate = np.stack([-x, -y, y - x, -x - y]), np.stack([dx, dy, dx - dy, dx + dy])
    shares = np.divide(needed, rate, out=np.zeros_like(needed), where=rate != 0.0)
    places = starts + np.clip(shares, 0.0, 1.0)[:, :, None] * along
    return float(np.abs(np.concatenate([places, starts[None]])).max(axis=2).min())


def rim_cells(sides: tuple[int, int]) -> Ints:
    """Places (n, 2) around a layer's rim, counter-clockwise from its north-west corner."""
    last_s, last_t = sides[0] - 1, sides[1] - 1
    s, t = np.arange(last_s), np.arange(last_t)
    return np.concatenate(
        [
            np.column_stack([0 * t, last_t - t]),
            np.column_stack([s, 0 * s]),
            np.column_stack([0 * t + last_s, t]),
            np.column_stack([last_s - s, 0 * s + last_t]),
        ]
    ).astype(np.int32)


def make_program_layer(
    points: Floats, sides: tuple[int, int], settings: LayerSettings = LayerSettings()
) -> ThesisLayer:
    """A layer from the points of a contour, as the thesis's program builds it.

    `points` (k, 2): around the contour, each once; their start and direction matter. `sides`:
    control points along s and t, at least 4. The shell's polygon is that of a clamped spline whose
    constraints contradict each other; it is laid along the rim clockwise, so that a
    counter-clockwise contour mirrors the lattice. The quadrant of the polygon's first vertex about
    the origin decides how the core is turned. The core may stick out of the polygon.
    """
    along_s, along_t = sides
    polygon, gap = _program_polygon(points, 2 * (along_s + along_t) - 4)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    scale = searched_scale(polygon, middle, half, along_t) if (half > 0.0).all() else 0.0
    reach = settings.core_margin * scale * half
    x, y = (np.linspace(-r, r, side - 2) for r, side in zip(reach, sides[::-1], strict=True))
    grid = np.stack(np.meshgrid(middle[0] + x, middle[1] + y), axis=-1)
    first = nearest_phase(polygon, middle, np.array([low[0], high[1]]))
    west = bool(abs(np.arctan2(polygon[0, 1], polygon[0, 0])) > 0.5 * np.pi)
    flat = np.empty((along_s * along_t, 2))
    flat[_rim(along_s, along_t)] = np.roll(polygon, -first, axis=0)
    flat[_core(along_s, along_t, west)] = grid.transpose(1, 0, 2).reshape(-1, 2)
    return ThesisLayer(flat.reshape(along_t, along_s, 2).transpose(1, 0, 2), scale, False, gap)


def _program_polygon(points: Floats, count: int) -> tuple[Floats, float]:
    """Control polygon (count, 2) by 4.4.2, and the gap of its curve over its mean width."""
    width = float(np.ptp(points, axis=0).mean())
    if width == 0.0:
        return np.repeat(points[:1], count, axis=0), 0.0
    fit = fit_closed_thesis(points, splines.curve_parameters(points, "chord"), count)
    first, last = splines.closed_curve_points(fit.control, fit.knots, np.array([0.0, 1.0]))
    return fit.control, float(np.linalg.norm(last - first)) / width


def searched_scale(
    polygon: Floats,
    middle: Floats,
    semi_axes: Floats,
    edges: int,
    max_steps: int = 50,
    tolerance: float = 1e-6,
) -> float:
    """Factor of an ellipse's semi-axes that the thesis's program finds, from `tolerance` to 1.

    Table 4.2 asks at each step whether two ellipses meet one of the first `edges`. An ellipse that
    meets a line does so at all larger scales, so that one scale for each edge answers this.
    """
    least_met = _least_met(polygon, middle, semi_axes, edges)
    fibonacci = [1.0, 1.0]
    while len(fibonacci) < max_steps:
        fibonacci.append(fibonacci[-1] + fibonacci[-2])
    low, high = tolerance, 1.0
    for count in range(1, max_steps - 1):
        if high - low <= tolerance:
            break
        meets = least_met <= low, least_met <= high
        last = fibonacci[max_steps - count]
        first = low + fibonacci[max_steps - count - 2] / last * (high - low)
        second = low + fibonacci[max_steps - count - 1] / last * (high - low)
        if all(meets):
            high = first
        elif meets[1]:
            low, high = first, second
        else:
            low = second
    return 0.5 * (low + high)


def _least_met(polygon: Floats, middle: Floats, semi_axes: Floats, edges: int) -> float:
    """Least scale at which the ellipse meets one of the lines that the program takes for edges."""
    x, y = polygon[:edges].T
    dx, dy = (np.roll(polygon, -1, axis=0) - polygon)[:edges].T
    # The line is dy x - dx y + c = 0; the program lacks the minus sign.
    constant = dy * middle[0] + dx * middle[1] + (y * dx - x * dy)
    width = np.hypot(dy * semi_axes[0], dx * semi_axes[1])
    scales = np.divide(np.abs(constant), width, out=np.full(len(x), np.inf), where=width > 0.0)
    return float(scales.min())


def nearest_phase(polygon: Floats, middle: Floats, corner: Floats) -> int:
    """Number of the vertex of a polygon (n, 2) that is nearest to the direction of a corner."""
    turns = turn_between(polygon - middle, np.broadcast_to(corner - middle, polygon.shape))
    return int(np.abs(turns).argmin())


def _rim(along_s: int, along_t: int) -> Ints:
    """Numbers of the rim's places, s counting first, starting at s = t = 0: indexb."""
    last = along_s * along_t - 1
    return np.concatenate(
        [
            np.arange(0, last, along_s),
            np.arange(last - along_s + 2, last + 1),
            np.arange(last - along_s, along_s - 2, -along_s),
            np.arange(along_s - 2, 0, -1),
        ]
    ).astype(np.int32)


def _core(along_s: int, along_t: int, west: bool) -> Ints:
    """Numbers of the inner places, in the order in which the program fills them: indexg."""
    inner = np.arange(along_s * along_t).reshape(along_t, along_s)[1:-1, 1:-1]
    return np.rot90(inner.T if west else inner).ravel(order="F").astype(np.int32)


def fit_closed_curve_thesis(points: ArrayLike, count: int = 16) -> splines.ClosedCurve:
    """Closed cubic of `count` vertices, at least 4, near points (m, 2) or (m, 3) [m].

    16 vertices lie around a layer of 5 by 5. The points are ordered, and their parameters set, as
    by `fit_closed_curve`. Raises ValueError if they have another shape or fewer than 2 differ.
    """
    ring = splines.order_closed_points(np.asarray(points, np.float64))
    if len(ring.points) < 2:
        raise ValueError(f"points must lie in at least 2 places, got {len(ring.points)}")
    turns = splines.curve_parameters(ring.points, "auto")
    fit = fit_closed_thesis(ring.points, turns, count)
    return splines.closed_curve_of(ring, fit, splines.local_noise(ring.points, turns))


def fit_closed_thesis(
    points: Floats,
    parameters: Floats,
    count: int,
    settings: ClosedCurveSettings = ClosedCurveSettings(),
) -> splines.CurveFit:
    """Closed cubic by (4.27) to (4.40), of `count` vertices, at least 4; see the module.

    `points` (m, d): around the curve; the first is repeated at the end. `parameters` (m,): of the
    points, increasing from 0 [turns]. `count`: vertices, without the pseudo-vertices.
    """
    basis = splines.clamped_basis(count + N_PSEUDO_VERTICES)
    closed = np.vstack([points, points[:1]])
    parameters = np.append(parameters, 1.0)
    max_gap = settings.max_gap * float(np.ptp(points, axis=0).mean())
    targets = np.vstack([closed, np.zeros((N_PSEUDO_VERTICES + 2, points.shape[1]))])
    for _ in range(settings.max_steps):
        rows = basis.matrix(parameters).toarray()
        system = np.vstack([rows, _closing_rows(basis, count, parameters[[0, -1]])])
        vertices = np.linalg.pinv(system, rcond=settings.svd_cutoff) @ targets
        if float(np.linalg.norm(vertices[:N_PSEUDO_VERTICES] - vertices[count:])) < max_gap:
            break
        around = np.vstack([vertices[:count], vertices[:N_PSEUDO_VERTICES]])
        slopes = basis.matrix(parameters, 1) @ around
        step = ((closed - rows @ around) * slopes).sum(axis=1)
        step /= np.maximum((slopes * slopes).sum(axis=1), 1e-300)
        parameters = np.maximum.accumulate(np.clip(parameters + settings.damping * step, 0.0, 1.0))
    return splines.CurveFit(
        control=vertices[:count],
        knots=basis.knots,
        parameters=parameters[:-1],
        condition=float(np.linalg.cond(system)),
        effective=float(count),
        smoothing=0.0,
    )


def _closing_rows(basis: splines.Basis, count: int, ends: Floats) -> Floats:
    """Rows (5, count + 3) of (4.37): equal vertices, and equal derivatives at both ends."""
    same = np.eye(N_PSEUDO_VERTICES, basis.count) - np.eye(N_PSEUDO_VERTICES, basis.count, count)
    first, second = (basis.matrix(ends, order).toarray() for order in (1, 2))
    return np.vstack([same, first[0] - first[1], second[0] - second[1]])


def invert_thesis(
    volume: splines.SplineVolume,
    points: Floats,
    settings: InversionSettings = InversionSettings(),
) -> splines.Inversion:
    """Parameters of points (n, 3) by (4.8) to (4.16), all points in parallel.

    The iteration starts at the affine guess. It ends at the first of coincidence, zero cosine and
    insignificant change; the text demands the first two together in one sentence, and any of the
    three in the next. A singular matrix (4.9) ends the iteration without convergence.
    """
    points = finite_array("points", points, (None, 3))
    matrix = splines.affine_fit(volume)
    size = float(np.ptp(volume.control.reshape(-1, 3), axis=0).max())
    close = max(settings.max_distance * size, splines.least_residual(volume))
    parameters = np.clip(points @ matrix[:3] + matrix[3], 0.0, 1.0)
    steps = np.zeros(len(points), np.int32)
    active = np.arange(len(points))  # points whose iteration has not ended
    for _ in range(settings.max_steps):
        reached, slopes, bends = volume.second(parameters[active])
        offset = reached - points[active]
        open_ = ~_is_inverted(slopes, offset, close, settings.max_cosine)
        active, slopes, bends, offset = active[open_], slopes[open_], bends[open_], offset[open_]
        if not len(active):
            break
        change, regular = _newton_step(slopes, bends, offset)
        moved = np.clip(parameters[active] + change, 0.0, 1.0)
        steps[active] += 1
        moves = np.linalg.norm((slopes @ change[:, :, None])[:, :, 0], axis=1) > close
        parameters[active[regular]] = moved[regular]
        active = active[regular & moves]
    reached, slopes = volume.first(parameters)
    residual = np.linalg.norm(reached - points, axis=1)
    folded = splines.is_folded(volume, slopes)
    return splines.Inversion(parameters, residual, residual <= close, folded, steps)


def _is_inverted(slopes: Floats, offset: Floats, close: float, max_cosine: float) -> Bools:
    """Point coincidence (4.14), or zero cosine (4.15) multiplied out, which is 0/0 at the point."""
    distance = np.linalg.norm(offset, axis=1)
    product = np.abs(np.einsum("nij,ni->nj", slopes, offset))
    square = product <= max_cosine * np.linalg.norm(slopes, axis=1) * distance[:, None]
    return np.asarray((distance <= close) | square.all(axis=1))


def _newton_step(slopes: Floats, bends: Floats, offset: Floats) -> tuple[Floats, Bools]:
    """Solution (n, 3) of (4.12), and whether its matrix (4.9) is regular, (n,)."""
    matrix = slopes.transpose(0, 2, 1) @ slopes + np.einsum("ni,nijk->njk", offset, bends)
    right = -np.einsum("nij,ni->nj", slopes, offset)
    size = np.abs(matrix).max(axis=(1, 2))
    scaled = matrix / np.where(size > 0.0, size, 1.0)[:, None, None]
    regular = np.abs(np.linalg.det(scaled)) > np.finfo(float).eps
    scaled[~regular] = np.eye(3)
    change = np.linalg.solve(scaled, right[:, :, None])[:, :, 0]
    return change / np.where(size > 0.0, size, 1.0)[:, None], regular
