"""Closed curves as Fung, 1999, 4.4.2, fits them: clamped knots and pseudo-vertices, for comparison.

The equations contradict each other: on clamped knots a curve whose first vertices come again as
its last ones, and whose derivatives agree where it closes, has its first three vertices in one
point. So it never closes, and moving the parameters does not help.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.bases import Basis, clamped_basis
from palpate.core.splines.curve_fits import CurveFit

PSEUDO = 3  # Pseudo-vertices of a cubic
ENOUGH = 0.02  # Distance of the pseudo-vertices that is let pass, as a share of the mean diameter
MOST_PASSES = 300
DAMPING = 0.5  # Of the parameters' steps; it stands in the thesis's program, not in (4.40)
CUTOFF = 1e-10  # Of the pseudo-inverse
TINY = 1e-300


def fit_closed_thesis(points: Floats, parameters: Floats, count: int) -> CurveFit:
    """Cubic by (4.27) to (4.40), of `count` vertices, at least 4; see the module.

    `points` (m, d): around the curve; the first is used once more at the end. `parameters` (m,): of
    the points, increasing from 0, in turns. `count`: vertices, without the pseudo-vertices.
    """
    basis = clamped_basis(count + PSEUDO)
    closed = np.vstack([points, points[:1]])
    parameters = np.append(parameters, 1.0)
    enough = ENOUGH * float(np.ptp(points, axis=0).mean())
    wanted = np.vstack([closed, np.zeros((PSEUDO + 2, points.shape[1]))])
    for _ in range(MOST_PASSES):
        seen = basis.matrix(parameters).toarray()
        system = np.vstack([seen, _closing_rows(basis, count, parameters[[0, -1]])])
        vertices = np.linalg.pinv(system, rcond=CUTOFF) @ wanted
        open_by = float(np.linalg.norm(vertices[:PSEUDO] - vertices[count:]))
        if open_by < enough:
            break
        around = np.vstack([vertices[:count], vertices[:PSEUDO]])
        slopes = basis.matrix(parameters, 1) @ around
        step = ((closed - seen @ around) * slopes).sum(axis=1)
        step /= np.maximum((slopes * slopes).sum(axis=1), TINY)
        parameters = np.maximum.accumulate(np.clip(parameters + DAMPING * step, 0.0, 1.0))
    return CurveFit(
        control=vertices[:count],
        knots=basis.knots,
        parameters=parameters[:-1],
        condition=float(np.linalg.cond(system)),
        effective=float(count),
        smoothing=0.0,
    )


def _closing_rows(basis: Basis, count: int, ends: Floats) -> Floats:
    """Rows (5, count + 3) of (4.37): equal vertices, equal derivatives where the curve closes."""
    same = np.eye(PSEUDO, basis.count) - np.eye(PSEUDO, basis.count, count)
    first, second = (basis.matrix(ends, order).toarray() for order in (1, 2))
    return np.vstack([same, first[0] - first[1], second[0] - second[1]])
