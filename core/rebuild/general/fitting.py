"""The implicit spline of least energy through touched points, and how far each touch was displaced.

With phi the spline, p a point, n its normal and d the displacement of its touch, what is minimised
is the sum of (phi(p) + n d)^2 / point^2 and |grad phi - n|^2 / normal^2 over all points, of
|d|^2 / pose^2 over all touches, and integrals over the band of variation * |D^3 phi|^2 and of
anchor * (phi - coarse)^2. It follows Calakli and Taubin, *SSD: smooth signed distance surface
reconstruction*, 2011. We depart from it: displacements are estimated besides, which the pose error
of a robot asks for; and third derivatives are held small where theirs are second ones, which draw
every surface towards planes where nothing was touched. Without touch a ball is continued as a ball
(as by Moreton and Sequin, *Functional optimization for fair surface design*, 1992): errors are half
as large. Normals are weighed loosely: of those next to edges many are wrong by degrees. Points that
no spline follows lose weight as a Cauchy distribution has it. The equations are summed cell by
cell; displacements are eliminated, and found by conjugate gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.rebuild.general.band import LOCAL, Band, basis_rows, cell_integrals
from palpate.core.rebuild.general.dissection import Dissection, dissect, factorise

MOST_STEPS, RESIDUAL = 15, 3e-3


class Weights(NamedTuple):
    """What the terms of the energy are measured by; lengths in cells."""

    point: float  # Standard deviation of a point
    normal: float  # Of a normal, 1
    pose: float  # Of a touch's displacement; 0 where poses are exact
    variation: float
    anchor: float
    cauchy: float = 6.0  # Deviations from which on a point counts as an outlier


class TouchedPoints(NamedTuple):
    """Points in cells."""

    places: Floats  # (n, 3)
    normals: Floats  # (n, 3)
    touch: Ints  # (n,), from 0 on

    def only(self, kept: Bools) -> TouchedPoints:
        """Those where a mask (n,) is set; touches keep their numbers."""
        return TouchedPoints(self.places[kept], self.normals[kept], self.touch[kept])


@dataclass(frozen=True, slots=True, eq=False)
class ImplicitFit:
    """Control values of an implicit spline, and what the points say of it."""

    band: Band
    control: Floats  # (n,)
    displacements: Floats  # Of each touch, (t, 3)
    weights: Floats  # Of each point, (k,), from 0 to 1
    residuals: Floats  # Of each point along its normal, its touch displaced, (k,)


class Equations:
    """Rows of touched points over a band, and their normal equations."""

    def __init__(
        self,
        band: Band,
        points: TouchedPoints,
        weights: Weights,
        count: int,
        dissection: Dissection | None = None,
    ):
        if dissection is None:
            dissection = dissect(band.cells, band.local, len(band.control))
        self.dissection = dissection
        number, within = band.locate(points.places)
        self.inside = np.flatnonzero(number >= 0)
        order = self.inside[np.argsort(number[self.inside], kind="stable")]
        self.order, self.band, self.scale, self.count = order, band, weights, count
        self.cell = number[order]
        self.normals, self.touch = points.normals[order], points.touch[order]
        rows = basis_rows(within[order])
        self.rows = rows
        local = band.local[self.cell]
        ends = np.arange(0, LOCAL * len(order) + 1, LOCAL)
        shape = (len(order), len(band.control))
        self.values, *self.slopes = (
            csr_matrix((one.ravel(), local.ravel(), ends), shape=shape) for one in rows
        )
        self.displacing = csr_matrix(
            (
                self.normals.ravel(),
                (np.repeat(np.arange(len(order)), 3), _triples(self.touch)),
            ),
            shape=(len(order), 3 * count),
        )

    def blocks(self, shares: Floats, regular: Floats) -> Floats:
        """Sums of products of rows by cell, (m, 64, 64), and what is regular in each, (64, 64).

        `shares` (k,) weigh the points.
        """
        found = np.empty((len(self.band.cells), LOCAL, LOCAL))
        found[:] = regular
        scale = np.array([self.scale.point, *[self.scale.normal] * 3])
        scaled = (self.rows * (shares / scale[:, None])[..., None]).transpose(1, 0, 2)
        starts = np.flatnonzero(np.diff(self.cell, prepend=-1))
        ends = np.append(starts[1:], len(self.cell))
        for start, end in zip(starts, ends, strict=True):
            rows = scaled[start:end].reshape(-1, LOCAL)
            found[self.cell[start]] += rows.T @ rows
        return found

    def right_side(self, shares: Floats) -> Floats:
        """What the normals ask of the gradients, (n,)."""
        factor = (shares / self.scale.normal) ** 2
        pairs = zip(self.slopes, self.normals.T, strict=True)
        return np.asarray(sum(slope.T @ (factor * along) for slope, along in pairs))

    def misfits(self, control: Floats, displacements: Floats) -> tuple[Floats, Floats]:
        """Residuals of points, (k,), and how far off the gradients are, (k,)."""
        value = self.values @ control + self.displacing @ displacements.ravel()
        gradient = np.stack([slope @ control for slope in self.slopes], axis=1)
        return value, np.linalg.norm(gradient - self.normals, axis=1)


def _triples(touch: Ints) -> Ints:
    return np.asarray((3 * touch[:, None].astype(np.int64) + np.arange(3)).ravel())


def fit_implicit(
    band: Band,
    points: TouchedPoints,
    coarse: Floats,
    weights: Weights,
    *,
    touches: int,
    rounds: int,
    start: ImplicitFit | None = None,
    dissection: Dissection | None = None,
) -> ImplicitFit:
    """The spline over a band; points outside it have no weight.

    `coarse` (n,): the coarse solid at the control values, in cells. `touches`: how many there are.
    `rounds`: of weighing outliers anew. `start`: a fit over the same band whose displacements and
    weights are begun with. `dissection`: of the band, if it is known.
    """
    equations = Equations(band, points, weights, touches, dissection)
    third, mass = cell_integrals()
    regular = weights.variation * third + weights.anchor * mass
    pulled = np.zeros(len(band.control))
    np.add.at(pulled, band.local, weights.anchor * (coarse[band.local] @ mass))
    shares = np.ones(len(equations.order)) if start is None else start.weights[equations.order]
    moved = np.zeros((touches, 3)) if start is None else start.displacements
    for _ in range(rounds):
        control, moved = _solve(equations, shares, regular, pulled, moved)
        value, tilt = equations.misfits(control, moved)
        off = (value / weights.point) ** 2 + (tilt / weights.normal) ** 2
        shares = (1.0 + off / weights.cauchy**2) ** -0.5
    every, residuals = np.zeros(len(points.places)), np.full(len(points.places), np.nan)
    every[equations.order], residuals[equations.order] = shares, value
    return ImplicitFit(band, control, moved, every, residuals)


def _solve(
    equations: Equations, shares: Floats, regular: Floats, pulled: Floats, start: Floats
) -> tuple[Floats, Floats]:
    """Control values (n,) and displacements (t, 3) of least energy."""
    factor = factorise(equations.dissection, equations.blocks(shares, regular))
    right = equations.right_side(shares) + pulled

    alone = factor.solve(right)
    pose = equations.scale.pose
    if not pose:
        return alone, np.zeros_like(start)
    square = (shares / equations.scale.point) ** 2
    normals, touch, count = equations.normals.T, equations.touch, equations.count
    own = np.empty((count, 3, 3))
    for i, j in np.ndindex(3, 3):
        own[:, i, j] = np.bincount(touch, normals[i] * normals[j] * square, count)
    own += np.eye(3) / pose**2
    inverse = np.asarray(np.linalg.inv(own), np.float64)

    def to_touches(control: Floats) -> Floats:
        along = np.asarray(equations.displacing.T @ (square * (equations.values @ control)))
        return along.reshape(-1, 3)

    def to_control(displacements: Floats) -> Floats:
        along = equations.displacing @ displacements.ravel()
        return np.asarray(equations.values.T @ (square * along))

    def apply(displacements: Floats) -> Floats:
        through = to_touches(factor.solve(to_control(displacements)))
        return np.asarray(np.einsum("tij,tj->ti", own, displacements) - through)

    moved = conjugate_gradients(apply, -to_touches(alone), inverse, start)
    return alone - factor.solve(to_control(moved)), moved


def conjugate_gradients(
    apply: Callable[[Floats], Floats], right: Floats, inverse: Floats, start: Floats
) -> Floats:
    """Displacements (t, 3) that solve a symmetric system, each touch's own block inverted."""
    found = start
    residual = right - apply(found) if start.any() else right
    turned = np.einsum("tij,tj->ti", inverse, residual)
    way, product = turned, float((residual * turned).sum())
    enough = RESIDUAL**2 * float((right * np.einsum("tij,tj->ti", inverse, right)).sum())
    for _ in range(MOST_STEPS):
        if product <= enough:
            break
        image = apply(way)
        length = product / float((way * image).sum())
        found, residual = found + length * way, residual - length * image
        turned = np.einsum("tij,tj->ti", inverse, residual)
        product, before = float((residual * turned).sum()), product
        way = turned + product / before * way
    return np.asarray(found)
