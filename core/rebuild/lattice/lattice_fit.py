"""A control lattice around a prism, such that the prism's side becomes a given skin.

Along the axis the lattice has the skin's own knots, so that only sections are solved for: all
layers at once, by one small system.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.folds_inside import folded_share
from palpate.core.rebuild.lattice.lattice_side import LatticeSide
from palpate.core.rebuild.lattice.layers import Layers, layers_of
from palpate.core.rebuild.lattice.section import Section
from palpate.core.rebuild.lattice.section_basis import section_matrix
from palpate.core.rebuild.lattice.section_fit import fit_section
from palpate.core.rebuild.lattice.section_solve import (
    Fill,
    System,
    section_system,
    solve_section,
)
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.skin.contour_surface import ContourSurface
from palpate.core.splines.basis import PeriodicBasis, clamped_basis
from palpate.core.splines.folds import FoldReport, fold_report
from palpate.core.splines.frame import Frame
from palpate.core.splines.knots import CUBIC
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume

SIDES = (7, 9, 11, 13, 17, 21)
"""Control points across a section each way that are tried."""
FILLS: tuple[Fill, ...] = ("bending", "rings", "cones")
FURTHER = 1
"""How many larger sides are tried once the skin is met, if the inside folds."""
PRECISE, POOR = 1e-5, 1e-3
"""Of the size: a misfit that matters to nobody, and one that does however little is known."""
TURNS_EACH = 2
"""Places around for each coefficient of the skin."""
LEAST_TURNS = 96


class LatticeHealth(NamedTuple):
    """Figures of the fit."""

    rms: float
    """Root mean square distance of the deformed side from the skin, across it, m."""
    most: float
    """The largest one, m."""
    condition: float
    """Estimated condition number of the section's system."""
    folded: float
    """Share of the prism that is turned inside out."""
    fill: Fill
    """What settled the inside of the sections."""


class Refinement(NamedTuple):
    """How a lattice was changed so that its side passes further points."""

    points: int
    """Points that it was to pass."""
    beyond: int
    """Further ones, nearest to an end of the solid, which no control point of the side moves."""
    before: float
    """Root mean square distance of the points from the side, m."""
    after: float
    """The same afterwards."""
    most: float
    """The largest distance afterwards, m."""
    moved: float
    """The farthest that a control point was moved, m."""
    folded: float
    """Share of the prism that is turned inside out since."""
    steps: int
    """Steps taken."""


@dataclass(frozen=True, slots=True, eq=False)
class LatticeFit:
    """A solved lattice."""

    lattice: Lattice
    """Control points, and the box that they deform."""
    section: Section
    """Of the undeformed prism."""
    health: LatticeHealth
    """How the fit came about."""
    refinement: Refinement | None = None
    """What was changed of it afterwards."""

    @property
    def side(self) -> LatticeSide:
        """The deformed prism's side."""
        return LatticeSide(self.section, self.lattice.volume)

    @property
    def prism(self) -> Frame:
        """The box around the undeformed prism."""
        frame = self.lattice.undeformed
        assert isinstance(frame, Frame)
        return frame

    def folds(self) -> FoldReport:
        """Whether anything in the whole box folds, proved where that can be; some seconds."""
        return fold_report(self.lattice)


class _Trial(NamedTuple):
    control: Floats
    health: LatticeHealth


def fit_lattice(
    surface: ContourSurface,
    tolerance: float = 0.0,
    *,
    size: tuple[int, int] | None = None,
    grasp: Recovery | None = None,
) -> LatticeFit:
    """Solve for the lattice.

    Parameters
    ----------
    surface : ContourSurface
        The skin.
    tolerance : float
        Misfit that is small against what is known of the skin, m.
    size : pair of int, optional
        Control points across a section each way, and layers. Otherwise the least side with which
        the skin is met to within the tolerance, and the skin's own layers.
    grasp : Recovery, optional
        Superquadric whose section the prism shall have; otherwise the one that the skin's own
        sections resemble.

    Raises
    ------
    ValueError
        If a number of control points is less than 4.

    Notes
    -----
    Fung, 1999, (4.25), for the displacement from the undeformed lattice: the system of the
    control points themselves is singular, since a rim cannot see a whole section.
    """
    if size is not None and min(size) <= CUBIC:
        raise ValueError(f"size must be at least {CUBIC + 1} each way, got {size}")
    layers = layers_of(surface, None if size is None else size[1])
    count = max(LEAST_TURNS, TURNS_EACH * layers.curves.shape[1])
    turns = np.arange(count) / count
    around = PeriodicBasis(layers.curves.shape[1])
    curves = _around(around.matrix(turns).toarray(), layers.curves)
    section = fit_section(curves, grasp)
    half = float(section.half_extent.max())
    enough = float(np.clip(tolerance, PRECISE * half, POOR * half))
    check = _Check(surface, section, layers, turns, curves)
    best = _best(check, SIDES if size is None else (size[0],), enough)
    side = best.control.shape[0]
    bases = clamped_basis(side), clamped_basis(side), layers.basis
    lattice = Lattice(Volume(best.control, bases), section.frame(*surface.reach))
    return LatticeFit(lattice, section, best.health)


class _Check(NamedTuple):
    """What a trial is made of and judged by."""

    surface: ContourSurface
    section: Section
    layers: Layers
    turns: Floats
    curves: Floats


def _best(check: _Check, sides: tuple[int, ...], enough: float) -> _Trial:
    """The smallest lattice that meets the skin and does not fold; else the nearest to that."""
    trials: list[_Trial] = []
    met = 0
    for side in sides:
        system = section_system(check.section, check.turns, side)
        for fill in FILLS:
            trial = _tried(check, system, fill)
            near = trial.health.rms <= enough
            trials.append(_looked_into(check, trial) if near or side == sides[-1] else trial)
            if trials[-1].health.folded == 0.0 or not near:
                break
        met += near
        if met > FURTHER or (met and trials[-1].health.folded == 0.0):
            break
    best = min(trials, key=lambda trial: _demerit(trial.health, enough))
    return best if best.health.folded < 1.0 else _looked_into(check, best)


def _looked_into(check: _Check, trial: _Trial) -> _Trial:
    folded = folded_share(check.section, check.layers.basis, trial.control)
    return _Trial(trial.control, trial.health._replace(folded=folded))


def _demerit(health: LatticeHealth, enough: float) -> tuple[float, float, float]:
    """Less is better: near enough first, then without folds, then nearer."""
    return max(health.rms / enough, 1.0), health.folded, health.rms


def _tried(check: _Check, system: System, fill: Fill) -> _Trial:
    side = system.basis.count
    solved = solve_section(system, check.curves, fill)
    control = np.empty((side, side, len(check.curves), 3))
    control[..., :2], control[..., 2] = solved.control, check.layers.heights
    for layer, pinned in zip((0, -1), check.layers.pinned, strict=True):
        if pinned:
            control[:, :, layer, :2] = check.curves[layer, 0]
    off = _off(check, control)
    health = LatticeHealth(
        rms=float(np.sqrt(np.mean(np.square(off)))),
        most=float(np.abs(off).max()),
        condition=float(f"{solved.condition:.2g}"),
        folded=1.0,  # until it is looked at
        fill=fill,
    )
    return _Trial(control, health)


def _off(check: _Check, control: Floats) -> Floats:
    """Distances across the sections between the deformed side and the skin, (n, k)."""
    side, layers = control.shape[0], check.layers
    seen = section_matrix(clamped_basis(side), check.section.rim(check.turns))
    flat: Floats = seen @ control[..., :2].reshape(side**2, -1)
    reached = flat.reshape(len(check.turns), -1, 2).transpose(1, 0, 2)
    shares = layers.basis.greville()
    along = layers.basis.matrix(shares).toarray()
    low, high = check.surface.along.domain
    latitudes = low + (high - low) * shares
    wanted = check.surface.on_grid(latitudes, check.turns)
    slope = check.surface.on_grid(latitudes, check.turns, (0, 1))
    off = np.tensordot(along, reached, 1) - wanted
    length = np.hypot(slope[..., 0], slope[..., 1])
    across = off[..., 0] * slope[..., 1] - off[..., 1] * slope[..., 0]
    still = np.hypot(off[..., 0], off[..., 1])
    return np.asarray(np.divide(across, length, out=still, where=length > 0.0))


def _around(matrix: Floats, curves: Floats) -> Floats:
    """Points (l, k, 2) of closed splines (l, c, 2), with the basis around (k, c)."""
    return np.asarray(np.matmul(matrix, curves))
