"""The implicit spline of least energy through touched points, and the displacement of each touch.

With phi the spline, p a point, n its normal and d the displacement of its touch, the energy is the
sum of (phi(p) + n d)^2 / point^2 and |grad phi - n|^2 / normal^2 over all points, and of
|d|^2 / pose^2 over all touches, plus the integrals over the band of variation * |D^3 phi|^2 and of
anchor * (phi - coarse)^2. It follows Calakli and Taubin, *SSD: smooth signed distance surface
reconstruction*, 2011. We depart from it: displacements are estimated as well, because of the pose
errors of a robot; and third derivatives are penalised, where theirs are second ones, which draw
every untouched surface towards a plane. With third ones a ball is continued as a ball (as by
Moreton and Sequin, *Functional optimization for fair surface design*, 1992): errors are half as
large. Normals have a large standard deviation: next to edges many are wrong by degrees. Outliers
lose weight as with a Cauchy distribution. The equations are summed cell by cell; control values are
eliminated, and displacements are found by conjugate gradients.

Where an object was turned over, all touches since then share six more unknowns: the object's pose.
Unknowns with a Gaussian prior that displacements share make these depend on each other: their prior
covariance is pose^2 + C C^T, where a column of C is the displacement by one unknown; its inverse,
by Woodbury's identity, is (1 - C (C^T C + pose^2)^-1 C^T) / pose^2.

One more touch is fitted locally. Control values whose cells all lie near the touch are free, the
others are held: the equations of these cells are summed again, from the points in them only, and
solved as a dense matrix. The time does not depend on the size of the object or the number of
touches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.rebuild.general.band import (
    N_LOCAL,
    Band,
    basis_rows,
    basis_values,
    cell_integrals,
)
from palpate.core.rebuild.general.dissection import (
    Dissection,
    Factor,
    Longs,
    dissect,
    factorise,
)
from palpate.reprs import readable

MIN_POSE = 1e-9  # [cells] least pose error: a variance of 0 has no inverse


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """How exactly displacements are solved for, and how values become distances."""

    max_steps: int = 15  # of conjugate gradients
    residual: float = 0.03  # fraction of the right-hand side, at which they stop
    n_rows: int = 4096  # points whose rows are computed at a time: memory
    min_slope: float = 0.3  # least norm of a gradient by which a value is divided for a distance


@readable
class Weights(NamedTuple):
    """Standard deviations and weights of the energy's terms; lengths in cells."""

    point: float  # Standard deviation of a point
    normal: float  # Standard deviation of a component of a unit normal
    pose: float  # Standard deviation of a touch's displacement; 0 where poses are exact
    variation: float  # Weight of squared third derivatives; larger is smoother
    anchor: float  # Weight of the squared distance to the coarse solid
    cauchy: float = 6.0  # Standard deviations at which a point has half its weight


@readable
class TouchedPoints(NamedTuple):
    """Touched points; lengths in cells."""

    places: Floats  # (n, 3)
    normals: Floats  # Outward unit normals (n, 3)
    touch: Ints  # Number of each point's touch (n,), from 0 on
    # Of its touch's displacement that each point takes part in, (n,), from 0 to 1; None: all
    shares: Floats | None = None

    @property
    def moving(self) -> Floats:
        """Derivatives (n, 3) of the points' residuals by the displacement of their touch."""
        return self.normals if self.shares is None else self.shares[:, None] * self.normals

    def only(self, kept: Bools) -> TouchedPoints:
        """The points where a mask (n,) is set; touches keep their numbers."""
        shares = None if self.shares is None else self.shares[kept]
        return TouchedPoints(self.places[kept], self.normals[kept], self.touch[kept], shares)


def touch_middles(places: Floats, touch: Ints) -> Floats:
    """Mean of the points (n, 3) of each touch, (t, 3)."""
    count = np.maximum(np.bincount(touch), 1)
    sums = [np.bincount(touch, places[:, axis]) for axis in range(3)]
    return np.asarray(np.column_stack(sums) / count[:, None])


@readable
@dataclass(frozen=True, slots=True, eq=False)
class ImplicitFit:
    """Control values of an implicit spline, and residuals and weights of the points."""

    band: Band
    control: Floats  # (n,)
    displacements: Floats  # Of each touch, (t, 3)
    weights: Floats  # Factor of each point's rows, (k,), from 0 to 1: root of its weight
    residuals: Floats  # Of each point along its normal, after its displacement, (k,)

    def of_first(self, points: int, touches: int) -> ImplicitFit:
        """The same with only the first `points` and `touches`."""
        return replace(
            self,
            weights=self.weights[:points],
            residuals=self.residuals[:points],
            displacements=self.displacements[:touches],
        )


class Start(NamedTuple):
    """Weights and displacements with which a fit starts; lengths in cells."""

    weights: Floats  # Factor of each point's rows, (k,), from 0 to 1
    displacements: Floats  # Of each touch, (t, 3)

    def begun(self, fit: ImplicitFit, scale: float) -> Start:
        """With the results of a fit of the first touches, whose cells are `scale` times larger."""
        weights, displacements = self.weights.copy(), self.displacements.copy()
        # Points beside the band had weight 0 without being outliers: they start at 1.
        weights[: len(fit.weights)] = np.where(fit.weights > 0.0, fit.weights, 1.0)
        displacements[: len(fit.displacements)] = scale * fit.displacements
        return Start(weights, displacements)


def plain_start(points: int, touches: int) -> Start:
    """Start without an earlier fit: weights of 1, no displacements."""
    return Start(np.ones(points), np.zeros((touches, 3)))


class Spline(NamedTuple):
    """A fitted spline, and the size of its cells."""

    cell: float  # Edge of a cell, m
    fit: ImplicitFit

    def distances(self, places: Floats, min_slope: float) -> Floats:
        """Signed distances (n,) [m] to first order, of places (n, 3) from the origin; or NaN.

        `min_slope`: least norm of a gradient by which a value is divided.
        """
        value, gradient = self.fit.band.evaluate(self.fit.control, places / self.cell)
        slope = np.maximum(np.linalg.norm(gradient, axis=1), min_slope)
        return np.asarray(self.cell * value / slope)


class Solution(NamedTuple):
    """A fit, and the equations that it solves."""

    fit: ImplicitFit
    equations: Equations
    factor: Factor  # Of the equations of the control values alone
    shares: Floats  # Factor of the rows of each point of the equations, (k,)
    right: Floats  # Right-hand side of the control values, without displacements, (n,)

    def coupling(self) -> scipy.sparse.csr_matrix:
        """Block (n, 3 t) of the equations, of control values (n,) and displacements (3 t,)."""
        equations = self.equations
        square = (self.shares / equations.scale.point) ** 2
        weighted = equations.displacing.multiply(square[:, None])
        return scipy.sparse.csr_matrix(equations.values.T @ weighted)

    def touch_blocks(self) -> Floats:
        """Diagonal blocks (t, 3, 3) of the equations, one a touch's displacement."""
        return touch_blocks(self.equations, self.shares)

    def row_weights(self, points: Longs) -> Floats:
        """Factors (k, 4) of value and gradient of some points: 1 over their deviations."""
        scale = self.equations.scale
        deviations = np.array([scale.point, *[scale.normal] * 3])
        return np.asarray(self.shares[points, None] / deviations)


class SharedMotions(NamedTuple):
    """Displacements that touches share through common unknowns; lengths in cells."""

    columns: Floats  # Displacement by 1 of each unknown, whose prior deviation is 1, (3 t, u)
    pose: float  # Standard deviation of the rest of each touch's displacement, not 0

    def of(self, displacements: Floats) -> Floats:
        """The likeliest unknowns (u,) by the displacements (t, 3)."""
        return np.asarray(np.linalg.solve(self._system(), self.columns.T @ displacements.ravel()))

    def without(self, displacements: Floats) -> Floats:
        """The displacements (t, 3) less the part that touches share."""
        return displacements - (self.columns @ self.of(displacements)).reshape(-1, 3)

    def roots(self) -> Floats:
        """R (3 t, u) with which the inverse of the prior covariance is 1 / pose^2 - R R^T."""
        lower = np.linalg.cholesky(self._system())
        turned = scipy.linalg.solve_triangular(lower, self.columns.T, lower=True)
        return np.asarray(turned.T / self.pose)

    def _system(self) -> Floats:
        square = self.columns.T @ self.columns
        return np.asarray(square + self.pose**2 * np.eye(len(square)))


class Fitted(NamedTuple):
    """A spline over cells of one size, and what it was fitted to, in cells."""

    spline: Spline
    solution: Solution
    points: TouchedPoints
    control: Floats  # Distances from the coarse solid at the control values, (n,)
    weights: Weights
    shared: SharedMotions | None = None  # None where the object was never turned over


class CellBlocks(NamedTuple):
    """Blocks (64, 64) of a band's cells, computed on demand: all would fill memory."""

    offsets: Floats  # Places of the points in their cells, in the order of the cells, (k, 3)
    scale: Floats  # Factors of their rows, of value and gradient, (4, k)
    cell: Ints  # Cell of each point, ascending, (k,)
    smoothness: Floats  # Penalty of third derivatives, in each block, (64, 64)
    anchors: Floats  # Weight of the squared distance to the coarse solid in each cell, (c,)
    n_rows: int  # Points whose rows are computed at a time

    def of(self, cells: Longs) -> Floats:
        """The blocks of some cells, (c, 64, 64)."""
        blocks = self.smoothness + self.anchors[cells, None, None] * cell_integrals()[1]
        starts, ends = (np.searchsorted(self.cell, cells, side) for side in ("left", "right"))
        last = np.cumsum(ends - starts)  # of the points of these cells
        first = last - (ends - starts)
        rows = self._weighed(np.repeat(starts - first, ends - starts) + np.arange(last[-1]))
        for place in np.flatnonzero(ends > starts):
            own = rows[:, first[place] : last[place]].reshape(-1, N_LOCAL)
            blocks[place] += own.T @ own
        return blocks

    @property
    def largest(self) -> float:
        """The largest diagonal element of all blocks."""
        regular = (self.smoothness + self.anchors.max() * cell_integrals()[1]).diagonal()
        most = [float(regular.max())]
        ends = np.append(np.flatnonzero(np.diff(self.cell)) + 1, len(self.cell))
        begin = 0
        while begin < len(self.cell):  # some cells at a time
            beyond = int(np.searchsorted(ends, begin + self.n_rows))
            end = int(ends[min(beyond, len(ends) - 1)])
            starts = np.flatnonzero(np.diff(self.cell[begin:end], prepend=-1))
            squares = (self._weighed(np.arange(begin, end)) ** 2).sum(axis=0)
            most.append(float((np.add.reduceat(squares, starts) + regular).max()))
            begin = end
        return max(most)

    def _weighed(self, points: Longs) -> Floats:
        """Rows of some points, (4, m, 64)."""
        return basis_rows(self.offsets[points]) * self.scale[:, points, None]


class Equations:
    """Rows of touched points over a band, and their normal equations."""

    def __init__(
        self,
        band: Band,
        points: TouchedPoints,
        weights: Weights,
        count: int,
        dissection: Dissection | None,
        shared: SharedMotions | None,
        n_rows: int,
    ):
        self.shared_roots = np.zeros((3 * count, 0)) if shared is None else shared.roots()
        if dissection is None:
            dissection = dissect(band.cells, band.local, len(band.control))
        self.dissection = dissection
        number, offsets = band.locate(points.places)
        self.inside = np.flatnonzero(number >= 0)
        order = self.inside[np.argsort(number[self.inside], kind="stable")]
        self.order, self.band, self.scale, self.count = order, band, weights, count
        self.n_rows = n_rows
        self.cell = number[order]
        self.normals, self.touch = points.normals[order], points.touch[order]
        self.moving = points.moving[order]
        self.offsets = offsets[order]
        local = band.local[self.cell]
        ends = np.arange(0, N_LOCAL * len(order) + 1, N_LOCAL)
        shape = (len(order), len(band.control))
        values = basis_values(self.offsets)
        self.values = scipy.sparse.csr_matrix((values.ravel(), local.ravel(), ends), shape=shape)
        self.displacing = scipy.sparse.csr_matrix(
            (
                self.moving.ravel(),
                (np.repeat(np.arange(len(order)), 3), _triples(self.touch)),
            ),
            shape=(len(order), 3 * count),
        )

    def blocks(self, shares: Floats, smoothness: Floats, anchors: Floats) -> CellBlocks:
        """Sums of products of rows by cell, plus the penalties of each cell.

        `shares` (k,): factors of the points' rows. `smoothness`, `anchors`: as in `CellBlocks`.
        """
        scale = np.array([self.scale.point, *[self.scale.normal] * 3])
        rows = shares / scale[:, None]
        return CellBlocks(self.offsets, rows, self.cell, smoothness, anchors, self.n_rows)

    def right_side(self, shares: Floats) -> Floats:
        """Part (n,) of the right-hand side by the normals, which are targets of the gradients."""
        asked = ((shares / self.scale.normal) ** 2)[:, None] * self.normals
        right = np.zeros(len(self.band.control))
        for begin in range(0, len(self.cell), self.n_rows):
            some = slice(begin, begin + self.n_rows)
            sums = np.einsum("akl,ka->kl", basis_rows(self.offsets[some])[1:], asked[some])
            local = self.band.local[self.cell[some]]
            right += np.bincount(local.ravel(), sums.ravel(), len(right))
        return right

    def misfits(self, control: Floats, displacements: Floats) -> tuple[Floats, Floats]:
        """Residuals (k,) of values at points, and norms (k,) of the residuals of gradients."""
        value = np.asarray(self.values @ control + self.displacing @ displacements.ravel())
        gradient = self.band.evaluate_in(control, self.cell, self.offsets)[1]
        return value, np.linalg.norm(gradient - self.normals, axis=1)


def _triples(touch: Ints) -> Ints:
    return np.asarray((3 * touch[:, None].astype(np.int64) + np.arange(3)).ravel())


def fit_implicit(
    band: Band,
    points: TouchedPoints,
    coarse: Floats,
    weights: Weights,
    start: Start,
    dissection: Dissection | None = None,
    shared: SharedMotions | None = None,
    swept: Floats | None = None,
    settings: FitSettings = FitSettings(),
) -> Solution:
    """The spline over a band; points outside it have no weight.

    `coarse` (n,): distances from the coarse solid at the control values [cells]. `start`: weights
    of points and first guess of displacements. `dissection`: of the band, if known. `shared`:
    motions that touches share beside their own displacements. `swept` (c,): weights of the squared
    distance to the coarse solid in each cell, in addition to `weights.anchor`; None: all 0.
    """
    count = len(start.displacements)
    equations = Equations(band, points, weights, count, dissection, shared, settings.n_rows)
    third, mass = cell_integrals()
    anchors = np.full(len(band.cells), weights.anchor) + (0.0 if swept is None else swept)
    pulled = np.zeros(len(band.control))
    np.add.at(pulled, band.local, anchors[:, None] * (coarse[band.local] @ mass))
    shares = start.weights[equations.order]
    blocks = equations.blocks(shares, weights.variation * third, anchors)
    factor = factorise(equations.dissection, blocks)
    right = equations.right_side(shares) + pulled
    control, moved = _solve(equations, factor, shares, right, start.displacements, settings)
    fit = with_residuals(equations, len(points.places), control, moved)
    return Solution(fit, equations, factor, shares, right)


def with_residuals(
    equations: Equations, count: int, control: Floats, displacements: Floats
) -> ImplicitFit:
    """A solution of the equations, with residuals and weights of `count` points."""
    scale = equations.scale
    value, tilt = equations.misfits(control, displacements)
    off = (value / scale.point) ** 2 + (tilt / scale.normal) ** 2
    weights, residuals = np.zeros(count), np.full(count, np.nan)
    weights[equations.order] = (1.0 + off / scale.cauchy**2) ** -0.5
    residuals[equations.order] = value
    return ImplicitFit(equations.band, control, displacements, weights, residuals)


def touch_blocks(equations: Equations, shares: Floats) -> Floats:
    """Diagonal blocks (t, 3, 3) of the equations, one a touch's displacement."""
    square = (shares / equations.scale.point) ** 2
    normals, touch, count = equations.moving.T, equations.touch, equations.count
    own = np.empty((count, 3, 3))
    for i, j in np.ndindex(3, 3):
        own[:, i, j] = np.bincount(touch, normals[i] * normals[j] * square, count)
    return np.asarray(own + np.eye(3) / max(equations.scale.pose, MIN_POSE) ** 2)


def _solve(
    equations: Equations,
    factor: Factor,
    shares: Floats,
    right: Floats,
    start: Floats,
    settings: FitSettings,
) -> tuple[Floats, Floats]:
    """Control values (n,) and displacements (t, 3) of least energy."""
    alone = factor.solve(right)
    if not equations.scale.pose:
        return alone, np.zeros_like(start)
    square = (shares / equations.scale.point) ** 2
    own = touch_blocks(equations, shares)
    inverse = np.asarray(np.linalg.inv(own), np.float64)
    roots = equations.shared_roots

    def to_touches(control: Floats) -> Floats:
        along = np.asarray(equations.displacing.T @ (square * (equations.values @ control)))
        return along.reshape(-1, 3)

    def to_control(displacements: Floats) -> Floats:
        along = equations.displacing @ displacements.ravel()
        return np.asarray(equations.values.T @ (square * along))

    def apply(displacements: Floats) -> Floats:
        through = to_touches(factor.solve(to_control(displacements)))
        together = roots @ (roots.T @ displacements.ravel())
        alone = np.einsum("tij,tj->ti", own, displacements)
        return np.asarray(alone - through - together.reshape(-1, 3))

    moved = conjugate_gradients(apply, -to_touches(alone), inverse, start, settings)
    return alone - factor.solve(to_control(moved)), moved


def conjugate_gradients(
    apply: Callable[[Floats], Floats],
    right: Floats,
    inverse: Floats,
    start: Floats,
    settings: FitSettings,
) -> Floats:
    """Displacements (t, 3) that solve a system, preconditioned by the blocks' `inverse`."""
    solution = start
    residual = right - apply(solution) if start.any() else right
    turned = np.einsum("tij,tj->ti", inverse, residual)
    direction, product = turned, float((residual * turned).sum())
    enough = settings.residual**2 * float((right * np.einsum("tij,tj->ti", inverse, right)).sum())
    for _ in range(settings.max_steps):
        if product <= enough:
            break
        image = apply(direction)
        length = product / float((direction * image).sum())
        solution, residual = solution + length * direction, residual - length * image
        turned = np.einsum("tij,tj->ti", inverse, residual)
        product, before = float((residual * turned).sum()), product
        direction = turned + product / before * direction
    return np.asarray(solution)


def refit_locally(
    fit: ImplicitFit, before: TouchedPoints, touched: TouchedPoints, weights: Weights, reach: float
) -> ImplicitFit:
    """The fit with the points of one more touch; control values change within `reach` [cells].

    `before`: the points it was fitted to, whose displacements and weights are held.
    """
    band = fit.band
    middles = band.cells + 0.5
    cells = np.flatnonzero(
        scipy.spatial.cKDTree(touched.places).query(middles, distance_upper_bound=reach)[0] < np.inf
    )
    values = np.unique(band.local[cells])
    elsewhere = np.ones(len(band.cells), np.bool_)
    elsewhere[cells] = False
    free = ~np.isin(values, band.local[elsewhere])
    system = _LocalSystem(fit, cells, values, weights)
    shift = np.einsum("ij,ij->i", before.moving, fit.displacements[before.touch])
    system.add(before, fit.weights, shift)
    columns, own = system.add(touched, np.ones(len(touched.places)), np.zeros(len(touched.places)))
    own += np.eye(3) / max(weights.pose, np.finfo(float).tiny) ** 2
    through = np.linalg.solve(own, columns.T)
    matrix, right = system.matrix - columns @ through, system.right
    held = fit.control[values[~free]]
    factor = scipy.linalg.cho_factor(matrix[np.ix_(free, free)], lower=True, check_finite=False)
    solution = scipy.linalg.cho_solve(factor, right[free] - matrix[np.ix_(free, ~free)] @ held)
    control = fit.control.copy()
    control[values[free]] = solution
    moved = -through @ control[values]
    value, gradient = band.evaluate(control, touched.places)
    residuals = value + touched.moving @ moved
    tilt = np.linalg.norm(gradient - touched.normals, axis=1)
    off = (residuals / weights.point) ** 2 + (tilt / weights.normal) ** 2
    shares = np.where(np.isfinite(off), (1.0 + off / weights.cauchy**2) ** -0.5, 0.0)
    return replace(
        fit,
        control=control,
        displacements=np.concatenate([fit.displacements, moved[None]]),
        weights=np.concatenate([fit.weights, shares]),
        residuals=np.concatenate([fit.residuals, residuals]),
    )


class _LocalSystem:
    """Dense equations of the control values over some cells."""

    def __init__(self, fit: ImplicitFit, cells: Longs, values: Ints, weights: Weights):
        self.band, self.weights = fit.band, weights
        self.place = np.full(len(fit.band.control), -1)
        self.place[values] = np.arange(len(values))
        self.known = np.zeros(len(fit.band.cells), np.bool_)
        self.known[cells] = True
        third, mass = cell_integrals()
        local = self.place[fit.band.local[cells]]
        self.matrix = np.zeros((len(values), len(values)))
        regular = weights.variation * third + weights.anchor * mass
        self._sum(local, np.broadcast_to(regular, (len(cells), *regular.shape)))
        self.right = np.zeros(len(values))
        pulled = weights.anchor * (fit.control[fit.band.local[cells]] @ mass)
        np.add.at(self.right, local, pulled)

    def add(self, points: TouchedPoints, shares: Floats, shift: Floats) -> tuple[Floats, Floats]:
        """Sum the rows of points in these cells, displaced by `shift` along their normals.

        Returns the blocks of the equations of a displacement of all: (values, 3) and (3, 3).
        """
        number, offsets = self.band.locate(points.places)
        inside = np.flatnonzero((number >= 0) & self.known[number])
        rows, normals = basis_rows(offsets[inside]), points.normals[inside]
        local = self.place[self.band.local[number[inside]]]
        value = (shares[inside] / self.weights.point) ** 2
        slope = (shares[inside] / self.weights.normal) ** 2
        scale = np.sqrt(np.stack([value, slope, slope, slope]))
        scaled = (rows * scale[..., None]).transpose(1, 0, 2)
        order = np.argsort(number[inside], kind="stable")
        starts = np.flatnonzero(np.diff(number[inside][order], prepend=-1))
        for part in np.split(order, starts[1:]) if len(order) else ():
            own = scaled[part].reshape(-1, scaled.shape[2])
            at = local[part[0]]
            self.matrix[np.ix_(at, at)] += own.T @ own
        asked = np.einsum("akl,ka->kl", rows[1:], normals) * slope[:, None]
        asked -= rows[0] * (value * shift[inside])[:, None]
        np.add.at(self.right, local, asked)
        columns = np.zeros((len(self.right), 3))
        moving = points.moving[inside]
        weighed = value[:, None] * moving
        np.add.at(columns, local, rows[0][..., None] * weighed[:, None])
        return columns, np.asarray(moving.T @ weighed)

    def _sum(self, local: Ints, blocks: Floats) -> None:
        count = len(self.matrix)
        at = local[:, :, None].astype(np.int64) * count + local[:, None]
        flat = np.bincount(at.ravel(), blocks.ravel(), count * count)
        self.matrix += flat.reshape(count, count)
