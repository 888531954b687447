"""One layer as the thesis's program makes it: buildgrid.m, kept as printed for comparison."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.thesis.layer import MARGIN, Layer, nearest_phase
from palpate.core.rebuild.thesis.program_search import searched_scale
from palpate.core.splines.closed_curve_thesis import fit_closed_thesis
from palpate.core.splines.curve_fit import closed_places
from palpate.core.splines.curve_parameters import curve_parameters


def make_program_layer(points: Floats, sides: tuple[int, int]) -> Layer:
    """A layer from the points of a contour as they are given.

    Parameters
    ----------
    points : (k, 2) array
        Around the contour, each once; their beginning and direction matter.
    sides : two integers
        Control points along s and t, at least 4.

    Notes
    -----
    The shell's polygon is that of a clamped spline whose constraints contradict each other; it
    is laid along the rim clockwise, so that a counter-clockwise contour mirrors the lattice.
    The core is turned one way or the other by the quadrant of the polygon's first vertex about
    the origin, and may stand out of the polygon.
    """
    along_s, along_t = sides
    polygon, gap = _polygon(points, 2 * (along_s + along_t) - 4)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    scale = searched_scale(polygon, middle, half, along_t) if (half > 0.0).all() else 0.0
    reach = MARGIN * scale * half
    x, y = (np.linspace(-r, r, side - 2) for r, side in zip(reach, sides[::-1], strict=True))
    grid = np.stack(np.meshgrid(middle[0] + x, middle[1] + y), axis=-1)
    first = nearest_phase(polygon, middle, np.array([low[0], high[1]]))
    west = bool(abs(np.arctan2(polygon[0, 1], polygon[0, 0])) > 0.5 * np.pi)
    flat = np.empty((along_s * along_t, 2))
    flat[_rim(along_s, along_t)] = np.roll(polygon, -first, axis=0)
    flat[_core(along_s, along_t, west)] = grid.transpose(1, 0, 2).reshape(-1, 2)
    return Layer(flat.reshape(along_t, along_s, 2).transpose(1, 0, 2), scale, False, gap)


def _polygon(points: Floats, count: int) -> tuple[Floats, float]:
    """Control polygon (count, 2) by 4.4.2, and how far open its curve is over its mean width."""
    width = float(np.ptp(points, axis=0).mean())
    if width == 0.0:
        return np.repeat(points[:1], count, axis=0), 0.0
    fit = fit_closed_thesis(points, curve_parameters(points, "chord"), count)
    first, last = closed_places(fit.control, fit.knots, np.array([0.0, 1.0]))
    return fit.control, float(np.linalg.norm(last - first)) / width


def _rim(along_s: int, along_t: int) -> Ints:
    """Numbers, s counting first, of the rim's places from s = t = 0 on: indexb."""
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
