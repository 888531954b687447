"""How well points determine a fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats

NEGLIGIBLE = 1e-6
"""Of the longest column, and of the largest singular value: counts as nothing."""
PRIOR = 1.0
"""Standard deviation, in the units of the fit (points of diameter 1, logarithms, radians), that
each parameter has before there are points; no variance is infinite."""


class Certainty(NamedTuple):
    """Covariance and rank of a fit."""

    covariance: Floats
    """(p, p)."""
    rank: int
    condition: float


def certainty(jacobian: Floats, noise: float, free: Bools) -> Certainty:
    """How well points determine parameters.

    Parameters
    ----------
    jacobian : (n, p) array
        Derivatives of the residuals by the parameters.
    noise : float
        Standard deviation of the residuals.
    free : (p,) array
        Which parameters were fitted; the others have no variance.

    Returns
    -------
    Certainty
        Columns and directions that count as nothing lower the rank, and keep the variance that
        they have before there are points. The condition is that of the other columns.
    """
    columns = jacobian[:, free]
    length = np.sqrt(np.einsum("np,np->p", columns, columns))
    kept = length > NEGLIGIBLE * length.max()
    singular = np.linalg.svd(columns[:, kept] / length[kept], compute_uv=False)
    rank = int((singular > NEGLIGIBLE * singular[0]).sum())
    condition = float(singular[0] / max(singular[-1], NEGLIGIBLE**2 * singular[0]))
    # By the triangle of Jacobian and prior together: no square of either is formed.
    noise = max(noise, NEGLIGIBLE**2)
    prior = noise / PRIOR * np.eye(len(length))
    triangle = np.linalg.qr(np.concatenate([columns, prior]), mode="r")
    root = np.linalg.solve(triangle, noise * np.eye(len(length)))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = root @ root.T
    return Certainty(covariance, rank, condition)
