"""A Gaussian-process implicit surface: 0 on the object, negative inside, about 1 m a metre.

Williams and Fitzgibbon, *Gaussian process implicit surfaces*, 2006; with normals as observed
gradients, Dragiev, Toussaint and Gienger, *Gaussian process implicit surfaces for shape estimation
and grasping*, 2011. Before anything is felt it is a ball.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from gp_factor import Factor
from gp_kernels import Kernel, block
from scipy.ndimage import map_coordinates, spline_filter

from palpate.core.arrays import Floats
from palpate.core.shapes.isosurface import isosurface
from palpate.core.shapes.protocol import Mesh

AT_ONCE = 4096
"""Places that are evaluated together."""
UNKNOWN = 1e3
"""Standard deviation of a gradient that nobody measured."""
CELL = 2e-3
"""Of the grid whose cubic interpolation the mesh is made of, m: far below the kernels' lengths."""
LEVEL = 7
"""Of the mesh: cells of 0.8 mm, with their corners on the surface."""
STEP = 1e-3
"""Of a way along a cell's edge, over which the slope is taken."""


class Ball(NamedTuple):
    """What is expected before anything is felt."""

    centre: Floats
    """(3,), m."""
    radius: float
    """m."""

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and gradients (n, 3) at places (n, 3)."""
        away = places - self.centre
        value = (np.einsum("ni,ni->n", away, away) - self.radius**2) / (2.0 * self.radius)
        return value, away / self.radius


class Observed(NamedTuple):
    """What was found out, at places (n, 3)."""

    places: Floats
    """m."""
    values: Floats
    """(n,), m."""
    value_errors: Floats
    """Standard deviations of each by itself, (n,), m."""
    shared: float
    """Standard deviation of what all are off by together, m."""
    gradients: Floats
    """(n, 3)."""
    gradient_errors: Floats
    """Standard deviations, (n,)."""


class Implicit:
    """A surface and what it knows of itself.

    Parameters
    ----------
    kernel : Kernel
        How alike places are.
    ball : Ball
        What is expected.
    """

    def __init__(self, kernel: Kernel, ball: Ball):
        self._kernel, self._ball = kernel, ball
        self._places, self._rest = np.zeros((0, 3)), np.zeros((0, 4))
        self._whole, self._bare = Factor(), Factor()
        self._weights = np.zeros((0, 4))

    def observe(self, seen: Observed) -> None:
        """Take in what was found out."""
        value, gradient = self._ball.at(seen.places)
        spread = np.column_stack([seen.value_errors, *3 * [seen.gradient_errors]])
        for factor, gradients in ((self._whole, True), (self._bare, False)):
            across = block(self._kernel, seen.places, self._places, gradients)
            own = block(self._kernel, seen.places, seen.places, gradients)
            own[np.diag_indices(len(own))] += (spread if gradients else spread[:, :1]).ravel() ** 2
            step = 4 if gradients else 1
            own[::step, ::step] += seen.shared**2
            factor.append(across, own)
        rest = np.column_stack([seen.values - value, seen.gradients - gradient])
        self._places = np.concatenate([self._places, seen.places])
        self._rest = np.concatenate([self._rest, rest])
        self._weights = self._whole.solve(self._rest.ravel()).reshape(-1, 4)

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and gradients (n, 3) at places (n, 3)."""
        value, gradient = self._ball.at(places)
        for start in range(0, len(places) if len(self._places) else 0, AT_ONCE):
            some = slice(start, start + AT_ONCE)
            more, steeper = self._found(places[some])
            value[some] += more
            gradient[some] += steeper
        return value, gradient

    def deviations(self, places: Floats) -> Floats:
        """Standard deviations (n,) of the values at places (n, 3), by the values observed, m.

        Gradients are left out: with them it would take sixteen times as long, and the order of
        the places is the same.
        """
        half = self._bare.half(block(self._kernel, self._places, places, False))
        prior = self._kernel(np.zeros(1)).k
        return np.asarray(np.sqrt(np.maximum(prior - np.einsum("ij,ij->j", half, half), 0.0)))

    def mesh(self, box: Floats, floor: float) -> Mesh:
        """The surface within a box (2, 3), cut off at the height of what the object stands on."""

        size = np.ceil((box[1] - box[0]) / CELL).astype(int) + 1
        axes = [np.linspace(box[0, i], box[1, i], size[i]) for i in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        field = spline_filter(self.at(grid.reshape(-1, 3))[0].reshape(size))
        scale = (size - 1) / (box[1] - box[0])

        def at(places: Floats) -> Floats:
            nodes = ((places - box[0]) * scale).T
            value = map_coordinates(field, nodes, prefilter=False, mode="nearest")
            return np.asarray(np.maximum(value, floor - places[:, 2]))

        def inside_out(places: Floats, ways: Floats) -> tuple[Floats, Floats]:
            ahead, behind = at(places + STEP * ways), at(places - STEP * ways)
            return at(places), (ahead - behind) / (2.0 * STEP)

        return isosurface(inside_out, box, LEVEL)

    def _found(self, places: Floats) -> tuple[Floats, Floats]:
        """What observations add to the ball: never the whole matrix between the places."""
        value, slope = self._weights[:, 0], self._weights[:, 1:]
        squares = (places**2).sum(axis=1)[:, None] + (self._places**2).sum(axis=1)
        r = np.sqrt(np.maximum(squares - 2.0 * places @ self._places.T, 0.0))
        k, g, h = self._kernel(r)
        along = places @ slope.T - np.einsum("mi,mi->m", self._places, slope)  # d . slope
        # A gradient's part, -g d . slope; the derivatives of all that by the place.
        more = k @ value - (g * along).sum(axis=1)
        # -(g d . slope)' = -h (d . slope) d - g slope, for (k' / r)' = h r.
        away = g * value - h * along
        steeper = away.sum(axis=1)[:, None] * places - away @ self._places - g @ slope
        return more, steeper
