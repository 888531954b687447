"""Refinement of a control lattice: its side is drawn onto further points.

Control points move, and weights change, until the side passes the points. Of all changes that do so
the least one is taken, so that only control points near the points move, and the solid stays as it
is elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.lattice.fit import LatticeFit, LatticeSide, Refinement


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinementSettings:
    """When refinement ends, and how far a step goes."""

    max_steps: int = 16  # without standard deviations of the points; with them a single step
    # Relative to the mean weight of the points: a step leaves a tenth of the distance of an
    # isolated point, and follows contradictory neighbours little.
    damping: float = 0.1
    max_remaining: float = 0.9  # fraction of the distances: a step that leaves more is the last
    tolerance: float = 1e-10  # largest distance of passed points, fraction of the box's diagonal
    n_place_steps: int = 3  # towards the nearest places of the side, after each step
    max_place_step: float = 0.05  # fraction of the side, along and around
    max_log_weight_step: float = 0.5  # largest change of the logarithm of a weight
    solver_tolerance: float = 1e-14  # relative residual of the least change


def refine_lattice(
    fit: LatticeFit,
    points: Floats,
    places: Floats,
    *,
    sigma: Floats | None = None,
    weights: bool = False,
    settings: RefinementSettings = RefinementSettings(),
) -> LatticeFit:
    """Change a lattice so that its side passes points (n, 3) [m].

    `places` (n, 2) are the places of the side nearest to them: from 0 to 1 along it, and the turn.
    With standard deviations `sigma` (n,) [m] of the points, the side is drawn towards them only as
    far as these allow; else it passes them exactly. `weights`: whether weights of control points
    change, too.

    Damped Gauss-Newton: each step is the least change that moves the nearest places of the side
    towards the points. Hsu, Hughes and Kaufman, *Direct manipulation of free-form deformations*,
    1992, have no damping; weights as unknowns follow a suggestion of Fung, 1999, 6.1.
    """
    confidence = np.ones(len(points)) if sigma is None else 1.0 / sigma
    if not len(points):
        return replace(fit, refinement=Refinement(0, 0, 0.0, 0.0, 0.0, 0.0, fit.health.folded, 0))
    size = float(np.linalg.norm(fit.prism.edges.sum(axis=0)))
    first = _distances(fit.side, points, places)
    enough = settings.tolerance * size
    if first.max() <= enough:
        return replace(fit, refinement=_report(fit, fit, first, first, 0))
    damping = _damping(fit, places, sigma is None, first, settings)
    now, steps, last = fit, 0, first
    while steps < (settings.max_steps if sigma is None else 1) and last.max() > enough:
        step = _least_change(now, points, places, confidence, damping, weights, settings)
        trial = _changed(now, *step)
        moved = _nearer_places(trial.side, points, places, settings)
        left = _distances(trial.side, points, moved)
        remaining = float(np.linalg.norm(left) / np.linalg.norm(last))
        if remaining >= 1.0:
            break
        now, places, last, steps = trial, moved, left, steps + 1
        if remaining > settings.max_remaining:
            break
    return replace(now, refinement=_report(fit, now, first, last, steps))


def _damping(
    fit: LatticeFit, places: Floats, exact: bool, distances: Floats, settings: RefinementSettings
) -> float:
    """Damping of a step, in the unit of the points' confidence."""
    shares = fit.lattice.volume.shares(fit.side.parameters(places[:, 0], places[:, 1]))
    # Mean displacement of control points that moves each of the places by 1, in random directions.
    looseness = float(np.sqrt(len(places) / np.square(shares.data).sum()))
    if exact:
        return float(np.sqrt(settings.damping)) / looseness
    return 1.0 / (looseness * float(np.sqrt(np.mean(np.square(distances)))))


def _least_change(
    fit: LatticeFit,
    points: Floats,
    places: Floats,
    confidence: Floats,
    damping: float,
    weights: bool,
    settings: RefinementSettings,
) -> tuple[Floats, Floats]:
    """The least change of control points (n, 3) [m] and of the logarithms of their weights (n,)."""
    volume = fit.lattice.volume
    at = fit.side.parameters(places[:, 0], places[:, 1])
    shares = (
        scipy.sparse.diags_array(confidence)
        @ volume.shares(at)
        @ scipy.sparse.diags_array(_free(fit).astype(float))
    )
    off = confidence[:, None] * (points - volume.at(at))
    count, tolerance = shares.shape[1], settings.solver_tolerance
    if not weights:
        moves = [_solved(shares, off[:, axis], damping, tolerance) for axis in range(3)]
        return np.column_stack(moves), np.zeros(count)
    spacing = float(np.linalg.norm(fit.prism.edges.sum(axis=0))) / len(fit.lattice.control)
    blocks = []
    for axis in range(3):
        arm = shares.multiply(volume.control[..., axis].ravel() / spacing)
        arm = arm - scipy.sparse.diags_array(volume.at(at)[:, axis] / spacing) @ shares
        empty = scipy.sparse.csr_array(shares.shape)
        blocks.append(
            scipy.sparse.hstack([shares if a == axis else empty for a in range(3)] + [arm])
        )
    rows = scipy.sparse.csr_array(scipy.sparse.vstack(blocks))
    solved = _solved(rows, off.T.ravel(), damping, tolerance)
    growths, most = solved[3 * count :] / spacing, settings.max_log_weight_step
    short = min(1.0, most / max(float(np.abs(growths).max()), most))
    return short * solved[: 3 * count].reshape(3, count).T, short * growths


def _solved(
    rows: scipy.sparse.csr_array, wanted: Floats, damping: float, tolerance: float
) -> Floats:
    """Damped least squares of sparse rows."""
    solution: Floats = scipy.sparse.linalg.lsmr(
        rows,
        wanted,
        damp=damping,
        atol=tolerance,
        btol=tolerance,
        conlim=0.0,
        maxiter=4 * len(wanted) + 50,
    )[0]
    return solution


def _changed(fit: LatticeFit, moves: Floats, growths: Floats) -> LatticeFit:
    """The fit with moved control points, and weights times the exponentials of `growths`."""
    lattice, before = fit.lattice, fit.lattice.volume.weights
    control = lattice.control + moves.reshape(lattice.control.shape)
    if not growths.any():
        return replace(fit, lattice=lattice.with_control(control))
    weights = np.exp(growths).reshape(control.shape[:3])
    weights = weights if before is None else before * weights
    return replace(fit, lattice=lattice.with_control(control, weights))


def _nearer_places(
    side: LatticeSide, points: Floats, places: Floats, settings: RefinementSettings
) -> Floats:
    """Places (n, 2) of the side nearer to the points, by Gauss-Newton steps."""
    for _ in range(settings.n_place_steps):
        v, turns = places.T
        off = points - side.at(v, turns)
        slopes = np.stack([side.at(v, turns, by) for by in ((1, 0), (0, 1))], axis=-1)
        step = np.einsum("nij,nj->ni", np.linalg.pinv(slopes, rcond=1e-9), off)
        step = np.clip(step, -settings.max_place_step, settings.max_place_step)
        moved = np.column_stack([np.clip(v + step[:, 0], 0.0, 1.0), turns + step[:, 1]])
        nearer = _distances(side, points, moved) < np.linalg.norm(off, axis=1)
        places = np.where(nearer[:, None], moved, places)
    return places


def _free(fit: LatticeFit) -> Bools:
    """Control points (n,) that may move: all but those of a layer that is a point."""
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
    places, weights = after.section.inside()
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
