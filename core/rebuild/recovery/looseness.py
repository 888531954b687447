"""How far a fitted surface may be from the true one, as the scatter of its points alone explains.

The covariance says it of each parameter; parameters may be open and the surface yet be certain, as
the turn of a ball is. What no point has been near is another matter: see `cover`.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats

TAIL = 0.1
"""Probability that the scatter is larger than it is taken to be."""


def looseness(jacobian: Floats, covariance: Floats, exponents: Floats) -> float:
    """Standard deviation of a surface along its normals, root mean square over it.

    Parameters
    ----------
    jacobian : (k, p) array
        Derivatives of the distances of places spread evenly over the surface.
    covariance : (p, p) array
        Of the parameters: see `normal_distance.RIGID`.
    exponents : (2,) array
        What was fitted. To first order an exponent near 0 might be anything; here none is off by
        more than itself.
    """
    likely = np.ones(len(covariance))
    likely[3:5] = exponents / np.maximum(np.sqrt(np.diagonal(covariance)[3:5]), exponents)
    slopes = jacobian * likely
    return float(np.sqrt(np.einsum("kp,pq,kq->", slopes, covariance, slopes) / len(slopes)))


def caution(left: int) -> float:
    """Factor by which the scatter may be larger than it was found, with some points left over.

    `left` is by how many points there are more than parameters; none at all, and it was not found.
    """
    from scipy.special import chdtri

    return float(np.sqrt(left / chdtri(left, 1.0 - TAIL))) if left > 0 else 1.0
