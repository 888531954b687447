"""Whether a touched surface is smooth, or an edge or a corner, which have no curvature.

A surface is smooth where a jet leaves no more than noise. Where it leaves more, a few flat faces
are tried in its place (Magnani and Boyd, *Convex piecewise-linear fitting*, 2009); single taxels
off the surface are detected by the residuals of a robust jet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, scaled_mad
from palpate.core.touch.filters import neighbourhoods
from palpate.core.touch.jet import JetFit, fit_robust_jet, monomials
from palpate.core.touch.pad import Pad

SurfaceKind = Literal["smooth", "edge", "corner"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceKindSettings:
    """When a touched surface is smooth, an edge or a corner."""

    # Misfit of the jet beyond noise [pitches]. Below the first the surface is smooth; above the
    # second it is an edge or a corner even if no flat faces fit, as on a step. A ball of eight
    # pitches, pressed deeply, leaves as much as the first, one of five as much as the second.
    max_smooth_misfit: float = 0.008
    min_edge_misfit: float = 0.03
    noise_sigmas: float = 4.0  # by which noise alone may raise the deviation of a fit
    # A surface that curves within two pitches is an edge to this array, however well a polynomial
    # passes through the few taxels that touch it.
    max_curvature: float = 0.5  # [1 / pitches]
    max_edge_ratio: float = 0.5  # deviation of flat faces over the jet's, below which they are real
    # Deviation of three or four faces over that of two, flat or curved, below which they are real.
    # Two curved ones are the rim of a cylinder: an edge.
    max_corner_ratio: float = 0.4
    # Slope by which a corner's faces deviate from a common line, at least. The strip of a rounded
    # edge lies on the line between the two faces.
    min_corner_slope: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceFitSettings:
    """Fit of planes to the touched taxels."""

    max_rounds: int = 8  # of assigning taxels to planes and fitting the planes
    min_spread: float = 0.3  # [pitches] root mean square width of taxels that determine a plane


@dataclass(frozen=True, slots=True, kw_only=True)
class IsolatedSettings:
    """Detection of isolated taxels off a jet."""

    outlier_sigmas: float = 5.0  # robust; noise on 256 taxels exceeds it once in 7000 frames
    max_outliers: int = 3  # more are a shape that the jet cannot follow
    max_affected: int = 8  # taxels that one outlier pulls a plain jet off; more are a shape


def classify_surface(
    pad: Pad,
    height: Floats,
    touched: Bools,
    fit: JetFit,
    curvature: float,
    noise: float,
    settings: SurfaceKindSettings = SurfaceKindSettings(),
) -> SurfaceKind:
    """Kind of the surface to which a jet was fitted.

    `curvature`: the larger absolute principal curvature [1/m]. `noise`: standard deviation of one
    taxel [m]. The surface is smooth where the jet leaves no more than noise; else flat faces are
    tried.
    """
    freedom = max(len(fit.misfit) - fit.jet.coefficients.size, 1)
    by_noise = noise * (1.0 + settings.noise_sigmas / math.sqrt(2.0 * freedom))
    sharp = curvature * pad.pitch > settings.max_curvature
    explained = math.hypot(by_noise, settings.max_smooth_misfit * pad.pitch)
    if not sharp and fit.deviation <= explained:
        return "smooth"
    unexplained = fit.deviation > math.hypot(by_noise, settings.min_edge_misfit * pad.pitch)
    cells = slopes_of_cells(pad, height, touched)
    two = fit_faces(pad, height, touched, cells, 2)
    if two is not None and two.deviation < min(explained, settings.max_edge_ratio * fit.deviation):
        return "edge"  # two flat faces explain all: no costlier model is tried
    three = fit_faces(pad, height, touched, cells, 3)
    if two is None or three is None:
        return "edge" if sharp or unexplained else "smooth"
    wins = min(two.deviation, three.deviation) < settings.max_edge_ratio * fit.deviation
    if not (sharp or wins or unexplained):
        return "smooth"
    of_two = min(two.deviation, curved_faces_deviation(pad, height, touched, two))
    for more in (three, fit_faces(pad, height, touched, cells, 4)):
        if more is not None and more.deviation < settings.max_corner_ratio * of_two:
            return "corner" if _off_line(more) > settings.min_corner_slope else "edge"
    return "edge"


def slopes_of_cells(pad: Pad, height: Floats, touched: Bools) -> Cells:
    """Slopes over all squares of four touched taxels."""
    whole = touched[:-1, :-1] & touched[1:, :-1] & touched[:-1, 1:] & touched[1:, 1:]
    a, b, c, d = (
        part[whole] / pad.pitch
        for part in (height[:-1, :-1], height[:-1, 1:], height[1:, :-1], height[1:, 1:])
    )
    slopes = np.column_stack([0.5 * (b + d - a - c), 0.5 * (c + d - a - b)])
    x, y = (axis[:-1, :-1][whole] / pad.pitch + 0.5 for axis in pad.grid())
    return Cells(slopes, 0.25 * (a + b + c + d) - slopes[:, 0] * x - slopes[:, 1] * y)


def fit_faces(
    pad: Pad,
    height: Floats,
    touched: Bools,
    cells: Cells,
    count: int,
    settings: FaceFitSettings = FaceFitSettings(),
) -> Faces | None:
    """Two to four planes whose envelope is nearest to the touched taxels; None if cells are fewer.

    A convex body is the upper envelope of its faces over the pad, a hollow one the lower; the
    better initial guess decides. Planes are fitted to the taxels where they form the envelope, and
    these are assigned anew, in rounds: Magnani and Boyd, *Convex piecewise-linear fitting*, 2009.
    """
    if len(cells.slopes) < count:
        return None
    x, y = (axis[touched] / pad.pitch for axis in pad.grid())
    z = height[touched] / pad.pitch
    chosen = _farthest_apart(cells.slopes, count)
    first = np.column_stack([cells.slopes[chosen], cells.heights[chosen]])
    tops = first[:, :1] * x + first[:, 1:2] * y + first[:, 2:]
    upper, lower = z - tops.max(axis=0), z - tops.min(axis=0)
    side = 1.0 if float(upper @ upper) <= float(lower @ lower) else -1.0
    planes, owner, misfit = _alternate(x, y, z, side * first, side, settings)
    freedom = max(len(z) - 3 * count, 1)
    return Faces(planes[:, :2], owner, pad.pitch * math.sqrt(float(misfit @ misfit) / freedom))


def _farthest_apart(slopes: Floats, count: int) -> list[int]:
    """Cells whose slopes lie farthest apart: two along their longest axis, one or two off it."""
    centred = slopes - slopes.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][0]
    along = centred @ axis
    first, last = int(along.argmin()), int(along.argmax())
    if count == 2:
        return [first, last]
    dx, dy = (slopes[last] - slopes[first]).tolist()
    off = (slopes - slopes[first]) @ np.array([-dy, dx])
    if count == 3:
        return [first, last, int(np.abs(off).argmax())]
    return [first, last, int(off.argmax()), int(off.argmin())]


def _alternate(
    x: Floats, y: Floats, z: Floats, planes: Floats, side: float, settings: FaceFitSettings
) -> tuple[Floats, Ints, Floats]:
    """Planes and misfit of the upper envelope of ``side * z``, and the plane of each taxel."""
    z, owner = side * z, None
    for _ in range(settings.max_rounds):
        over = planes[:, :1] * x + planes[:, 1:2] * y + planes[:, 2:]
        latest = over.argmax(axis=0)
        if owner is not None and np.array_equal(latest, owner):
            break
        owner = latest
        for face in range(len(planes)):
            own = owner == face
            if np.count_nonzero(own) > 3:
                plane = _plane(x[own], y[own], z[own], settings.min_spread)
                planes[face] = planes[face] if plane is None else plane
    over = planes[:, :1] * x + planes[:, 1:2] * y + planes[:, 2:]
    owner = over.argmax(axis=0)
    return side * planes, owner, z - over.max(axis=0)


def _plane(x: Floats, y: Floats, z: Floats, min_spread: float) -> Floats | None:
    """Slopes and height of the plane nearest to points; None if they lie on a line.

    By QR of 1, x, y (Gram-Schmidt).
    """
    mean_x, mean_y, mean_z = float(x.mean()), float(y.mean()), float(z.mean())
    x, y, z = x - mean_x, y - mean_y, z - mean_z
    size = math.sqrt(float(x @ x))
    min_size = min_spread * math.sqrt(len(x))
    if size < min_size:
        return None
    across = float(x @ y) / size
    y = y - x * (across / size)
    rest = math.sqrt(float(y @ y))
    if rest < min_size:
        return None
    slope_y = float(y @ z) / rest / rest
    slope_x = (float(x @ z) / size - across * slope_y) / size
    return np.array([slope_x, slope_y, mean_z - slope_x * mean_x - slope_y * mean_y])


def curved_faces_deviation(pad: Pad, height: Floats, touched: Bools, faces: Faces) -> float:
    """Deviation [m] of a quadric on the taxels of each face."""
    x, y = (axis[touched] / (0.5 * pad.pitch * pad.cols) for axis in pad.grid())
    z, squares, n_fitted = height[touched], 0.0, 0
    for face in range(len(faces.slopes)):
        own = faces.owner == face
        if not own.any():
            continue
        terms = monomials(x[own], y[own], 2)
        coefficients, _, rank, _ = np.linalg.lstsq(terms, z[own], rcond=1e-9)
        misfit = z[own] - terms @ coefficients
        squares, n_fitted = squares + float(misfit @ misfit), n_fitted + int(rank)
    return math.sqrt(squares / max(len(z) - n_fitted, 1))


def _off_line(faces: Faces) -> float:
    """Range of the faces' slopes across the line nearest to them."""
    centred = faces.slopes - faces.slopes.mean(axis=0)
    across = np.linalg.svd(centred, full_matrices=False)[2][1]
    return float(np.ptp(centred @ across))


class Faces(NamedTuple):
    """Planes of which the surface is the upper envelope, or the lower one in a hollow."""

    slopes: Floats  # of the faces, (faces, 2)
    owner: Ints  # face of each touched taxel, in the order of the mask, (n,)
    deviation: float  # [m] of the taxels, by degrees of freedom


class Cells(NamedTuple):
    """Squares of four touched taxels."""

    slopes: Floats  # mean slopes of each, (n, 2)
    heights: Floats  # [pitches] of its plane over the pad's middle, (n,)


def isolated_outliers(
    pad: Pad,
    height: Floats,
    touched: Bools,
    fit: JetFit,
    noise: float,
    settings: IsolatedSettings = IsolatedSettings(),
) -> Bools | None:
    """Up to three touched taxels far off a jet, no two of them neighbours, (rows, cols).

    None if there are none, or more, or two are neighbours: a face, however small, is no outlier.
    `noise`: standard deviation of one taxel [m].
    """
    n_missed = np.count_nonzero(_outlying(fit, noise, settings))
    if not 0 < n_missed <= settings.max_outliers * settings.max_affected:
        return None
    robust = fit_robust_jet(pad, height, touched, noise)
    if robust is None:
        return None
    outlying = _outlying(robust, noise, settings)
    if not 0 < np.count_nonzero(outlying) <= settings.max_outliers:
        return None
    outliers = np.zeros_like(touched)
    outliers[touched] = outlying
    n_around = neighbourhoods(outliers.astype(np.float64)).sum(axis=-1)
    return None if (n_around[outliers] > 1.0).any() else outliers


def _outlying(fit: JetFit, noise: float, settings: IsolatedSettings) -> Bools:
    offset = np.abs(fit.misfit)
    result: Bools = offset > settings.outlier_sigmas * max(scaled_mad(offset), noise)
    return result
