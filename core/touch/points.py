"""Points of the surface under the touched taxels of one touch, and normals.

Next to an edge, which no smooth surface follows, a taxel has the slopes of the plane, through a
small square of taxels with it among them, that fits best (Nagao and Matsuyama, *Edge preserving
smoothing*, 1979, who take the square that varies least); where none fits, the taxel is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import Pose
from palpate.core.touch.jet import Jet
from palpate.core.touch.pad import Pad


@dataclass(frozen=True, slots=True)
class EdgeSlopeSettings:
    """Choice between normals of a plane beside an edge and of the smooth surface."""

    square_side: int = 3  # [taxels] of the squares to which planes are fitted
    edge_ratio: float = 3.0  # of the smooth surface's misfit to the plane's; above it is an edge
    min_misfit: float = 0.02  # fraction of the pitch by which the misfit must be larger besides
    # A taxel is left out if plane and smooth surface miss it by more than this many times the
    # median misfit of the planes.
    max_misfit_ratio: float = 6.0


class SurfacePoints(NamedTuple):
    """Surface points of one touch, outer frame."""

    points: Floats  # (n, 3) [m]
    normals: Floats  # outward unit normals, (n, 3)


def surface_points(
    pad: Pad,
    pose: Pose,
    surface: Floats,
    touched: Bools,
    jet: Jet | None,
    settings: EdgeSlopeSettings = EdgeSlopeSettings(),
) -> SurfacePoints:
    """Surface points under the touched taxels of one touch, and normals from the jet.

    `pose` is the pad's in the world, `surface` (rows, cols) lies over the plane of its face [m].
    Without a jet the normal is the pad's own. Next to an edge, which the jet does not follow,
    normals are those of planes beside it; a taxel without a reliable normal is left out.
    """
    x, y = pad.grid()
    slopes = np.zeros((2, *x.shape))
    if jet is not None:
        flat = x.ravel(), y.ravel()
        planes = _edge_slopes(
            surface, jet.height(*flat).reshape(x.shape), touched, pad.pitch, settings
        )
        slopes = np.where(planes.edge, planes.slopes, np.reshape(jet.slopes(*flat), slopes.shape))
        touched = touched & ~planes.unknown
    local = np.column_stack([x[touched], y[touched], surface[touched]])
    outward = np.column_stack([*slopes[:, touched], -np.ones(len(local))])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return SurfacePoints(pose.to_outer(local), outward @ pose.axes.T)


def _edge_slopes(
    surface: Floats, smooth: Floats, touched: Bools, pitch: float, settings: EdgeSlopeSettings
) -> EdgeSlopes:
    """Slopes next to edges of heights (rows, cols) [m] to which a smooth surface was fitted."""
    is_smooth = np.abs(surface - smooth)[touched].max(initial=0.0) <= settings.min_misfit * pitch
    if is_smooth or min(surface.shape) < settings.square_side:
        none = np.zeros(surface.shape, np.bool_)
        return EdgeSlopes(np.zeros((2, *surface.shape)), none, none)
    steps = pitch * (np.arange(settings.square_side) - settings.square_side // 2)
    squares = sliding_window_view(
        np.where(touched, surface, np.nan), (settings.square_side, settings.square_side)
    )
    missed = sliding_window_view(
        np.where(touched, surface - smooth, np.nan), (settings.square_side, settings.square_side)
    )
    spread = settings.square_side * float(steps @ steps)
    along_x = np.einsum("ijkl,l->ij", squares, steps) / spread
    along_y = np.einsum("ijkl,k->ij", squares, steps) / spread
    plane = along_y[..., None, None] * steps[:, None] + along_x[..., None, None] * steps
    residual = squares - squares.mean(axis=(2, 3), keepdims=True) - plane
    misfit = np.where(np.isnan(along_x), np.inf, np.sqrt(np.mean(residual**2, axis=(2, 3))))
    smooth_misfit = np.sqrt(np.mean(missed**2, axis=(2, 3)))
    best = _best_square(misfit, settings)
    chosen, smooth_chosen = misfit.ravel()[best], smooth_misfit.ravel()[best]
    has_plane = touched & np.isfinite(chosen)
    edge = has_plane & (smooth_chosen > settings.edge_ratio * chosen + settings.min_misfit * pitch)
    offset = np.abs(surface - smooth)
    reference = chosen[has_plane] if has_plane.any() else offset[touched]
    usual = float(np.median(reference)) if reference.size else 0.0
    residual = np.where(has_plane, np.fmin(chosen, smooth_chosen), offset)
    unknown = (
        touched
        & ~edge
        & (residual > settings.max_misfit_ratio * usual + settings.min_misfit * pitch)
    )
    return EdgeSlopes(np.stack([along_x.ravel()[best], along_y.ravel()[best]]), edge, unknown)


def _best_square(
    misfit: Floats, settings: EdgeSlopeSettings
) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """For each taxel, the index of the square with it whose misfit (a, b) is least."""
    rows, cols = misfit.shape
    around = np.pad(misfit, settings.square_side - 1, constant_values=np.inf)
    numbers = np.pad(np.arange(rows * cols).reshape(rows, cols), settings.square_side - 1)
    choices, numbers = (
        sliding_window_view(array, (settings.square_side, settings.square_side)).reshape(
            rows + settings.square_side - 1, cols + settings.square_side - 1, -1
        )
        for array in (around, numbers)
    )
    return np.take_along_axis(numbers, choices.argmin(axis=2)[..., None], axis=2)[..., 0]


class EdgeSlopes(NamedTuple):
    """Slopes of an array's taxels (rows, cols) from planes beside edges."""

    slopes: Floats  # along the columns and along the rows, (2, rows, cols)
    edge: Bools  # where these are better than the smooth surface's
    unknown: Bools  # where neither is reliable
