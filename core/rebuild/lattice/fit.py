"""A control lattice around a prism, such that the prism's side becomes a given side.

Along the axis the lattice has the side's own knots, so that only sections are solved for: all
layers at once, by one small system. Heights are the same all over a layer, so that the change of
volume is the change of area within a layer times the rise from layer to layer. Refinement moves
control points, and changes weights, until the side passes given points: of all changes that do it
the least one is taken (Hsu, Hughes and Kaufman, 1992), so that only control points change that have
a share in the points, and the solid stays as it is elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core import splines
from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.lattice.section import (
    Layers,
    Section,
    SectionFill,
    SectionSystem,
    fit_section,
    layers_of,
    section_matrix,
    section_system,
    solve_section,
)
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.side import SidePatch
from palpate.reprs import readable

SIDES = (7, 9, 11, 13, 17, 21)  # Control points across a section each way that are tried
FILLS: tuple[SectionFill, ...] = ("bending", "rings", "cones")
FURTHER = 1  # How many larger sides are tried once the skin is met, if the inside folds
PRECISE, POOR = 1e-5, 1e-3  # Of the size: a misfit that matters to nobody, and one that always
TURNS_EACH = 2  # Places around for each coefficient of the skin
LEAST_TURNS = 96
BLOCK = 4096  # Turns for which columns of layers are laid out at a time
_CHOOSE = ((1, 0, 0), (1, 1, 0), (1, 2, 1))
RADII, TURNS, LAYERS = 7, 24, 3  # Places where folds are looked for: across, and by layer
# Of refinement.
STEPS = 16  # Steps at most
# Damping of a step, over the mean weight of the points: each leaves a tenth of what is left of one
# that stands alone, and takes up little of what neighbours contradict each other by.
CAREFUL = 0.1
GAIN = 0.9  # A step that leaves more of the distances is the last: points contradict each other
ENOUGH = 1e-10  # Of the size: what the points are passed to
PLACE_STEPS = 3  # Steps towards the nearest places, after each change
WIDEST = 0.05  # Of the side, along and around: the widest of those steps
MOST_WEIGHT = 0.5  # Largest change of a weight's logarithm in a step
EXACT = 1e-14  # Relative residual at which the least change is taken as found


class LatticeHealth(NamedTuple):
    """Figures of the fit."""

    rms: float  # Root mean square distance of the deformed side from the skin, across it, m
    most: float  # The largest one, m
    condition: float  # Estimated condition number of the section's system
    folded: float  # Share of the prism that is turned inside out
    fill: SectionFill  # What settled the inside of the sections


class Refinement(NamedTuple):
    """How a lattice was changed so that its side passes further points; lengths in m."""

    points: int  # Points that it was to pass
    beyond: int  # Further ones, nearest to an end of the solid, which no control point moves
    before: float  # Root mean square distance of the points from the side, m
    after: float  # The same afterwards
    most: float  # The largest distance afterwards, m
    moved: float  # The farthest that a control point was moved, m
    folded: float  # Share of the prism that is turned inside out since
    steps: int  # Steps taken


@readable
@dataclass(frozen=True, slots=True, eq=False)
class LatticeFit:
    """A solved lattice."""

    lattice: splines.Lattice  # Control points, and the box that they deform
    section: Section  # Of the undeformed prism
    health: LatticeHealth  # How the fit came about
    refinement: Refinement | None = None  # What was changed of it afterwards

    @property
    def side(self) -> LatticeSide:
        """The deformed prism's side."""
        return LatticeSide(self.section, self.lattice.volume)

    @property
    def prism(self) -> splines.Parallelepiped:
        """The box around the undeformed prism."""
        frame = self.lattice.undeformed
        assert isinstance(frame, splines.Parallelepiped)
        return frame

    def folds(self) -> splines.FoldReport:
        """Whether anything in the whole box folds, proved where that can be; some seconds."""
        return splines.fold_report(self.lattice)


def fit_lattice(
    patch: SidePatch,
    tolerance: float = 0.0,
    *,
    size: tuple[int, int] | None = None,
    grasp: Recovery | None = None,
) -> LatticeFit:
    """Solve for the lattice that makes of a prism's side another.

    `tolerance` is a misfit, m, that is small against what is known of it. `size` is the number
    of control points across a section each way, and of layers: otherwise the fewest with which the
    patch is met to within the tolerance, and its own layers. `grasp` is a
    superquadric whose section the prism shall have, otherwise the one that the patch's sections
    resemble. Raises ValueError if a number of control points is less than 4.

    Fung, 1999, (4.25), for the displacement from the undeformed lattice: the system of the control
    points themselves is singular, since a rim cannot see a whole section.
    """
    if size is not None and min(size) <= splines.CUBIC:
        raise ValueError(f"size must be at least {splines.CUBIC + 1} each way, got {size}")
    layers = layers_of(patch, None if size is None else size[1])
    count = max(LEAST_TURNS, TURNS_EACH * layers.curves.shape[1])
    turns = np.arange(count) / count
    around = splines.PeriodicBasis(layers.curves.shape[1])
    curves = np.matmul(around.matrix(turns).toarray(), layers.curves)
    section = fit_section(curves, grasp)
    half = float(section.half_extent.max())
    enough = float(np.clip(tolerance, PRECISE * half, POOR * half))
    check = _Check(patch, section, layers, turns, curves)
    best = _best(check, SIDES if size is None else (size[0],), enough)
    side = best.control.shape[0]
    bases = splines.clamped_basis(side), splines.clamped_basis(side), layers.basis
    volume = splines.SplineVolume(best.control, bases)
    lattice = splines.Lattice(volume, section.frame(*layers.heights[[0, -1]]))
    return LatticeFit(lattice, section, best.health)


def _best(check: _Check, sides: tuple[int, ...], enough: float) -> _Trial:
    """The smallest lattice that meets the patch and does not fold; else the nearest to that."""
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

    def demerit(trial: _Trial) -> tuple[float, float, float]:
        """Less is better: near enough first, then without folds, then nearer."""
        health = trial.health
        return max(health.rms / enough, 1.0), health.folded, health.rms

    best = min(trials, key=demerit)
    return best if best.health.folded < 1.0 else _looked_into(check, best)


def _tried(check: _Check, system: SectionSystem, fill: SectionFill) -> _Trial:
    side = system.basis.count
    flat, condition = solve_section(system, check.curves, fill)
    control = np.empty((side, side, len(check.curves), 3))
    control[..., :2], control[..., 2] = flat, check.layers.heights
    for layer, pinned in zip((0, -1), check.layers.pinned, strict=True):
        if pinned:
            control[:, :, layer, :2] = check.curves[layer, 0]
    off = _off(check, control)
    health = LatticeHealth(
        rms=float(np.sqrt(np.mean(np.square(off)))),
        most=float(np.abs(off).max()),
        condition=float(f"{condition:.2g}"),
        folded=1.0,  # until it is looked at
        fill=fill,
    )
    return _Trial(control, health)


def _off(check: _Check, control: Floats) -> Floats:
    """Distances across the sections between the deformed side and the patch, (n, k)."""
    side, layers = control.shape[0], check.layers
    seen = section_matrix(splines.clamped_basis(side), check.section.rim(check.turns))
    flat: Floats = seen @ control[..., :2].reshape(side**2, -1)
    reached = flat.reshape(len(check.turns), -1, 2).transpose(1, 0, 2)
    shares = layers.basis.greville()
    along = layers.basis.matrix(shares).toarray()
    wanted = check.patch.on_grid(shares, check.turns)[..., :2]
    slope = check.patch.on_grid(shares, check.turns, (0, 1))
    off = np.tensordot(along, reached, 1) - wanted
    length = np.hypot(slope[..., 0], slope[..., 1])
    across = off[..., 0] * slope[..., 1] - off[..., 1] * slope[..., 0]
    still = np.hypot(off[..., 0], off[..., 1])
    return np.asarray(np.divide(across, length, out=still, where=length > 0.0))


def _looked_into(check: _Check, trial: _Trial) -> _Trial:
    folded = folded_share(check.section, check.layers.basis, trial.control)
    return _Trial(trial.control, trial.health._replace(folded=folded))


def folded_share(section: Section, along: splines.Basis, control: Floats) -> float:
    """Share of a prism that is turned inside out, sampled; layers of control points are level."""
    basis = splines.clamped_basis(control.shape[0])
    places, weights = section.inside(RADII, TURNS)
    steps = LAYERS * along.count
    shares = (np.arange(steps) + 0.5) / steps
    layers = control[..., :2].reshape(basis.count**2, -1)
    slopes = []
    for orders in ((1, 0), (0, 1)):
        found = (section_matrix(basis, places, orders) @ layers).reshape(len(places), -1, 2)
        slopes.append(np.tensordot(along.matrix(shares).toarray(), found, (1, 1)))
    by_s, by_t = slopes
    change = by_s[..., 0] * by_t[..., 1] - by_s[..., 1] * by_t[..., 0]
    rise = along.matrix(shares, 1) @ control[0, 0, :, 2]
    folded = (change * rise[:, None] <= 0.0).mean(axis=0)
    return float(weights @ folded / weights.sum())


class _Trial(NamedTuple):
    control: Floats
    health: LatticeHealth


class _Check(NamedTuple):
    """What a trial is made of and judged by."""

    patch: SidePatch
    section: Section
    layers: Layers
    turns: Floats
    curves: Floats


@dataclass(frozen=True, slots=True, eq=False)
class LatticeSide:
    """What a prism's side becomes, from 0 at its lower end to 1 at its upper one."""

    section: Section  # Of the prism
    volume: splines.SplineVolume  # The deformed one

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), m, at shares v and turns (n,), or derivatives by them, together to 2."""
        v, turns = np.asarray(v, float), np.mod(np.asarray(turns, float), 1.0)
        return self._points(lambda order: self._sums(v, turns, order), by)

    def on_grid(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """The same at each pair of shares v (a,) and turns (b,): (a, b, 3), m."""
        around, along = np.mod(turns, 1.0).tobytes(), self.volume.bases[2]

        def sums(order: tuple[int, int]) -> Floats:
            found = along.matrix(v, order[0]) @ _layers(self, around, order[1])
            return np.asarray(found.reshape(len(v), len(turns), -1))

        return self._points(sums, by)

    def _points(self, sums: Callable[[tuple[int, int]], Floats], by: tuple[int, int]) -> Floats:
        """What sums of the functions make, which are divided where there are weights."""
        if self.volume.weights is None:
            return sums(by)
        orders = [(i, j) for i in range(by[0] + 1) for j in range(by[1] + 1)]
        return _quotients({order: sums(order) for order in orders})[by]

    def parameters(self, v: Floats, turns: Floats) -> Floats:
        """s, t and u (n, 3) of places of the side."""
        return np.column_stack([self.section.rim(np.asarray(turns)), v])

    def _sums(self, v: Floats, turns: Floats, by: tuple[int, int]) -> Floats:
        """Sums of the functions (n, 3), or with the weights' own (n, 4), or derivatives."""
        spline = self.volume.spline
        columns = spline.reshape(-1, spline.shape[2] * spline.shape[3])
        found = np.empty((len(v), spline.shape[3]))
        distinct, which = np.unique(turns, return_inverse=True)
        local = self.volume.bases[2].nonzero(v, by[0])
        layers, values = local.columns(), local.values[by[0]]
        for start in range(0, len(distinct), BLOCK):
            rows = (which >= start) & (which < start + BLOCK)
            part = slice(None) if rows.all() else np.flatnonzero(rows)
            across = self.across(distinct[start : start + BLOCK], by[1])
            along = (across @ columns).reshape(-1, spline.shape[2], spline.shape[3])
            near = along[(which[part] - start)[:, None], layers[part]]
            found[part] = np.einsum("nk,nkc->nc", values[part], near)
        return found

    def across(self, turns: Floats, derivative: int) -> scipy.sparse.csr_array:
        """Functions of the section along its rim, or a derivative by the turn, (n, side^2)."""
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


@lru_cache(maxsize=16)  # Both ends ask for the turns of the side
def _layers(side: LatticeSide, turns: bytes, derivative: int) -> Floats:
    """Each layer at each of the turns, one after the other, (layers, 3 or 4 times the turns)."""
    spline = side.volume.spline
    across = side.across(np.frombuffer(turns), derivative)
    layers = (across @ spline.reshape(-1, spline[0, 0].size)).reshape(-1, *spline.shape[2:])
    return np.ascontiguousarray(layers.transpose(1, 0, 2)).reshape(spline.shape[2], -1)


def _quotients(parts: dict[tuple[int, int], Floats]) -> dict[tuple[int, int], Floats]:
    """Points and derivatives (..., 3) of a quotient from its parts' (..., 4), lowest first."""
    found: dict[tuple[int, int], Floats] = {}
    weight = parts[0, 0][..., 3:]
    for (i, j), part in parts.items():
        rest = part[..., :3].copy()
        for (a, b), lower in found.items():
            if a <= i and b <= j:
                rest -= _CHOOSE[i][a] * _CHOOSE[j][b] * lower * parts[i - a, j - b][..., 3:]
        found[i, j] = rest / weight
    return found


class LatticeGrid(NamedTuple):
    """Everything that a lattice is, as arrays."""

    control: Floats  # Control points (l, m, n, 3) along s, t and u, in the unit of the contours
    undeformed: Floats  # Where they were, (l, m, n, 3)
    weights: Floats  # (l, m, n); all 1 without weights
    knots: tuple[Floats, Floats, Floats]  # Along s, t and u
    degrees: tuple[int, int, int]  # Along s, t and u


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


def refine_lattice(
    fit: LatticeFit,
    points: Floats,
    places: Floats,
    *,
    sigma: Floats | None = None,
    weights: bool = False,
) -> LatticeFit:
    """Change a lattice so that its side passes points (n, 3), m.

    `places` (n, 2) are where the side is nearest to them: from 0 to 1 along it, and the turn. With
    `sigma` (n,), the points' standard deviations, m, the side is drawn towards them only as far as
    those let it; else they are passed exactly. `weights` may change besides the control points.

    Gauss-Newton with damping: each change is the least one that brings the places where the side is
    nearest to the points nearer to them. Hsu, Hughes and Kaufman, *Direct manipulation of free-form
    deformations*, 1992, without damping; weights as further unknowns as Fung, 1999, 6.1, suggests.
    """
    trust = np.ones(len(points))
    if sigma is not None:
        trust = 1.0 / sigma
    if not len(points):
        return replace(fit, refinement=Refinement(0, 0, 0.0, 0.0, 0.0, 0.0, fit.health.folded, 0))
    size = float(np.linalg.norm(fit.prism.edges.sum(axis=0)))
    first = _distances(fit.side, points, places)
    if first.max() <= ENOUGH * size:
        return replace(fit, refinement=_report(fit, fit, first, first, 0))
    # How far control points move on average to move the places by 1 each, at random.
    shares = fit.lattice.volume.shares(fit.side.parameters(places[:, 0], places[:, 1]))
    looseness = float(np.sqrt(len(places) / np.square(shares.data).sum()))
    if sigma is None:
        damping = np.sqrt(CAREFUL) / looseness
    else:
        damping = 1.0 / (looseness * float(np.sqrt(np.mean(np.square(first)))))
    now, steps, last = fit, 0, first
    while steps < (STEPS if sigma is None else 1) and last.max() > ENOUGH * size:
        trial = _changed(now, *_least(now, points, places, trust, damping, weights))
        moved = _nearer(trial.side, points, places)
        left = _distances(trial.side, points, moved)
        gain = float(np.linalg.norm(left) / np.linalg.norm(last))
        if gain >= 1.0:
            break
        now, places, last, steps = trial, moved, left, steps + 1
        if gain > GAIN:
            break
    return replace(now, refinement=_report(fit, now, first, last, steps))


def _least(
    now: LatticeFit, points: Floats, places: Floats, trust: Floats, damping: float, weights: bool
) -> tuple[Floats, Floats]:
    """The least change of control points (n, 3), m, and of the logarithms of their weights (n,)."""
    volume = now.lattice.volume
    at = now.side.parameters(places[:, 0], places[:, 1])
    shares = (
        scipy.sparse.diags_array(trust)
        @ volume.shares(at)
        @ scipy.sparse.diags_array(_free(now).astype(float))
    )
    off = trust[:, None] * (points - volume.at(at))
    count = shares.shape[1]
    if not weights:
        found = [_solved(shares, off[:, axis], damping) for axis in range(3)]
        return np.column_stack(found), np.zeros(count)
    spacing = float(np.linalg.norm(now.prism.edges.sum(axis=0))) / len(now.lattice.control)
    blocks = []
    for axis in range(3):
        arm = shares.multiply(volume.control[..., axis].ravel() / spacing)
        arm = arm - scipy.sparse.diags_array(volume.at(at)[:, axis] / spacing) @ shares
        empty = scipy.sparse.csr_array(shares.shape)
        blocks.append(
            scipy.sparse.hstack([shares if a == axis else empty for a in range(3)] + [arm])
        )
    solved = _solved(scipy.sparse.csr_array(scipy.sparse.vstack(blocks)), off.T.ravel(), damping)
    turned = solved[3 * count :] / spacing
    short = min(1.0, MOST_WEIGHT / max(float(np.abs(turned).max()), MOST_WEIGHT))
    return short * solved[: 3 * count].reshape(3, count).T, short * turned


def _solved(rows: scipy.sparse.csr_array, wanted: Floats, damping: float) -> Floats:
    found: Floats = scipy.sparse.linalg.lsmr(
        rows, wanted, damp=damping, atol=EXACT, btol=EXACT, conlim=0.0, maxiter=4 * len(wanted) + 50
    )[0]
    return found


def _changed(fit: LatticeFit, moves: Floats, growths: Floats) -> LatticeFit:
    lattice, before = fit.lattice, fit.lattice.volume.weights
    control = lattice.control + moves.reshape(lattice.control.shape)
    if not growths.any():
        return replace(fit, lattice=lattice.with_control(control))
    weights = np.exp(growths).reshape(control.shape[:3])
    weights = weights if before is None else before * weights
    return replace(fit, lattice=lattice.with_control(control, weights))


def _nearer(side: LatticeSide, points: Floats, places: Floats) -> Floats:
    """Places (n, 2) of the side nearer to the points, by Gauss and Newton."""
    for _ in range(PLACE_STEPS):
        v, turns = places.T
        off = points - side.at(v, turns)
        slopes = np.stack([side.at(v, turns, by) for by in ((1, 0), (0, 1))], axis=-1)
        step = np.einsum("nij,nj->ni", np.linalg.pinv(slopes, rcond=1e-9), off)
        step = np.clip(step, -WIDEST, WIDEST)
        moved = np.column_stack([np.clip(v + step[:, 0], 0.0, 1.0), turns + step[:, 1]])
        nearer = _distances(side, points, moved) < np.linalg.norm(off, axis=1)
        places = np.where(nearer[:, None], moved, places)
    return places


def _free(fit: LatticeFit) -> Bools:
    """Control points (n,) that may move: a layer that is a point stays one."""
    control = fit.lattice.control
    free = np.ones(control.shape[:3], np.bool_)
    for layer in (0, -1):
        if not np.ptp(control[:, :, layer].reshape(-1, 3), axis=0).any():
            free[:, :, layer] = False
    return free.ravel()


def _distances(side: LatticeSide, points: Floats, places: Floats) -> Floats:
    return np.asarray(np.linalg.norm(points - side.at(places[:, 0], places[:, 1]), axis=1))


def _report(
    before: LatticeFit, after: LatticeFit, first: Floats, last: Floats, steps: int
) -> Refinement:
    moved = np.linalg.norm(after.lattice.control - before.lattice.control, axis=-1)
    places, weights = after.section.inside()  # In the whole prism: layers need not be level
    layers = after.lattice.volume.bases[2].count
    along = (np.arange(layers) + 0.5) / layers
    local = np.column_stack([np.repeat(places, layers, axis=0), np.tile(along, len(places))])
    folded = after.lattice.jacobian_determinant(after.prism.points(local)) <= 0.0
    return Refinement(
        points=len(first),
        beyond=0,
        before=float(np.sqrt(np.mean(np.square(first)))),
        after=float(np.sqrt(np.mean(np.square(last)))),
        most=float(last.max()),
        moved=float(moved.max()),
        folded=float(np.repeat(weights, layers) @ folded / (layers * weights.sum())),
        steps=steps,
    )
