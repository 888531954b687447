"""A fit with one touch more, solved anew about that touch alone.

Control values whose cells all lie near the touch are free, the others stay: the equations of these
cells are summed again, of the points in them only, and solved densely. It takes the same time
whatever the size of the object and the number of touches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.general.band import basis_rows, cell_integrals
from palpate.core.rebuild.general.dissection import Longs
from palpate.core.rebuild.general.fitting import ImplicitFit, TouchedPoints, Weights


def refit_locally(
    fit: ImplicitFit, before: TouchedPoints, touched: TouchedPoints, weights: Weights, reach: float
) -> ImplicitFit:
    """The fit with the points of one touch more; control values change within a reach, cells.

    `before`: the points that it was fitted to; their displacements and weights stay. Points outside
    the band have no weight.
    """
    band = fit.band
    middles = band.cells + 0.5
    cells = np.flatnonzero(
        cKDTree(touched.places).query(middles, distance_upper_bound=reach)[0] < np.inf
    )
    values = np.unique(band.local[cells])
    elsewhere = np.ones(len(band.cells), np.bool_)
    elsewhere[cells] = False
    free = ~np.isin(values, band.local[elsewhere])
    system = _LocalSystem(fit, cells, values, weights)
    shift = np.einsum("ij,ij->i", before.normals, fit.displacements[before.touch])
    system.add(before, fit.weights, shift)
    columns, own = system.add(touched, np.ones(len(touched.places)), np.zeros(len(touched.places)))
    own += np.eye(3) / max(weights.pose, np.finfo(float).tiny) ** 2
    through = np.linalg.solve(own, columns.T)
    matrix, right = system.matrix - columns @ through, system.right
    held = fit.control[values[~free]]
    factor = cho_factor(matrix[np.ix_(free, free)], lower=True, check_finite=False)
    found = cho_solve(factor, right[free] - matrix[np.ix_(free, ~free)] @ held)
    control = fit.control.copy()
    control[values[free]] = found
    moved = -through @ control[values]
    value, gradient = band.evaluate(control, touched.places)
    residuals = value + touched.normals @ moved
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

        Returns how they depend on a displacement of all of them: (values, 3) and (3, 3).
        """
        number, within = self.band.locate(points.places)
        inside = np.flatnonzero((number >= 0) & self.known[number])
        rows, normals = basis_rows(within[inside]), points.normals[inside]
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
        weighed = value[:, None] * normals
        np.add.at(columns, local, rows[0][..., None] * weighed[:, None])
        return columns, np.asarray(normals.T @ weighed)

    def _sum(self, local: Ints, blocks: Floats) -> None:
        count = len(self.matrix)
        at = local[:, :, None].astype(np.int64) * count + local[:, None]
        flat = np.bincount(at.ravel(), blocks.ravel(), count * count)
        self.matrix += flat.reshape(count, count)
