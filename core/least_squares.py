"""Many small nonlinear least-squares problems, solved side by side: Levenberg and Marquardt.

With Nielsen's damping, bounds and robust losses. All unfinished problems take their next step in
one call, so that a hundred starts of one fit, or the inversion of ten thousand points, cost little
more than one. Not scipy's solver, which takes one problem at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints

# Parameters (b, p) of the problems with indices (b,): residuals (b, m) and Jacobians (b, m, p).
ResidualFunction = Callable[[Floats, Ints], tuple[Floats, Floats]]
# Squared residuals to their cost, at most as large, and its derivative, at most 1.
Loss = Callable[[Floats], tuple[Floats, Floats]]


@dataclass(frozen=True, slots=True, kw_only=True)
class MarquardtSettings:
    """Damping of the normal equations, over the squared lengths of the Jacobian's columns.

    Its changes are those of Nielsen, *Damping parameter in Marquardt's method*, 1999.
    """

    first_damping: float = 1e-3
    min_damping: float = 1e-12  # after good steps
    min_raised: float = 1e-6  # a smaller one is raised to it before a bad step multiplies it
    max_damping: float = 1e12  # larger ones end the iteration
    n_bound_passes: int = 3  # over steps that exceed bounds; later excesses are clipped
    min_column: float = 1e-14  # length over the longest column's; shorter ones are raised to it


class Solutions(NamedTuple):
    """Solution of each problem."""

    parameters: Floats  # (b, p)
    cost: Floats  # half the sum of the squared residuals' costs, (b,)
    converged: Bools  # (b,): residuals or slope vanish, or steps hardly lower the cost
    steps: Ints  # that were tried, (b,)


class _Running(NamedTuple):
    """Unfinished problems."""

    rows: Ints
    parameters: Floats
    residuals: Floats
    jacobian: Floats
    cost: Floats
    damping: Floats
    growth: Floats

    def take(self, which: Bools) -> _Running:
        """Problems where a mask is set."""
        fields: tuple[Any, ...] = self
        return _Running(*(field[which] for field in fields))

    def replaced(self, mask: Bools, new: _Running) -> _Running:
        """Problems with the fields of `new` where a mask is set."""
        pairs: zip[tuple[Any, Any]] = zip(new, self, strict=True)
        return _Running(*(np.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))


def linear_loss(squared: Floats) -> tuple[Floats, Floats]:
    """The quadratic loss."""
    return squared, np.ones_like(squared)


def cauchy_loss(scale: float) -> Loss:
    """A loss that grows like the residual's logarithm above the scale."""

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
    min_residual: float = 0.0,
    tolerance: float = 1e-10,
    settings: MarquardtSettings = MarquardtSettings(),
) -> Solutions:
    """Minimise sums of squares, each from its own start and within its own bounds.

    `problem`: residuals and Jacobians of some of the problems. `starts` (b, p): initial parameters;
    clipped to the bounds. `low` and `high` (b, p) or (p,): bounds of the parameters; may be
    infinite. `loss`: cost of squared residuals. `steps`: maximum for each problem. `min_residual`:
    norm of the residuals below which a problem is solved. `tolerance`: a problem has converged when
    no free column of the Jacobian has a larger cosine with the residuals, or when the predicted
    relative reduction of the cost is below its square. A parameter at a bound that it would leave
    is fixed for the step; other steps are clipped at the bounds. Damping is in the units of each
    column, so that the path does not depend on the parameters' units: Marquardt, 1963, where Fung,
    1999, (2.16), damps all columns equally. A robust loss weights residuals and Jacobian by the
    root of its derivative.
    """
    low, high = np.broadcast_to(low, starts.shape), np.broadcast_to(high, starts.shape)
    parameters = np.clip(starts, low, high)
    rows = np.arange(len(starts), dtype=np.int32)
    ends = Solutions(
        parameters.copy(), np.zeros(len(rows)), np.zeros(len(rows), bool), np.zeros_like(rows)
    )
    damping = np.full(len(rows), settings.first_damping)
    running = _evaluated(problem, loss, rows, parameters, damping)
    for _ in range(steps + 1):
        bounds = low[running.rows], high[running.rows]
        moves, predicted, flat = _moves(running, *bounds, tolerance, settings)
        small = (predicted >= 0.0) & (predicted <= tolerance**2 * running.cost)
        solved = np.einsum("bm,bm->b", running.residuals, running.residuals) <= min_residual**2
        done = flat | small | solved
        stuck = running.damping > settings.max_damping
        stopped = done | stuck | (ends.steps[running.rows] >= steps)
        rows = running.rows[stopped]
        ends.parameters[rows], ends.cost[rows] = running.parameters[stopped], running.cost[stopped]
        ends.converged[rows] = done[stopped]
        if stopped.all():
            break
        running, moves, predicted = running.take(~stopped), moves[~stopped], predicted[~stopped]
        ends.steps[running.rows] += 1
        running = _stepped(problem, loss, running, moves, predicted, settings)
    return ends


def _evaluated(
    problem: ResidualFunction, loss: Loss, rows: Ints, parameters: Floats, damping: Floats
) -> _Running:
    """Residuals and Jacobians, weighted by the loss."""
    residuals, jacobian = problem(parameters, rows)
    cost, weight = loss(residuals * residuals)
    root = np.sqrt(weight)
    return _Running(
        rows,
        parameters,
        root * residuals,
        root[:, :, None] * jacobian,
        0.5 * cost.sum(axis=1),
        damping,
        np.full(len(rows), 2.0),
    )


def _moves(
    running: _Running,
    low: Floats,
    high: Floats,
    tolerance: float,
    settings: MarquardtSettings,
) -> tuple[Floats, Floats, Bools]:
    """Steps within the bounds, their predicted reduction of the cost, and where the slope is 0."""
    jacobian, parameters = running.jacobian, running.parameters
    slope = np.einsum("bmp,bm->bp", jacobian, running.residuals)
    curve = jacobian.transpose(0, 2, 1) @ jacobian
    length = np.sqrt(np.einsum("bpp->bp", curve))
    longest = length.max(axis=1, keepdims=True)
    # Where no parameter changes any residual, any length serves: the step is 0.
    length = np.maximum(length, settings.min_column * np.where(longest > 0.0, longest, 1.0))
    held = ((parameters <= low) & (slope > 0.0)) | ((parameters >= high) & (slope < 0.0))
    cosine = np.where(held, 0.0, np.abs(slope) / length)
    size = np.sqrt(np.einsum("bm,bm->b", running.residuals, running.residuals))
    flat = cosine.max(axis=1) <= tolerance * size
    scaled = curve / (length[:, :, None] * length[:, None, :])
    which = np.arange(scaled.shape[1])
    scaled[:, which, which] = 1.0 + running.damping[:, None]
    room = (low - parameters) * length, (high - parameters) * length
    moves = _bounded_step(scaled, slope / length, held, room, settings.n_bound_passes) / length
    moves = np.clip(parameters + moves, low, high) - parameters
    changed = np.einsum("bmp,bp->bm", jacobian, moves)
    predicted = -np.einsum("bp,bp->b", slope, moves) - 0.5 * np.einsum("bm,bm->b", changed, changed)
    return moves, predicted, flat


def _bounded_step(
    system: Floats, slope: Floats, held: Bools, room: tuple[Floats, Floats], n_passes: int
) -> Floats:
    """Steps (b, p) that solve the systems; steps beyond a bound are fixed there, in passes."""
    moves, which = np.zeros_like(slope), np.arange(slope.shape[1])
    for _ in range(n_passes):
        free = ~held
        right = np.where(held, moves, -slope - np.einsum("bpq,bq->bp", system, moves * held))
        matrix = np.where(free[:, :, None] & free[:, None, :], system, 0.0)
        matrix[:, which, which] = np.where(held, 1.0, system[:, which, which])
        moves = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
        clipped = np.clip(moves, *room)
        exceeds = free & (clipped != moves)
        moves, held = clipped, held | exceeds
        if not exceeds.any():
            break
    return moves


def _stepped(
    problem: ResidualFunction,
    loss: Loss,
    running: _Running,
    moves: Floats,
    predicted: Floats,
    settings: MarquardtSettings,
) -> _Running:
    """The problems after a step; where the cost did not fall they stay and are damped more."""
    moved = running.parameters + moves
    ahead = _evaluated(problem, loss, running.rows, moved, running.damping.copy())
    reduction = running.cost - ahead.cost
    better = reduction > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        gain_ratio = np.where(better, reduction / predicted, 0.0)
    factor = np.maximum(1.0 / 3.0, 1.0 - (2.0 * np.clip(gain_ratio, 0.0, 1.0) - 1.0) ** 3)
    damping = np.maximum(running.damping * factor, settings.min_damping)
    ahead = ahead._replace(damping=damping)
    damping = np.maximum(running.damping, settings.min_raised) * running.growth
    kept = running._replace(damping=damping, growth=2.0 * running.growth)
    return kept.replaced(better, ahead)
