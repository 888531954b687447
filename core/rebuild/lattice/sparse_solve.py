"""Control points from points that lie anywhere in a lattice: sparse, penalised least squares."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import cg, splu

from palpate.core.arrays import Floats

DIRECT = 3000
"""Control points up to which the system is factored; more are solved for step by step."""
STIFFNESS = 1e-3
"""Of squared second differences, over the mean weight of the points."""
HELD = 1e-6
"""Of the displacements themselves: bounds the condition."""
ENOUGH = 1e-5
"""Relative residual at which the steps end: by then the points lie as near as they get, and only
control points that they hardly see still move."""
MOST_STEPS = 2000
SYMMETRIC = {"SymmetricMode": True}
POWERS = 12
"""Steps of the power method for the largest and the least eigenvalue."""


class SparseSolved(NamedTuple):
    """Displacements of control points."""

    moved: Floats
    """(n, 3), m."""
    condition: float
    """Estimated condition number of the system; 0 where it was not factored."""
    steps: int
    """Steps taken; 0 where the system was factored."""
    converged: bool
    """Whether the steps came to an end."""


def solve_sparse(shares: csr_array, moves: Floats, counts: tuple[int, int, int]) -> SparseSolved:
    """Displacements of control points that move points as they shall.

    Parameters
    ----------
    shares : sparse (m, n) array
        Share of each control point in each point.
    moves : (m, 3) array
        How the points shall move, m.
    counts : tuple of three integers
        Control points each way, n in all.

    Notes
    -----
    Beyond some thousand control points conjugate gradients over the diagonal. The same energy on
    the whole box, which cosines make diagonal, was no better: points see but a shell of it.
    """
    form = csr_array(shares.T @ shares)
    mean = float(form.diagonal().mean())
    energy = second_differences(counts)
    energy.data /= float(energy.diagonal().mean())
    system = form / mean + STIFFNESS * energy + HELD * eye_array(form.shape[0])
    right = (shares.T @ moves) / mean
    if form.shape[0] <= DIRECT:
        factor = splu(
            csc_array(system), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )
        largest = _largest(lambda x: system @ x, form.shape[0])
        least = 1.0 / _largest(factor.solve, form.shape[0])
        return SparseSolved(factor.solve(right), float(f"{largest / least:.2g}"), 0, True)
    return _stepwise(csr_array(system), right)


def second_differences(counts: tuple[int, int, int]) -> csr_array:
    """Quadratic form of squared second differences of a lattice, the mixed ones twice."""
    energy = csr_array((int(np.prod(counts)),) * 2)
    for i in range(3):
        for j in range(i, 3):
            parts = []
            for axis, count in enumerate(counts):
                order = (axis == i) + (axis == j)
                rows = _difference(count, order)
                parts.append(rows.T @ rows)
            form = kron(kron(parts[0], parts[1]), parts[2])
            energy = csr_array(energy + (1.0 if i == j else 2.0) * csr_array(form))
    return energy


def _difference(count: int, order: int) -> csr_array:
    """Matrix (count - order, count) of differences of an order."""
    return csr_array(np.diff(np.eye(count), order, axis=0))


def _stepwise(system: csr_array, right: Floats) -> SparseSolved:
    over_diagonal = diags_array(1.0 / system.diagonal())
    steps = 0

    def counted(_: Floats) -> None:
        nonlocal steps
        steps += 1

    found, ended = [], []
    for axis in range(3):
        solution, left = cg(
            system,
            right[:, axis],
            rtol=ENOUGH,
            maxiter=MOST_STEPS,
            M=over_diagonal,
            callback=counted,
        )
        found.append(solution)
        ended.append(left == 0)
    return SparseSolved(np.column_stack(found), 0.0, steps, all(ended))


def _largest(times: Callable[[Floats], Floats], count: int) -> float:
    """Largest eigenvalue of a positive definite matrix, by the power method."""
    vector = 1.0 + np.cos(np.arange(count))
    length = 1.0
    for _ in range(POWERS):
        vector = vector / np.linalg.norm(vector)
        vector = times(vector)
        length = float(np.linalg.norm(vector))
    return length
