"""Many small nonlinear least-squares problems, solved side by side: Levenberg and Marquardt.

With Nielsen's damping, bounds and robust losses. All problems that are still under way take their
next step in one call, so that a hundred starts of one fit, or the inversion of ten thousand points,
cost little more than one. Own code: scipy's solver takes one problem at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints

# Parameters (b, p) of the problems named (b,): residuals (b, m) and Jacobians (b, m, p).
ResidualFunction = Callable[[Floats, Ints], tuple[Floats, Floats]]
# Squared residuals: what they cost, at most as much, and the derivative of that, up to 1.
Loss = Callable[[Floats], tuple[Floats, Floats]]
FIRST_DAMPING = 1e-3  # Of a column's squared length
MOST_DAMPING = 1e12
PASSES = 3  # Through the bounds that a step would pass; what passes after the last is cut
LEAST_COLUMN = 1e-14  # Of the longest column: a parameter that moves residuals less is held so


class Solutions(NamedTuple):
    """Where each problem ended."""

    parameters: Floats  # (b, p)
    cost: Floats  # Half the sum of what the squared residuals cost, (b,)
    converged: Bools  # (b,): residuals vanished, no step lowers the cost, or steps did not matter
    steps: Ints  # Steps tried, (b,)


class _Running(NamedTuple):
    """The problems under way."""

    rows: Ints
    parameters: Floats
    residuals: Floats
    jacobian: Floats
    cost: Floats
    damping: Floats
    growth: Floats

    def take(self, which: Bools) -> _Running:
        """Some of them."""
        fields: tuple[Any, ...] = self
        return _Running(*(field[which] for field in fields))

    def where(self, better: Bools, other: _Running) -> _Running:
        """Those of the others where they are better."""
        pairs: zip[tuple[Any, Any]] = zip(other, self, strict=True)
        return _Running(
            *(np.where(better.reshape(-1, *[1] * (one.ndim - 1)), one, two) for one, two in pairs)
        )


def linear_loss(squared: Floats) -> tuple[Floats, Floats]:
    """The plain loss: a squared residual costs itself."""
    return squared, np.ones_like(squared)


def cauchy_loss(scale: float) -> Loss:
    """A loss that grows like the residual's logarithm where it is larger than the scale."""

    def loss(squared: Floats) -> tuple[Floats, Floats]:
        share = squared / scale**2
        return scale**2 * np.log1p(share), 1.0 / (1.0 + share)

    return loss


def levenberg_marquardt(
    problem: ResidualFunction,
    starts: Floats,
    low: Floats,
    high: Floats,
    *,
    loss: Loss = linear_loss,
    steps: int = 60,
    enough: float = 0.0,
    tolerance: float = 1e-10,
) -> Solutions:
    """Minimise sums of squares, each from its own start and within its own bounds.

    `problem`: residuals and Jacobians of some of the problems. `starts` (b, p): where they begin;
    moved into the bounds. `low` and `high` (b, p) or (p,): bounds of the parameters; may be
    infinite. `loss`: what squared residuals cost. `steps`: most steps of each. `enough`: length of
    the residuals below which a problem is solved. `tolerance`: a problem has converged when no free
    column of the Jacobian has a larger cosine with the residuals, or when a step promises to lower
    the cost by less than this squared. A parameter at a bound that it would leave is held for the
    step; the others' step is cut at their bounds. Damping is in the units of each column, so that
    the path does not depend on the parameters' units: Marquardt, 1963, where Fung, 1999, (2.16)
    damps all alike. How it changes: Nielsen, *Damping parameter in Marquardt's method*, 1999. A
    robust loss weights residuals and Jacobian by the root of its derivative.
    """
    low, high = np.broadcast_to(low, starts.shape), np.broadcast_to(high, starts.shape)
    parameters = np.clip(starts, low, high)
    rows = np.arange(len(starts), dtype=np.int32)
    ends = Solutions(
        parameters.copy(), np.zeros(len(rows)), np.zeros(len(rows), bool), np.zeros_like(rows)
    )
    running = _evaluated(problem, loss, rows, parameters, np.full(len(rows), FIRST_DAMPING))
    for _ in range(steps + 1):
        moves, promised, flat = _moves(running, low[running.rows], high[running.rows], tolerance)
        small = (promised >= 0.0) & (promised <= tolerance**2 * running.cost)
        solved = np.einsum("bm,bm->b", running.residuals, running.residuals) <= enough**2
        done = flat | small | solved
        stopped = done | (running.damping > MOST_DAMPING) | (ends.steps[running.rows] >= steps)
        rows = running.rows[stopped]
        ends.parameters[rows], ends.cost[rows] = running.parameters[stopped], running.cost[stopped]
        ends.converged[rows] = done[stopped]
        if stopped.all():
            break
        running, moves, promised = running.take(~stopped), moves[~stopped], promised[~stopped]
        ends.steps[running.rows] += 1
        running = _stepped(problem, loss, running, moves, promised)
    return ends


def _evaluated(
    problem: ResidualFunction, loss: Loss, rows: Ints, parameters: Floats, damping: Floats
) -> _Running:
    """Residuals and Jacobians, weighted by the loss."""
    residuals, jacobian = problem(parameters, rows)
    dear, weight = loss(residuals * residuals)
    root = np.sqrt(weight)
    return _Running(
        rows,
        parameters,
        root * residuals,
        root[:, :, None] * jacobian,
        0.5 * dear.sum(axis=1),
        damping,
        np.full(len(rows), 2.0),
    )


def _moves(
    running: _Running, low: Floats, high: Floats, tolerance: float
) -> tuple[Floats, Floats, Bools]:
    """Steps within the bounds, what they promise to save, and where there is nothing to save."""
    jacobian, parameters = running.jacobian, running.parameters
    slope = np.einsum("bmp,bm->bp", jacobian, running.residuals)
    curve = jacobian.transpose(0, 2, 1) @ jacobian
    length = np.sqrt(np.einsum("bpp->bp", curve))
    longest = length.max(axis=1, keepdims=True)
    # Where no parameter moves anything, any length will do: the step is none.
    length = np.maximum(length, LEAST_COLUMN * np.where(longest > 0.0, longest, 1.0))
    held = ((parameters <= low) & (slope > 0.0)) | ((parameters >= high) & (slope < 0.0))
    cosine = np.where(held, 0.0, np.abs(slope) / length)
    size = np.sqrt(np.einsum("bm,bm->b", running.residuals, running.residuals))
    flat = cosine.max(axis=1) <= tolerance * size
    scaled = curve / (length[:, :, None] * length[:, None, :])
    which = np.arange(scaled.shape[1])
    scaled[:, which, which] = 1.0 + running.damping[:, None]
    room = (low - parameters) * length, (high - parameters) * length
    moves = _bounded_step(scaled, slope / length, held, room) / length
    moves = np.clip(parameters + moves, low, high) - parameters
    changed = np.einsum("bmp,bp->bm", jacobian, moves)
    promised = -np.einsum("bp,bp->b", slope, moves) - 0.5 * np.einsum("bm,bm->b", changed, changed)
    return moves, promised, flat


def _bounded_step(
    system: Floats, slope: Floats, held: Bools, room: tuple[Floats, Floats]
) -> Floats:
    """Steps (b, p) that solve the systems; what would pass its bound is put there, others anew."""
    moves, which = np.zeros_like(slope), np.arange(slope.shape[1])
    for _ in range(PASSES):
        free = ~held
        right = np.where(held, moves, -slope - np.einsum("bpq,bq->bp", system, moves * held))
        matrix = np.where(free[:, :, None] & free[:, None, :], system, 0.0)
        matrix[:, which, which] = np.where(held, 1.0, system[:, which, which])
        moves = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
        cut = np.clip(moves, *room)
        passed = free & (cut != moves)
        moves, held = cut, held | passed
        if not passed.any():
            break
    return moves


def _stepped(
    problem: ResidualFunction, loss: Loss, running: _Running, moves: Floats, promised: Floats
) -> _Running:
    """The problems after a step; where the cost did not fall they stay and are damped more."""
    moved = running.parameters + moves
    ahead = _evaluated(problem, loss, running.rows, moved, running.damping.copy())
    saved = running.cost - ahead.cost
    better = saved > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        quality = np.where(better, saved / promised, 0.0)
    eased = np.maximum(1.0 / 3.0, 1.0 - (2.0 * np.clip(quality, 0.0, 1.0) - 1.0) ** 3)
    ahead = ahead._replace(damping=np.maximum(running.damping * eased, 1e-12))
    damping = np.maximum(running.damping, 1e-6) * running.growth
    kept = running._replace(damping=damping, growth=2.0 * running.growth)
    return kept.where(better, ahead)
