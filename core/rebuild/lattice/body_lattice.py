"""A control lattice around a whole superquadric, tapered and bent, that becomes a closed surface.

A prism can be solved for layer by layer, any other undeformed solid cannot: its points lie
anywhere in the lattice, and all control points are unknown at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.rebuild.lattice.sparse_solve import solve_sparse
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.surface.surface import Surface
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.frame import Frame
from palpate.core.splines.knots import CUBIC
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume

COUNTS = (9, 9, 17)
"""Control points along the superquadric's own axes."""
ROWS, COLUMNS = 64, 96
"""Places of the surface that are matched."""
MARGIN = 0.02
"""Of the extent: by how much the lattice is wider than the superquadric."""
INSIDE = np.linspace(0.05, 0.95, 7)
"""Shares of the way from the middle to the surface at which folds are looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyLattice:
    """A solved lattice."""

    lattice: Lattice
    """Control points, and the box that they deform."""
    points: Floats
    """Points of the undeformed superquadric, (n, 3), m."""
    targets: Floats
    """Places of the surface that they shall become, (n, 3), m."""
    rms: float
    """Root mean square distance between what they became and those, m."""
    condition: float
    """Estimated condition number of the system; 0 where it was not factored."""
    steps: int
    """Steps of the solver; 0 where the system was factored."""
    converged: bool
    """Whether they came to an end."""
    folded: float
    """Share of the superquadric that is turned inside out."""


def fit_body_lattice(
    prior: Recovery, surface: Surface, counts: tuple[int, int, int] = COUNTS
) -> BodyLattice:
    """Solve for the lattice in which a superquadric becomes a surface.

    Each place of the surface belongs to the point of the superquadric on the same ray from its
    middle, before taper and bend.

    Parameters
    ----------
    prior : Recovery
        The superquadric.
    surface : Surface
        What its surface shall become, m.
    counts : tuple of three integers
        Control points along the superquadric's own axes, at least 4 each.

    Raises
    ------
    ValueError
        If a count is less than 4, the superquadric was not fitted, or the surface passes through
        its middle.
    """
    if min(counts) <= CUBIC:
        raise ValueError(f"counts must be at least {CUBIC + 1} each, got {counts}")
    if not prior.fitted:
        raise ValueError(f"prior must be fitted, got {prior.doubts[0]}")
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
    frame = Frame(position + low @ axes.T, (high - low)[:, None] * axes.T)
    s, t, u = (clamped_basis(count) for count in counts)
    return Lattice(Volume(frame.greville_control((s, t, u)), (s, t, u)), frame)
