"""A control lattice around a whole superquadric, tapered and bent, that becomes a closed surface.

A prism can be solved for layer by layer, any other undeformed solid cannot: its points lie
anywhere in the lattice, and all control points are unknown at once. Sparse, penalised least
squares: factored while few, else conjugate gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import cg, splu

from palpate.core.arrays import Floats
from palpate.core.poses import split_pose
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.surface import Surface
from palpate.core.shapes import Superquadric, Taper
from palpate.core.splines import CUBIC, Lattice, Parallelepiped, SplineVolume, clamped_basis

COUNTS = (9, 9, 17)  # Control points along the superquadric's own axes
ROWS, COLUMNS = 64, 96  # Places of the surface that are matched
MARGIN = 0.02  # Of the extent: by how much the lattice is wider than the superquadric
# Shares of the way from the middle to the surface at which folds are looked for.
INSIDE = np.linspace(0.05, 0.95, 7)
DIRECT = 3000  # Control points up to which the system is factored; more are solved for step by step
STIFFNESS = 1e-3  # Of squared second differences, over the mean weight of the points
HELD = 1e-6  # Of the displacements themselves: bounds the condition
# Relative residual at which the steps end: by then the points lie as near as they get, and only
# control points that they hardly see still move.
ENOUGH = 1e-5
MOST_STEPS = 2000
SYMMETRIC = {"SymmetricMode": True}
POWERS = 12  # Steps of the power method for the largest and the least eigenvalue


@dataclass(frozen=True, slots=True, eq=False)
class BodyLattice:
    """A solved lattice."""

    lattice: Lattice  # Control points, and the box that they deform
    points: Floats  # Points of the undeformed superquadric, (n, 3), m
    targets: Floats  # Places of the surface that they shall become, (n, 3), m
    rms: float  # Root mean square distance between what they became and those, m
    condition: float  # Estimated condition number of the system; 0 where it was not factored
    steps: int  # Steps of the solver; 0 where the system was factored
    converged: bool  # Whether they came to an end
    folded: float  # Share of the superquadric that is turned inside out


def fit_body_lattice(
    prior: Recovery, surface: Surface, counts: tuple[int, int, int] = COUNTS
) -> BodyLattice:
    """Solve for the lattice in which a superquadric becomes a surface.

    Each place of the surface belongs to the point of the superquadric on the same ray from its
    middle, before taper and bend. `counts` are control points along the superquadric's own axes.

    Raises
    ------
    ValueError
        If a count is less than 4, the superquadric was not fitted, or the surface passes through
        its middle.
    """
    if min(counts) <= CUBIC:
        raise ValueError(f"counts must be at least {CUBIC + 1} each, got {counts}")
    if not prior.fitted:
        raise ValueError(f"prior must be fitted, got {prior.warnings[0]}")
    v = (np.arange(ROWS) + 0.5) / ROWS
    turns = np.arange(COLUMNS) / COLUMNS
    targets = surface.at(v[:, None], turns).reshape(-1, 3)
    straight = _straightened(prior, targets)
    gauge = Superquadric(prior.size, prior.exponents).gauge(straight)
    if not (gauge > 0.0).all():
        raise ValueError("surface must not pass through the middle of the prior")
    onto = straight / gauge[:, None]
    points = _warped(prior, onto)
    lattice = _undeformed(prior, points, counts)
    shares = lattice.volume.shares(lattice.local(points))
    solved = solve_sparse(shares, targets - points, counts)
    deformed = lattice.with_control(lattice.control + solved.moved.reshape(*counts, 3))
    off = deformed.deform(points) - targets
    inner = np.concatenate([_warped(prior, share * onto[::7]) for share in INSIDE])
    volume = np.repeat(INSIDE**2, len(onto[::7]))
    folded = deformed.jacobian_determinant(inner) <= 0.0
    return BodyLattice(
        lattice=deformed,
        points=points,
        targets=targets,
        rms=float(np.sqrt(np.mean(np.sum(np.square(off), axis=1)))),
        condition=solved.condition,
        steps=solved.steps,
        converged=solved.converged,
        folded=float(volume @ folded / volume.sum()),
    )


def _straightened(prior: Recovery, points: Floats) -> Floats:
    """Points (n, 3) in the superquadric's own axes, before it was tapered and bent."""
    position, axes = split_pose(prior.pose)
    return _taper(prior).inverse(prior.bend.inverse((points - position) @ axes))


def _warped(prior: Recovery, points: Floats) -> Floats:
    position, axes = split_pose(prior.pose)
    return np.asarray(prior.bend(_taper(prior)(points)) @ axes.T + position)


def _taper(prior: Recovery) -> Taper:
    return Taper(float(prior.taper[0]), float(prior.taper[1]), float(prior.size[2]))


def _undeformed(prior: Recovery, points: Floats, counts: tuple[int, int, int]) -> Lattice:
    """An undeformed lattice along the superquadric's axes, around points (n, 3)."""
    position, axes = split_pose(prior.pose)
    local = (points - position) @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    low, high = low - MARGIN * (high - low), high + MARGIN * (high - low)
    frame = Parallelepiped(position + low @ axes.T, (high - low)[:, None] * axes.T)
    s, t, u = (clamped_basis(count) for count in counts)
    return Lattice(SplineVolume(frame.greville_control((s, t, u)), (s, t, u)), frame)


def solve_sparse(shares: csr_array, moves: Floats, counts: tuple[int, int, int]) -> SparseSolved:
    """Displacements of control points (n, 3) that move points by `moves` (m, 3), m.

    Parameters
    ----------
    shares : sparse (m, n) array
        Share of each control point in each point.
    moves : (m, 3) array
        How the points shall move, m.
    counts : tuple of three integers
        Control points each way.

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
        factor = splu(csc_array(system), permc_spec="MMD_AT_PLUS_A", options=SYMMETRIC)
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
                rows = csr_array(np.diff(np.eye(count), order, axis=0))
                parts.append(rows.T @ rows)
            form = kron(kron(parts[0], parts[1]), parts[2])
            energy = csr_array(energy + (1.0 if i == j else 2.0) * csr_array(form))
    return energy


def _largest(times: Callable[[Floats], Floats], count: int) -> float:
    """Largest eigenvalue of a positive definite matrix, by the power method."""
    vector = 1.0 + np.cos(np.arange(count))
    for _ in range(POWERS):
        vector = times(vector / np.linalg.norm(vector))
    return float(np.linalg.norm(vector))


def _stepwise(system: csr_array, right: Floats) -> SparseSolved:
    over_diagonal = diags_array(1.0 / system.diagonal())
    steps = 0

    def counted(_: Floats) -> None:
        nonlocal steps
        steps += 1

    def solved(wanted: Floats) -> tuple[Floats, int]:
        return cg(
            system, wanted, rtol=ENOUGH, maxiter=MOST_STEPS, M=over_diagonal, callback=counted
        )

    found = [solved(right[:, axis]) for axis in range(3)]
    converged = all(left == 0 for _, left in found)
    return SparseSolved(np.column_stack([one for one, _ in found]), 0.0, steps, converged)


class SparseSolved(NamedTuple):
    """Displacements (n, 3) of control points, m; the rest as in `BodyLattice`."""

    moved: Floats
    condition: float
    steps: int
    converged: bool
