"""Whether a touched surface is smooth, or an edge or a corner, which have no curvature.

A jet is believed where it leaves no more than noise. Where it does leave more, a few flat faces are
tried in its place (Magnani and Boyd, *Convex piecewise-linear fitting*, 2009); single taxels that
have nothing to do with the surface are told from both by what a robust jet leaves over.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, scaled_mad
from palpate.core.touch.filters import neighbourhoods
from palpate.core.touch.jet import JetFit, fit_robust_jet, monomials
from palpate.core.touch.pad import Pad

SurfaceKind = Literal["smooth", "edge", "corner"]
# In pitches: what a quartic leaves over on a ball of eight pitches pressed deeply. Less than this
# beyond the noise needs no second look.
QUIET = 0.008
# In pitches: what a quartic leaves over on a ball of five. More than this beyond the noise is not
# smooth, whatever it is: a step has no faces that differ in slope.
UNEXPLAINED = 0.03
# In 1 / pitches: what curves within two pitches is an edge to this array, however well a polynomial
# passes through the few taxels that touch it.
SHARPEST = 0.5
PIECES_WIN = 0.5  # Flat faces that leave less than this share of what the jet does are there
# A third and fourth face are there if they leave less than this share of what two leave, flat or
# curved. Two curved ones are the rim of a cylinder: an edge.
THIRD_PAYS = 0.4
# Slope by which the faces of a corner must lean off any one line. The strip of a rounded edge lies
# on the line between the two others.
THREE_WAYS = 0.1
SURE = 4.0  # Standard deviations by which noise alone may lift the deviation of a fit
MOST_ROUNDS = 8  # Of giving the taxels to the faces and fitting the faces anew
THIN = 0.3  # In pitches: taxels that scatter less across a line do not move a face's plane
FAR = 5.0  # Robust deviations from the jet: noise on 256 taxels goes beyond once in 7000 frames
MOST = 3  # More than this are not outliers but something that the jet cannot follow
PULLED = 8  # Taxels that one outlier may pull the jet off from; beyond, no robust one is tried


def classify_surface(
    pad: Pad, height: Floats, touched: Bools, fit: JetFit, sharpness: float, noise: float
) -> SurfaceKind:
    """What the surface is that a jet was fitted to.

    `sharpness`: the larger size of a principal curvature, 1/m. `noise`: standard deviation of one
    taxel, m. The jet is believed where it leaves no more than noise; else flat faces are tried.
    """
    freedom = max(len(fit.misfit) - fit.jet.coefficients.size, 1)
    by_noise = noise * (1.0 + SURE / math.sqrt(2.0 * freedom))
    sharp = sharpness * pad.pitch > SHARPEST
    explained = math.hypot(by_noise, QUIET * pad.pitch)
    if not sharp and fit.deviation <= explained:
        return "smooth"
    unexplained = fit.deviation > math.hypot(by_noise, UNEXPLAINED * pad.pitch)
    cells = slopes_of_cells(pad, height, touched)
    two = fit_faces(pad, height, touched, cells, 2)
    if two is not None and two.deviation < min(explained, PIECES_WIN * fit.deviation):
        return "edge"  # two flat faces are all there is: the costlier models need not be tried
    three = fit_faces(pad, height, touched, cells, 3)
    if two is None or three is None:
        return "edge" if sharp or unexplained else "smooth"
    wins = min(two.deviation, three.deviation) < PIECES_WIN * fit.deviation
    if not (sharp or wins or unexplained):
        return "smooth"
    left = min(two.deviation, curved_faces_deviation(pad, height, touched, two))
    for more in (three, fit_faces(pad, height, touched, cells, 4)):
        if more is not None and more.deviation < THIRD_PAYS * left:
            return "corner" if _off_line(more) > THREE_WAYS else "edge"
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


def fit_faces(pad: Pad, height: Floats, touched: Bools, cells: Cells, count: int) -> Faces | None:
    """Two to four planes whose envelope is nearest to the touched taxels; None if cells are fewer.

    A convex body is the upper envelope of its faces over the pad, a hollow one the lower; the
    better beginning is taken. Planes are fitted to the taxels for which they stand out, by turns:
    Magnani and Boyd, *Convex piecewise-linear fitting*, 2009.
    """
    if len(cells.slopes) < count:
        return None
    x, y = (axis[touched] / pad.pitch for axis in pad.grid())
    z = height[touched] / pad.pitch
    chosen = _farthest_apart(cells.slopes, count)
    begun = np.column_stack([cells.slopes[chosen], cells.heights[chosen]])
    tops = begun[:, :1] * x + begun[:, 1:2] * y + begun[:, 2:]
    upper, lower = z - tops.max(axis=0), z - tops.min(axis=0)
    side = 1.0 if float(upper @ upper) <= float(lower @ lower) else -1.0
    planes, owner, misfit = _alternate(x, y, z, side * begun, side)
    spent = max(len(z) - 3 * count, 1)
    return Faces(planes[:, :2], owner, pad.pitch * math.sqrt(float(misfit @ misfit) / spent))


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
    x: Floats, y: Floats, z: Floats, planes: Floats, side: float
) -> tuple[Floats, Ints, Floats]:
    """Planes, owners and misfit of the upper envelope of ``side * z``; in the sense of z."""
    z, owner = side * z, None
    for _ in range(MOST_ROUNDS):
        over = planes[:, :1] * x + planes[:, 1:2] * y + planes[:, 2:]
        latest = over.argmax(axis=0)
        if owner is not None and np.array_equal(latest, owner):
            break
        owner = latest
        for face in range(len(planes)):
            own = owner == face
            if np.count_nonzero(own) > 3:
                planes[face] = _plane(x[own], y[own], z[own], planes[face])
    over = planes[:, :1] * x + planes[:, 1:2] * y + planes[:, 2:]
    owner = over.argmax(axis=0)
    return side * planes, owner, z - over.max(axis=0)


def _plane(x: Floats, y: Floats, z: Floats, before: Floats) -> Floats:
    """Slopes and height of the plane nearest to these points: QR of 1, x, y by Gram-Schmidt."""
    mean_x, mean_y, mean_z = float(x.mean()), float(y.mean()), float(z.mean())
    x, y, z = x - mean_x, y - mean_y, z - mean_z
    size = math.sqrt(float(x @ x))
    least = THIN * math.sqrt(len(x))
    if size < least:
        return before
    across = float(x @ y) / size
    y = y - x * (across / size)
    rest = math.sqrt(float(y @ y))
    if rest < least:
        return before
    slope_y = float(y @ z) / rest / rest
    slope_x = (float(x @ z) / size - across * slope_y) / size
    return np.array([slope_x, slope_y, mean_z - slope_x * mean_x - slope_y * mean_y])


def curved_faces_deviation(pad: Pad, height: Floats, touched: Bools, faces: Faces) -> float:
    """What is left over, m, if each face may be curved: a quadric on the taxels of each."""
    x, y = (axis[touched] / (0.5 * pad.pitch * pad.cols) for axis in pad.grid())
    z, squares, spent = height[touched], 0.0, 0
    for face in range(len(faces.slopes)):
        own = faces.owner == face
        if not own.any():
            continue
        terms = monomials(x[own], y[own], 2)
        found, _, rank, _ = np.linalg.lstsq(terms, z[own], rcond=1e-9)
        misfit = z[own] - terms @ found
        squares, spent = squares + float(misfit @ misfit), spent + int(rank)
    return math.sqrt(squares / max(len(z) - spent, 1))


def _off_line(faces: Faces) -> float:
    """How far the faces' slopes are from lying on a line."""
    centred = faces.slopes - faces.slopes.mean(axis=0)
    across = np.linalg.svd(centred, full_matrices=False)[2][1]
    return float(np.ptp(centred @ across))


class Faces(NamedTuple):
    """Planes of which the surface is the upper envelope, or the lower one in a hollow."""

    slopes: Floats  # Slopes of the faces, (faces, 2)
    owner: Ints  # Which face each touched taxel belongs to, in the order of the mask, (n,)
    deviation: float  # What the faces leave over, corrected for the numbers that were fitted, m


class Cells(NamedTuple):
    """Squares of four touched taxels."""

    slopes: Floats  # Mean slopes over each, (n, 2)
    heights: Floats  # Height of its plane over the pad's middle, in pitches, (n,)


def isolated_outliers(
    pad: Pad, height: Floats, touched: Bools, fit: JetFit, noise: float
) -> Bools | None:
    """Up to three touched taxels, no two of them neighbours, far off a jet: (rows, cols).

    None if there are none, or too many, or they lie together: a face, however small, is no outlier.
    `noise`: standard deviation of one taxel, m.
    """
    if not 0 < np.count_nonzero(_far(fit, noise)) <= MOST * PULLED:
        return None
    robust = fit_robust_jet(pad, height, touched, noise)
    if robust is None:
        return None
    far = _far(robust, noise)
    if not 0 < np.count_nonzero(far) <= MOST:
        return None
    found = np.zeros_like(touched)
    found[touched] = far
    crowd = neighbourhoods(found.astype(np.float64)).sum(axis=-1)
    return None if (crowd[found] > 1.0).any() else found


def _far(fit: JetFit, noise: float) -> Bools:
    off = np.abs(fit.misfit)
    far: Bools = off > FAR * max(scaled_mad(off), noise)
    return far
