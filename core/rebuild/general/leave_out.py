"""Cross-validation: single touches are left out, and predicted from the others, without a new fit.

With the weights of its points held, a fit is linear in the touched points. Leaving out a touch
needs no new fit: with residuals r of its rows, weighted to a standard deviation of 1, and the
block H of their hat matrix, the residuals without it are (1 - H)^-1 r (Cook and Weisberg,
*Residuals and influence in regression*, 1982, 2.2), and their expected squares are the diagonal of
(1 - H)^-1. H needs the inverse of the fit's equations at the rows of one touch. These rows are
smooth: they lie close to a subspace of some twenty directions, which subspace iteration finds
(Halko, Martinsson and Tropp, *Finding structure with randomness*, 2011); the directions of all
touches are solved for together. Displacements of the touches are unknowns as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.general.band import basis_rows
from palpate.core.rebuild.general.fitting import Solution, with_residuals


@dataclass(frozen=True, slots=True)
class LeaveOutSettings:
    """How many touches are left out, and how exactly.

    With 30 directions root mean square offsets differ by less than 1 % from those of fits without
    the touch, on scanned fruit, boxes and bottles; with 16 some touches over edges by a factor.
    """

    n_directions: int = 30  # dimension of the subspace of a touch's rows; larger is more exact
    n_iterations: int = 1  # subspace iterations; more are more exact
    max_touches: int = 48  # touches that are left out, at random
    min_points: int = 4  # touches of fewer points are left out only if there are too few others
    max_leverage: float = 1.0 - 1e-9  # limit of an eigenvalue of H, at 1 of which 1 - H is singular
    # Touches; with more, only displacements of those left out are unknowns, and all others are
    # held: the covariance of all would fill memory.
    max_displaced: int = 1000


class LeftOut(NamedTuple):
    """A fit, solved exactly, and what it predicts of touches that are left out."""

    solution: Solution
    covariance: Floats  # Of the displacements of all touches, (3 t, 3 t), or none, cells^2
    touches: Ints  # Which were left out, (k,)
    squares: Floats  # Mean squared offset of each touch that was left out, (k,), cells^2
    expected: Floats  # What the fit expects these to be, (k,), cells^2


def solved_exactly(
    solution: Solution, settings: LeaveOutSettings = LeaveOutSettings()
) -> tuple[Solution, Floats]:
    """The solution without the error of conjugate gradients, and the displacements' covariance.

    The covariance is (3 t, 3 t) [cells^2]; with too many touches it is empty, and nothing changes.
    """
    count = solution.equations.count
    if count > settings.max_displaced:
        return solution, np.zeros((0, 0))
    covariance = _Inverse.of(solution, [], np.arange(count)).displacements
    return _without_iteration(solution, covariance), covariance


def leave_out(
    solution: Solution, settings: LeaveOutSettings = LeaveOutSettings(), count: int | None = None
) -> LeftOut:
    """Leave out as many touches as `settings` ask for, each in turn.

    `count`: number of touches; later ones in the equations are assumed, and are never left out.
    """
    touches = _drawn_touches(solution, settings, count)
    sketches = [_sketch(solution, touch, settings) for touch in touches]
    count = solution.equations.count
    whole = count <= settings.max_displaced
    displaced = np.arange(count) if whole else np.array(touches)
    inverse = _Inverse.of(solution, sketches, displaced)
    if whole:
        solution = _without_iteration(solution, inverse.displacements)
    place = {int(touch): number for number, touch in enumerate(displaced)}
    offsets = np.array(
        [
            _offset_without(
                solution, sketch, inverse.of_touch(number, place[touch]), settings.max_leverage
            )
            for number, (sketch, touch) in enumerate(zip(sketches, touches, strict=True))
        ]
    )
    covariance = inverse.displacements if whole else np.zeros((0, 0))
    return LeftOut(solution, covariance, np.array(touches, np.int32), *offsets.T)


def _drawn_touches(solution: Solution, settings: LeaveOutSettings, count: int | None) -> list[int]:
    """Touches with points in the band, drawn; those with few points only after all others."""
    points = np.bincount(solution.equations.touch, minlength=solution.equations.count)[:count]
    drawn = np.random.default_rng(len(points)).permutation(len(points))
    order = drawn[np.argsort(points[drawn] < settings.min_points, kind="stable")]
    return [int(touch) for touch in order[: settings.max_touches] if points[touch]]


class _Sketch(NamedTuple):
    """Rows of a touch by few directions of the control values: rows = inner @ directions.T."""

    rows: NDArray[np.int64]  # Numbers of its points among the equations', (m,)
    controls: Ints  # Control values that they depend on, (l,)
    directions: Floats  # (l, d)
    inner: Floats  # (4 m, d)
    displacing: Floats  # Derivative of its rows by the displacement of the touch, (4 m, 3)


def _sketch(solution: Solution, touch: int, settings: LeaveOutSettings) -> _Sketch:
    equations = solution.equations
    rows = np.flatnonzero(equations.touch == touch)
    weights = solution.row_weights(rows)
    controls, place = np.unique(equations.band.local[equations.cell[rows]], return_inverse=True)
    weighted = basis_rows(equations.offsets[rows]).transpose(1, 0, 2) * weights[..., None]
    dense = np.zeros((len(rows), 4, len(controls)))
    at = np.broadcast_to(place.reshape(len(rows), 1, -1), weighted.shape)
    np.put_along_axis(dense, at, weighted, axis=2)
    flat = dense.reshape(-1, len(controls))
    count = min(settings.n_directions, *flat.shape)
    start = np.random.default_rng(0).normal(size=(len(flat), count))
    directions = np.linalg.qr(flat.T @ start)[0]
    for _ in range(settings.n_iterations):
        directions = np.linalg.qr(flat.T @ (flat @ directions))[0]
    displacing = np.zeros((len(rows), 4, 3))
    displacing[:, 0] = equations.moving[rows] * weights[:, :1]
    inner = flat @ directions
    return _Sketch(rows, controls.astype(np.int32), directions, inner, displacing.reshape(-1, 3))


class _Inverse(NamedTuple):
    """The inverse of the equations of control values and displacements, at directions."""

    own: Floats  # Block of the directions of each touch, displacements held, (t, d, d)
    across: Floats  # Block of these and the displacements that are unknown, (t, d, 3 n)
    displacements: Floats  # Block of the unknown displacements, (3 n, 3 n)

    @classmethod
    def of(
        cls, solution: Solution, sketches: list[_Sketch], displaced: NDArray[np.int64]
    ) -> _Inverse:
        """By the Schur complement, from the factor of the control values' equations alone.

        `displaced` (n,): touches whose displacements are unknown; those of others are held.
        """
        moving = (3 * displaced[:, None] + np.arange(3)).ravel()
        count = len(moving)
        width = max((one.directions.shape[1] for one in sketches), default=1)
        total = width * len(sketches)
        sides = [_columns(solution, sketches, width)] if sketches else []
        right = scipy.sparse.csr_matrix(
            scipy.sparse.hstack([*sides, solution.coupling()[:, moving]])
        )
        own = np.zeros((len(sketches), width, width))
        across, product = np.zeros((total, count)), np.zeros((count, count))
        for columns, rows in solution.factor.halves(right):
            split = int(np.searchsorted(columns, total))
            sketched, moved = columns[:split], columns[split:] - total
            touches, rest = sketched[::width] // width, rows[:, split:]
            blocks = rows[:, :split].reshape(len(rows), -1, width).transpose(1, 2, 0)
            own[touches] += blocks @ blocks.transpose(0, 2, 1)
            across[np.ix_(sketched, moved)] += rows[:, :split].T @ rest
            product[np.ix_(moved, moved)] += rest.T @ rest
        roots = solution.equations.shared_roots[moving]
        own_blocks = scipy.linalg.block_diag(*solution.touch_blocks()[displaced])
        schur = own_blocks - product - roots @ roots.T
        inverse = np.asarray(np.linalg.inv(schur))
        return cls(own, across.reshape(len(sketches), width, count), inverse)

    def of_touch(self, number: int, place: int) -> Floats:
        """Block (d + 3, d + 3) of the directions and the displacement of one sketched touch.

        `place`: number of the touch among those whose displacements are unknown.
        """
        across, own = self.across[number], slice(3 * place, 3 * place + 3)
        through = across @ self.displacements
        blocks = [
            [self.own[number] + through @ across.T, -through[:, own]],
            [-through[:, own].T, self.displacements[own, own]],
        ]
        return np.asarray(np.block(blocks))


def _columns(solution: Solution, sketches: list[_Sketch], width: int) -> scipy.sparse.csr_matrix:
    """The directions of all touches as columns, (n, width t); 0 where a touch has fewer."""
    blocks = [
        np.pad(one.directions, ((0, 0), (0, width - one.directions.shape[1]))) for one in sketches
    ]
    rows = np.concatenate([np.repeat(one.controls, width) for one in sketches])
    columns = np.concatenate(
        [np.tile(width * i + np.arange(width), len(one.controls)) for i, one in enumerate(sketches)]
    )
    values = np.concatenate([block.ravel() for block in blocks])
    shape = solution.factor.dissection.size, width * len(sketches)
    return scipy.sparse.csr_matrix((values, (rows, columns)), shape=shape)


def _without_iteration(solution: Solution, displacements: Floats) -> Solution:
    """The solution by direct solving: leaving out would enlarge errors of conjugate gradients."""
    coupling, factor = solution.coupling(), solution.factor
    moved = -displacements @ (coupling.T @ factor.solve(solution.right))
    control = factor.solve(solution.right - coupling @ moved)
    count = len(solution.fit.weights)
    fit = with_residuals(solution.equations, count, control, moved.reshape(-1, 3))
    return solution._replace(fit=fit)


def _offset_without(
    solution: Solution, sketch: _Sketch, inverse: Floats, max_leverage: float
) -> tuple[float, float]:
    """Mean squared offset of a touch's points from the fit without it, and its expectation."""
    equations, rows = solution.equations, sketch.rows
    weights = solution.row_weights(rows)
    normals, moving = equations.normals[rows], equations.moving[rows]
    cell, offsets = equations.cell[rows], equations.offsets[rows]
    fitted = np.column_stack(equations.band.evaluate_in(solution.fit.control, cell, offsets))
    moved = solution.fit.displacements[equations.touch[rows[0]]]
    residuals = (weights * (np.column_stack([-moving @ moved, normals]) - fitted)).ravel()
    fewer = len(inverse) - 3 - sketch.inner.shape[1]
    inner = np.concatenate([np.pad(sketch.inner, ((0, 0), (0, fewer))), sketch.displacing], axis=1)
    basis, triangle = np.linalg.qr(inner)
    leverages, turned = np.linalg.eigh(triangle @ inverse @ triangle.T)
    leverages = np.clip(leverages, 0.0, max_leverage)
    gains, directions = leverages / (1.0 - leverages), basis @ turned
    without = residuals + directions @ (gains * (directions.T @ residuals))
    uncertain = np.square(directions) @ gains
    values, scale = slice(None, None, 4), weights[:, 0] ** 2
    # Outliers have lost weight in the fit, but their expected noise is that of any point.
    expected = equations.scale.point**2 + uncertain[values] / scale
    return float(np.mean(without[values] ** 2 / scale)), float(np.mean(expected))
