"""The upright box about an intersection of half-spaces."""

from __future__ import annotations

import itertools

import numpy as np

from palpate.core.arrays import Floats, Ints

PARALLEL = 1e-9
"""Three unit normals span less than this volume: they meet in no point."""
ROUNDING = 1e-9
"""A weight this far below 0 is 0."""


def polytope_box(normals: Floats, offsets: Floats) -> Floats:
    """Smallest upright box about the points p with normals p <= offsets.

    Parameters
    ----------
    normals : (n, 3) array
        Outward normals of any length.
    offsets : (n,) array
        Their bounds.

    Returns
    -------
    (2, 3) array
        Smallest and largest coordinates, infinite where there is no bound.

    Notes
    -----
    By the duality of linear programming, the largest coordinate is the least bound that any
    three of the half-spaces, or fewer, give together: a combination of their normals with
    weights that are not negative is the axis, and that of their offsets is the bound.
    """
    length = np.linalg.norm(normals, axis=1)
    normals, offsets = normals / length[:, None], offsets / length
    axes = np.concatenate([-np.eye(3), np.eye(3)])
    reach = np.full(6, np.inf)
    for size in (1, 2, 3):
        if len(normals) >= size:
            reach = np.minimum(reach, _bounds(normals, offsets, axes, size))
    return np.stack([-reach[:3], reach[3:]])


def _bounds(normals: Floats, offsets: Floats, axes: Floats, size: int) -> Floats:
    """Least bound in each direction that any `size` half-spaces give together, (6,)."""
    chosen = _choices(len(normals), size)
    some = normals[chosen]  # (m, size, 3)
    gram = some @ some.transpose(0, 2, 1)
    apart = np.linalg.det(gram) > PARALLEL**2
    some, chosen, gram = some[apart], chosen[apart], gram[apart]
    weights = np.linalg.solve(gram, some @ axes.T)  # (m, size, 6)
    reached = np.abs(some.transpose(0, 2, 1) @ weights - axes.T).max(axis=1) < ROUNDING
    holds = reached & (weights >= -ROUNDING).all(axis=1)
    bound = np.einsum("ms,msa->ma", offsets[chosen], np.maximum(weights, 0.0))
    result: Floats = np.where(holds, bound, np.inf).min(axis=0, initial=np.inf)
    return result


def _choices(count: int, size: int) -> Ints:
    return np.array(list(itertools.combinations(range(count), size)), np.int32)
