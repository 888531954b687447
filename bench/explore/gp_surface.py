"""A Gaussian-process implicit surface: 0 on the object, negative inside, about 1 m a metre.

Williams and Fitzgibbon, *Gaussian process implicit surfaces*, 2006; with normals as observed
gradients, Dragiev, Toussaint and Gienger, *Gaussian process implicit surfaces for shape estimation
and grasping*, 2011. Before anything is touched it is a ball. A kernel is a function of the distance
r. Between values it is k; between a value at x and a gradient at y, -g (x - y); between two
gradients, -(h d d' + g 1), where g is k' / r, h is (k'' - g) / r^2 and d is x - y.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.ndimage import map_coordinates, spline_filter

from palpate.core import Floats
from palpate.core.shapes import Mesh, isosurface

AT_ONCE = 4096  # Places that are evaluated together
UNKNOWN = 1e3  # Standard deviation of a gradient that nobody measured
# Of the grid whose cubic interpolation the mesh is made of, m: far below the kernels' lengths.
CELL = 2e-3
LEVEL = 7  # Of the mesh: cells of 0.8 mm, with their corners on the surface
STEP = 1e-3  # Of a way along a cell's edge, over which the slope is taken
TINY = 1e-12
FIRST_ROWS = 256  # Rows for which there is room at first
BLOCK = 128


class BallPrior(NamedTuple):
    """What is expected before anything is touched."""

    centre: Floats  # (3,), m
    radius: float  # m

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and gradients (n, 3) at places (n, 3)."""
        away = places - self.centre
        value = (np.einsum("ni,ni->n", away, away) - self.radius**2) / (2.0 * self.radius)
        return value, away / self.radius


class Observations(NamedTuple):
    """What was found out, at places (n, 3)."""

    places: Floats  # m
    values: Floats  # (n,), m
    value_errors: Floats  # Standard deviations of each by itself, (n,), m
    shared: float  # Standard deviation of what all are off by together, m
    gradients: Floats  # (n, 3)
    gradient_errors: Floats  # Standard deviations, (n,)


class GpSurface:
    """A surface and what it knows of itself.

    `kernel`: how alike places are. `ball`: what is expected.
    """

    def __init__(self, kernel: Kernel, ball: BallPrior):
        self._kernel, self._ball = kernel, ball
        self._places, self._rest = np.zeros((0, 3)), np.zeros((0, 4))
        self._whole, self._bare = CholeskyFactor(), CholeskyFactor()
        self._weights = np.zeros((0, 4))

    def observe(self, seen: Observations) -> None:
        """Take in what was found out."""
        value, gradient = self._ball.at(seen.places)
        spread = np.column_stack([seen.value_errors, *3 * [seen.gradient_errors]])
        for factor, gradients in ((self._whole, True), (self._bare, False)):
            across = covariance_block(self._kernel, seen.places, self._places, gradients)
            own = covariance_block(self._kernel, seen.places, seen.places, gradients)
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
        half = self._bare.half(covariance_block(self._kernel, self._places, places, False))
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


def covariance_block(kernel: Kernel, one: Floats, other: Floats, gradients: bool) -> Floats:
    """Covariance between places (n, 3) and (m, 3).

    Returns (4 n, 4 m), of each place first the value and then the gradient.
    """
    away = one[:, None] - other[None]
    r = np.sqrt(np.einsum("nmi,nmi->nm", away, away))
    k, g, h = kernel(r)
    if not gradients:
        return k
    found = np.empty((len(one), 4, len(other), 4))
    found[:, 0, :, 0] = k
    toward = -g[..., None] * away
    found[:, 0, :, 1:] = toward
    found[:, 1:, :, 0] = -toward.transpose(0, 2, 1)
    for i in range(3):
        for j in range(3):
            found[:, 1 + i, :, 1 + j] = -h * away[..., i] * away[..., j] - (g if i == j else 0.0)
    return found.reshape(4 * len(one), 4 * len(other))


class KernelParts(NamedTuple):
    """Of a kernel at distances, each of the distances' shape."""

    k: Floats
    g: Floats
    h: Floats


def matern(length: float) -> Kernel:
    """Matern, nu = 5/2, whose gradients have unit variance: of a distance, in its own unit."""

    def parts(r: Floats) -> KernelParts:
        s = np.sqrt(5.0) / length * r
        fall = np.exp(-s)
        scale = 0.6 * length**2
        return KernelParts(
            scale * (1.0 + s + s * s / 3.0) * fall, -(1.0 + s) * fall, 5.0 / length**2 * fall
        )

    return parts


def thin_plate(widest: float) -> Kernel:
    """Thin plate of Williams and Fitzgibbon, 2 r^3 - 3 R r^2 + R^3; gradients of unit variance.

    R is the largest distance between any two places.
    """

    def parts(r: Floats) -> KernelParts:
        scale = 1.0 / (6.0 * widest)
        k = 2.0 * r**3 - 3.0 * widest * r**2 + widest**3
        return KernelParts(scale * k, scale * 6.0 * (r - widest), scale * 6.0 / np.maximum(r, TINY))

    return parts


class CholeskyFactor:
    """Lower factor L of a positive definite matrix L L'."""

    def __init__(self) -> None:
        self.size = 0
        """Rows."""
        self._room = np.zeros((FIRST_ROWS, FIRST_ROWS))

    @property
    def lower(self) -> Floats:
        """L, (size, size)."""
        return self._room[: self.size, : self.size]

    def append(self, across: Floats, own: Floats) -> None:
        """Add rows: their covariance with those before, (m, size), and their own, (m, m)."""
        before, after = self.size, self.size + len(own)
        if after > len(self._room):
            wider = np.zeros((3 * after // 2, 3 * after // 2))
            wider[:before, :before] = self.lower
            self._room = wider
        left = self.half(across.T).T
        self._room[before:after, :before] = left
        self._room[before:after, before:after] = cholesky(own - left @ left.T, lower=True)
        self.size = after

    def half(self, right: Floats) -> Floats:
        """Solve L x = right."""
        found = np.array(right, float)
        for some in self._blocks():
            rest = found[some] - self._room[some, : some.start] @ found[: some.start]
            found[some] = solve_triangular(self._room[some, some], rest, lower=True)
        return found

    def solve(self, right: Floats) -> Floats:
        """Solve L L' x = right."""
        found = self.half(right)
        for some in reversed(self._blocks()):
            below = slice(some.stop, self.size)
            rest = found[some] - self._room[below, some].T @ found[below]
            found[some] = solve_triangular(self._room[some, some], rest, lower=True, trans=1)
        return found

    def _blocks(self) -> list[slice]:
        """Of rows: scipy would copy the whole factor for each solution, of a block it may."""
        starts = range(0, self.size, BLOCK)
        return [slice(start, min(start + BLOCK, self.size)) for start in starts]


Kernel = Callable[[Floats], KernelParts]  # Of distances
