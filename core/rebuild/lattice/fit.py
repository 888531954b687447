"""A control lattice around a prism that deforms the prism's side into a given side.

Along the axis the lattice has the side's own knots, so that only sections are solved for: all
layers at once, by one small system. The height is constant over a layer, so that the change of
volume is the change of area within a layer times the rise from layer to layer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core import splines
from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.section import (
    Layers,
    LayerSettings,
    Section,
    SectionFill,
    SectionSettings,
    SectionSystem,
    SystemSettings,
    fit_section,
    layers_of,
    section_matrix,
    section_system,
    solve_section,
)
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.side import SidePatch
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class LatticeSettings:
    """Sizes and fills of a lattice that are tried, and where it is tested for folds."""

    sides: tuple[int, ...] = (7, 9, 11, 13, 17, 21)  # control points across a section, each way
    fills: tuple[SectionFill, ...] = ("bending", "rings", "cones")  # of `SystemSettings`, in order
    n_larger: int = 1  # larger sides that are tried once the tolerance is met, if the inside folds
    min_tolerance: float = 1e-5  # fraction of the larger half extent of the section
    max_tolerance: float = 1e-3  # fraction of the larger half extent of the section
    turns_per_coefficient: int = 2  # places around for each coefficient of the side
    min_turns: int = 96
    n_fold_radii: int = 7  # places across a section that are tested for folds
    n_fold_turns: int = 24  # places around that are tested for folds
    n_fold_layers: int = 3  # heights for each layer that are tested for folds
    layers: LayerSettings = field(default_factory=LayerSettings)
    section: SectionSettings = field(default_factory=SectionSettings)
    system: SystemSettings = field(default_factory=SystemSettings)


class LatticeHealth(NamedTuple):
    """Figures of the fit."""

    rms: float  # root mean square distance of the deformed side from the skin, across it [m]
    most: float  # largest distance [m]
    condition: float  # estimated condition number of the section's system
    folded: float  # share of the prism that is turned inside out
    fill: SectionFill  # what determined the inside of the sections


class Refinement(NamedTuple):
    """How a lattice was changed so that its side passes further points."""

    points: int  # points that were to be passed
    beyond: int  # further points, nearest to an end of the solid, which no control point moves
    before: float  # root mean square distance of the points from the side [m]
    after: float  # root mean square distance afterwards [m]
    most: float  # largest distance afterwards [m]
    moved: float  # largest displacement of a control point [m]
    folded: float  # share of the prism that is turned inside out afterwards
    steps: int  # steps taken


@readable
@dataclass(frozen=True, slots=True, eq=False)
class LatticeFit:
    """A solved lattice."""

    lattice: splines.Lattice  # control points, and the box that they deform
    section: Section  # of the undeformed prism
    health: LatticeHealth  # figures of the fit
    refinement: Refinement | None = None  # how it was changed afterwards

    @property
    def side(self) -> LatticeSide:
        """The side of the deformed prism."""
        return LatticeSide(self.section, self.lattice.volume)

    @property
    def prism(self) -> splines.Parallelepiped:
        """The box around the undeformed prism."""
        frame = self.lattice.undeformed
        assert isinstance(frame, splines.Parallelepiped)
        return frame

    def folds(self) -> splines.FoldReport:
        """Whether any place in the whole box folds, proved where possible; takes some seconds."""
        return splines.fold_report(self.lattice)


def fit_lattice(
    patch: SidePatch,
    tolerance: float = 0.0,
    *,
    size: tuple[int, int] | None = None,
    grasp: Recovery | None = None,
    settings: LatticeSettings = LatticeSettings(),
) -> LatticeFit:
    """Solve for the lattice that deforms a prism's side into another side.

    `tolerance` [m] is a misfit that is small against the uncertainty of the side. `size` is the
    number of control points across a section each way, and of layers; if left out, the smallest
    number with which the misfit is within the tolerance, and the patch's own layers. `grasp` is a
    superquadric whose section the prism has; if left out, it is the superellipse that the patch's
    sections resemble. Raises ValueError if a number of control points is less than 4.

    Solves Fung, 1999, (4.25), for the displacement from the undeformed lattice: the system of the
    control points themselves is singular, since the rim does not determine a whole section.
    """
    if size is not None and min(size) <= splines.CUBIC:
        raise ValueError(f"size must be at least {splines.CUBIC + 1} each way, got {size}")
    layers = layers_of(patch, None if size is None else size[1], settings.layers)
    count = max(settings.min_turns, settings.turns_per_coefficient * layers.curves.shape[1])
    turns = np.arange(count) / count
    around = splines.PeriodicBasis(layers.curves.shape[1])
    curves = np.matmul(around.matrix(turns).toarray(), layers.curves)
    section = fit_section(curves, grasp, settings.section)
    half = float(section.half_extent.max())
    tolerance = float(
        np.clip(tolerance, settings.min_tolerance * half, settings.max_tolerance * half)
    )
    problem = _Problem(patch, section, layers, turns, curves, settings)
    best = _best(problem, settings.sides if size is None else (size[0],), tolerance)
    side = best.control.shape[0]
    bases = splines.clamped_basis(side), splines.clamped_basis(side), layers.basis
    volume = splines.SplineVolume(best.control, bases)
    lattice = splines.Lattice(volume, section.frame(*layers.heights[[0, -1]]))
    return LatticeFit(lattice, section, best.health)


def _best(problem: _Problem, sides: tuple[int, ...], tolerance: float) -> _Trial:
    """The smallest lattice within the tolerance that does not fold; else the nearest to that."""
    trials: list[_Trial] = []
    n_within = 0
    settings = problem.settings
    for side in sides:
        system = section_system(problem.section, problem.turns, side, settings.system)
        for fill in settings.fills:
            trial = _tried(problem, system, fill)
            is_within = trial.health.rms <= tolerance
            is_tested = is_within or side == sides[-1]
            trials.append(_with_folds(problem, trial) if is_tested else trial)
            if trials[-1].health.folded == 0.0 or not is_within:
                break
        n_within += is_within
        if n_within > settings.n_larger or (n_within and trials[-1].health.folded == 0.0):
            break

    def demerit(trial: _Trial) -> tuple[float, float, float]:
        """Less is better: first within the tolerance, then without folds, then nearer."""
        health = trial.health
        return max(health.rms / tolerance, 1.0), health.folded, health.rms

    best = min(trials, key=demerit)
    return best if best.health.folded < 1.0 else _with_folds(problem, best)


def _tried(problem: _Problem, system: SectionSystem, fill: SectionFill) -> _Trial:
    """A lattice with the fill, not yet tested for folds."""
    side = system.basis.count
    flat, condition = solve_section(system, problem.curves, fill)
    control = np.empty((side, side, len(problem.curves), 3))
    control[..., :2], control[..., 2] = flat, problem.layers.heights
    for layer, pinned in zip((0, -1), problem.layers.pinned, strict=True):
        if pinned:
            control[:, :, layer, :2] = problem.curves[layer, 0]
    off = _misfit(problem, control)
    health = LatticeHealth(
        rms=float(np.sqrt(np.mean(np.square(off)))),
        most=float(np.abs(off).max()),
        condition=float(f"{condition:.2g}"),
        folded=1.0,  # until it is tested
        fill=fill,
    )
    return _Trial(control, health)


def _misfit(problem: _Problem, control: Floats) -> Floats:
    """Distances (n, k) [m] across the sections between the deformed side and the patch."""
    side, layers = control.shape[0], problem.layers
    rim = section_matrix(splines.clamped_basis(side), problem.section.rim(problem.turns))
    flat: Floats = rim @ control[..., :2].reshape(side**2, -1)
    deformed = flat.reshape(len(problem.turns), -1, 2).transpose(1, 0, 2)
    shares = layers.basis.greville()
    along = layers.basis.matrix(shares).toarray()
    wanted = problem.patch.on_grid(shares, problem.turns)[..., :2]
    slope = problem.patch.on_grid(shares, problem.turns, (0, 1))
    off = np.tensordot(along, deformed, 1) - wanted
    length = np.hypot(slope[..., 0], slope[..., 1])
    across = off[..., 0] * slope[..., 1] - off[..., 1] * slope[..., 0]
    distance = np.hypot(off[..., 0], off[..., 1])  # at a point, which has no direction
    return np.asarray(np.divide(across, length, out=distance, where=length > 0.0))


def _with_folds(problem: _Problem, trial: _Trial) -> _Trial:
    """The trial with the share of its prism that folds."""
    section, basis = problem.section, problem.layers.basis
    folded = folded_share(section, basis, trial.control, problem.settings)
    return _Trial(trial.control, trial.health._replace(folded=folded))


def folded_share(
    section: Section, along: splines.Basis, control: Floats, settings: LatticeSettings
) -> float:
    """Share of a prism that is turned inside out, sampled; layers of control points are level."""
    basis = splines.clamped_basis(control.shape[0])
    places, weights = section.inside(settings.n_fold_radii, settings.n_fold_turns)
    steps = settings.n_fold_layers * along.count
    shares = (np.arange(steps) + 0.5) / steps
    layers = control[..., :2].reshape(basis.count**2, -1)
    slopes = []
    for orders in ((1, 0), (0, 1)):
        slope = (section_matrix(basis, places, orders) @ layers).reshape(len(places), -1, 2)
        slopes.append(np.tensordot(along.matrix(shares).toarray(), slope, (1, 1)))
    by_s, by_t = slopes
    change = by_s[..., 0] * by_t[..., 1] - by_s[..., 1] * by_t[..., 0]
    rise = along.matrix(shares, 1) @ control[0, 0, :, 2]
    folded = (change * rise[:, None] <= 0.0).mean(axis=0)
    return float(weights @ folded / weights.sum())


class _Trial(NamedTuple):
    control: Floats
    health: LatticeHealth


class _Problem(NamedTuple):
    """The side that a lattice has to meet, and the prism that it deforms."""

    patch: SidePatch
    section: Section
    layers: Layers
    turns: Floats  # (k,), even
    curves: Floats  # (l, k, 2) [m]: each layer's rim at these turns
    settings: LatticeSettings


@dataclass(frozen=True, slots=True, eq=False)
class LatticeSide:
    """The deformed side of a prism, from 0 at its lower end to 1 at its upper end."""

    section: Section  # of the prism
    volume: splines.SplineVolume  # the deformed one

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3) [m] at v and turns (n,), or derivatives by both, of total order up to 2."""
        v, turns = np.asarray(v, float), np.mod(np.asarray(turns, float), 1.0)
        return self._points(lambda order: self._sums(v, turns, order), by)

    def on_grid(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """The same at each pair of v (a,) and turns (b,): (a, b, 3) [m]."""
        around, along = np.mod(turns, 1.0).tobytes(), self.volume.bases[2]

        def sums(order: tuple[int, int]) -> Floats:
            points = along.matrix(v, order[0]) @ _layers(self, around, order[1])
            return np.asarray(points.reshape(len(v), len(turns), -1))

        return self._points(sums, by)

    def _points(self, sums: Callable[[tuple[int, int]], Floats], by: tuple[int, int]) -> Floats:
        """Points from sums of basis functions, which are quotients where there are weights."""
        if self.volume.weights is None:
            return sums(by)
        orders = [(i, j) for i in range(by[0] + 1) for j in range(by[1] + 1)]
        return _quotients({order: sums(order) for order in orders})[by]

    def parameters(self, v: Floats, turns: Floats) -> Floats:
        """Parameters s, t and u (n, 3) in the box of places of the side."""
        return np.column_stack([self.section.rim(np.asarray(turns)), v])

    def _sums(self, v: Floats, turns: Floats, by: tuple[int, int]) -> Floats:
        """Sums of basis functions (n, 3), or with weights (n, 4), or derivatives of these."""
        block = 4096  # turns at a time, which limits the memory
        spline = self.volume.spline
        columns = spline.reshape(-1, spline.shape[2] * spline.shape[3])
        sums = np.empty((len(v), spline.shape[3]))
        distinct, which = np.unique(turns, return_inverse=True)
        local = self.volume.bases[2].nonzero(v, by[0])
        layers, values = local.columns(), local.values[by[0]]
        for start in range(0, len(distinct), block):
            rows = (which >= start) & (which < start + block)
            part = slice(None) if rows.all() else np.flatnonzero(rows)
            across = self.across(distinct[start : start + block], by[1])
            along = (across @ columns).reshape(-1, spline.shape[2], spline.shape[3])
            near = along[(which[part] - start)[:, None], layers[part]]
            sums[part] = np.einsum("nk,nkc->nc", values[part], near)
        return sums

    def across(self, turns: Floats, derivative: int) -> scipy.sparse.csr_array:
        """Basis functions of the section along its rim, or a derivative by turn, (n, side^2)."""
        basis = self.volume.bases[0]
        rim = self.section.rim(turns)
        if derivative == 0:
            return section_matrix(basis, rim)
        speed = self.section.rim(turns, 1)
        terms = [((1, 0), speed[:, 0]), ((0, 1), speed[:, 1])]
        if derivative == 2:
            bend = self.section.rim(turns, 2)
            terms = [((1, 0), bend[:, 0]), ((0, 1), bend[:, 1])]
            terms += [((2, 0), speed[:, 0] ** 2), ((0, 2), speed[:, 1] ** 2)]
            terms += [((1, 1), 2.0 * speed[:, 0] * speed[:, 1])]
        rows = [
            scipy.sparse.diags_array(factor) @ section_matrix(basis, rim, by)
            for by, factor in terms
        ]
        return scipy.sparse.csr_array(sum(rows[1:], rows[0]))


@lru_cache(maxsize=16)  # both ends evaluate the side at the same turns
def _layers(side: LatticeSide, turns: bytes, derivative: int) -> Floats:
    """Layers of control points evaluated at the turns, (layers, 3 or 4 times the turns)."""
    spline = side.volume.spline
    across = side.across(np.frombuffer(turns), derivative)
    layers = (across @ spline.reshape(-1, spline[0, 0].size)).reshape(-1, *spline.shape[2:])
    return np.ascontiguousarray(layers.transpose(1, 0, 2)).reshape(spline.shape[2], -1)


def _quotients(parts: dict[tuple[int, int], Floats]) -> dict[tuple[int, int], Floats]:
    """Points and derivatives (..., 3) of a quotient from those of its parts (..., 4), by order."""
    quotients: dict[tuple[int, int], Floats] = {}
    weight = parts[0, 0][..., 3:]
    for (i, j), part in parts.items():
        rest = part[..., :3].copy()
        for (a, b), lower in quotients.items():
            if a <= i and b <= j:
                factor = math.comb(i, a) * math.comb(j, b)
                rest -= factor * lower * parts[i - a, j - b][..., 3:]
        quotients[i, j] = rest / weight
    return quotients


class LatticeGrid(NamedTuple):
    """A lattice as arrays."""

    control: Floats  # control points (l, m, n, 3) along s, t and u, in the unit of the contours
    undeformed: Floats  # their places before deformation, (l, m, n, 3)
    weights: Floats  # (l, m, n); all 1 without weights
    knots: tuple[Floats, Floats, Floats]  # along s, t and u
    degrees: tuple[int, int, int]  # along s, t and u


def lattice_grid(lattice: splines.Lattice) -> LatticeGrid:
    """The arrays of a lattice."""
    bases, before, weights = lattice.volume.bases, lattice.undeformed, lattice.volume.weights
    if isinstance(before, splines.Parallelepiped):
        undeformed = before.greville_control(bases)
    else:
        undeformed = before.control
    weights = np.ones(lattice.control.shape[:3]) if weights is None else weights
    s, t, u = bases
    knots, degrees = (s.knots, t.knots, u.knots), (s.degree, t.degree, u.degree)
    return LatticeGrid(lattice.control, undeformed, weights, knots, degrees)
