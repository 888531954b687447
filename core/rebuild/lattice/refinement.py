"""Refinement: control points are moved, and weights changed, until the side passes given points.

Of all changes that do it the least one is taken (Hsu, Hughes and Kaufman, 1992). So only control
points change that have a share in the points, and the solid stays as it is elsewhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, diags_array, hstack, vstack
from scipy.sparse.linalg import lsmr

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.rebuild.lattice.fit import LatticeFit, LatticeSide, Refinement

STEPS = 16  # Steps at most
# Damping of a step, over the mean weight of the points: each leaves a tenth of what is left of one
# that stands alone, and takes up little of what neighbours contradict each other by.
CAREFUL = 0.1
# A step that leaves more than this of the distances is the last: points contradict each other.
GAIN = 0.9
ENOUGH = 1e-10  # Of the size: what the points are passed to
PLACE_STEPS = 3  # Steps towards the nearest places, after each change
WIDEST = 0.05  # Of the side, along and around: the widest of those steps
MOST_WEIGHT = 0.5  # Largest change of a weight's logarithm in a step
EXACT = 1e-14  # Relative residual at which the least change is taken as found


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
    Raises ValueError if shapes do not fit, a number is not finite, or a standard deviation is not
    positive.

    Gauss-Newton with damping: each change is the least one that brings the places where the side is
    nearest to the points nearer to them. Hsu, Hughes and Kaufman, *Direct manipulation of free-form
    deformations*, 1992, without damping; weights as further unknowns as Fung, 1999, 6.1, suggests.
    """
    points = finite_array("points", points, (None, 3))
    places = finite_array("places", places, (len(points), 2))
    trust = np.ones(len(points))
    if sigma is not None:
        sigma = finite_array("sigma", sigma, (len(points),))
        if not (sigma > 0.0).all():
            raise ValueError(f"sigma must be positive, got {sigma.min():g} m")
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
    shares = diags_array(trust) @ volume.shares(at) @ diags_array(_free(now).astype(float))
    off = trust[:, None] * (points - volume.at(at))
    count = shares.shape[1]
    if not weights:
        found = [_solved(shares, off[:, axis], damping) for axis in range(3)]
        return np.column_stack(found), np.zeros(count)
    spacing = float(np.linalg.norm(now.prism.edges.sum(axis=0))) / len(now.lattice.control)
    blocks = []
    for axis in range(3):
        arm = shares.multiply(volume.control[..., axis].ravel() / spacing)
        arm = arm - diags_array(volume.at(at)[:, axis] / spacing) @ shares
        empty = csr_array(shares.shape)
        blocks.append(hstack([shares if a == axis else empty for a in range(3)] + [arm]))
    solved = _solved(csr_array(vstack(blocks)), off.T.ravel(), damping)
    turned = solved[3 * count :] / spacing
    short = min(1.0, MOST_WEIGHT / max(float(np.abs(turned).max()), MOST_WEIGHT))
    return short * solved[: 3 * count].reshape(3, count).T, short * turned


def _solved(rows: csr_array, wanted: Floats, damping: float) -> Floats:
    found: Floats = lsmr(
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
        points = control[:, :, layer].reshape(-1, 3)
        if not np.ptp(points, axis=0).any():
            free[:, :, layer] = False
    return free.ravel()


def _distances(side: LatticeSide, points: Floats, places: Floats) -> Floats:
    return np.asarray(np.linalg.norm(points - side.at(places[:, 0], places[:, 1]), axis=1))


def _report(
    before: LatticeFit, after: LatticeFit, first: Floats, last: Floats, steps: int
) -> Refinement:
    moved = np.linalg.norm(after.lattice.control - before.lattice.control, axis=-1)
    return Refinement(
        points=len(first),
        beyond=0,
        before=float(np.sqrt(np.mean(np.square(first)))),
        after=float(np.sqrt(np.mean(np.square(last)))),
        most=float(last.max()),
        moved=float(moved.max()),
        folded=_folded(after),
        steps=steps,
    )


def _folded(fit: LatticeFit) -> float:
    """Share of the prism that is turned inside out, sampled: layers need not be level."""
    places, weights = fit.section.inside()
    layers = fit.lattice.volume.bases[2].count
    along = (np.arange(layers) + 0.5) / layers
    local = np.column_stack([np.repeat(places, layers, axis=0), np.tile(along, len(places))])
    change = fit.lattice.jacobian_determinant(fit.prism.points(local))
    return float(np.repeat(weights, layers) @ (change <= 0.0) / (layers * weights.sum()))
