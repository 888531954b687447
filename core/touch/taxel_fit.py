"""Gains and offsets of an array's taxels, fitted together with the errors of the arm's pose."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.filters import MAD_TO_SIGMA

OUTLIER = 4.5
"""Readings farther off than this many standard deviations are left out."""
FIRST_POSE, FIRST_TILT = 0.1e-3, 2e-3
"""Spread of the pose's error with which the estimate begins, m and rad."""
FIRST_GAIN, FIRST_OFFSET = 0.03, 10e-6
"""Likewise of the taxels' departures from the common gain and offset, 1 and m."""
UNIT = 1e-3
"""Compressions are counted in mm where gains are solved for, so that all columns are alike."""

Places = NDArray[np.signedinteger]
LEAST_SPREAD = 1e-9
"""m."""


class Presses(NamedTuple):
    """Touches of known things."""

    known: Floats
    """Compression that the known shape and the believed pose make, (touches, taxels), m."""
    read: Floats
    """What the data sheet makes of the signal, (touches, taxels), m."""
    free: Floats
    """The same when nothing was touched, (frames, taxels), m."""


class Found(NamedTuple):
    """What is seen before anything is fitted."""

    rest: Floats
    """What each taxel reads if nothing is touched, (taxels,), m."""
    trusted: Bools
    """(taxels,)"""
    reached: Bools
    """Trusted, and pressed often enough, (taxels,)."""
    used: Bools
    """The readings to fit, (touches, taxels)."""
    noise: float
    """Standard deviation of one taxel, m."""


class TaxelFit:
    """The joint least squares: a gain and an offset a taxel, three nuisances a touch.

    A taxel's gain is a common one and its own departure from that, and so is its offset; the
    departures have a normal prior whose spread is learnt, so that what cannot be told from
    noise stays at nothing. Given all else the taxels do not depend on each other, so that
    they are eliminated two by two, and a small dense system is left.
    """

    def __init__(self, presses: Presses, x: Floats, y: Floats, found: Found):
        self.presses, self.noise, self.used = presses, found.noise, found.used
        self.size = max(float(np.abs(x).max()), float(np.abs(y).max()))
        self.basis = np.stack([np.ones_like(x), x / self.size, y / self.size], axis=-1)
        self.taxels = np.flatnonzero(found.reached)
        self.count = len(self.taxels)
        self.number = np.full(len(x), -1)
        self.number[self.taxels] = np.arange(self.count)
        self.rest = found.rest[self.taxels]
        touches = len(presses.known)
        self.own = np.zeros((2, self.count))  # departures: gain in 1 / UNIT, offset
        self.own_variance = np.zeros((2, self.count))
        self.shared = np.zeros(2 + 3 * touches)  # common gain and offset, then nuisances
        self.shared_variance = np.zeros_like(self.shared)
        self.spread = np.array([FIRST_POSE, FIRST_TILT * self.size, FIRST_TILT * self.size])
        self.own_spread = np.array([FIRST_GAIN * UNIT, FIRST_OFFSET])
        self.dropped = np.zeros_like(found.used)
        self.residual = self.condition = 0.0

    def sweep(self) -> None:
        """Linearise about the last nuisances, solve, drop outliers, learn the spreads."""
        touch, taxel = np.nonzero(self.used & ~self.dropped)
        known = self.presses.known[touch, taxel]
        nuisance = self.shared[2:].reshape(-1, 3)
        shift = np.einsum("ij,ij->i", nuisance[touch], self.basis[taxel])
        pressed, at = (known + shift) / UNIT, self.number[taxel]
        # a (known + nuisance) + o, linear in gain, offset and nuisance about the last one.
        left = self.presses.read[touch, taxel] - known
        system = self._shared_columns(touch, taxel, pressed)
        self._solve(at, pressed, system, left)
        self._judge()
        squares = self.shared[2:] ** 2 + self.shared_variance[2:]
        self.spread = np.maximum(np.sqrt(squares.reshape(-1, 3).mean(axis=0)), LEAST_SPREAD)
        learnt = np.sqrt((self.own**2 + self.own_variance).mean(axis=1))
        self.own_spread = np.maximum(learnt, LEAST_SPREAD)

    def _shared_columns(self, touch: Places, taxel: Places, pressed: Floats) -> csr_array:
        """One row a reading: common gain and offset, and its touch's three nuisances."""
        first = 2 + 3 * touch
        zero = np.zeros_like(first)
        columns = np.stack([zero, zero + 1, first, first + 1, first + 2], axis=-1)
        values = np.column_stack([pressed, np.ones_like(pressed), self.basis[taxel]])
        ends = np.arange(0, values.size + 1, 5)
        return csr_array(
            (values.ravel(), columns.ravel(), ends), shape=(len(touch), len(self.shared))
        )

    def _solve(self, at: Places, pressed: Floats, system: csr_array, left: Floats) -> None:
        """Eliminate the taxels; then Cholesky. Priors keep both definite.

        The offsets at rest, the mean of the free frames, are readings as well.
        """
        frames, rows = len(self.presses.free), np.arange(len(at))
        gain, offset = (self.noise / self.own_spread) ** 2
        ones = np.ones(len(at))
        to_taxel: Any = csr_array((ones, (at, rows)), shape=(self.count, len(at)))
        a = to_taxel @ (pressed * pressed) + gain
        b = to_taxel @ pressed
        c = to_taxel @ ones + frames + offset
        det = a * c - b * b
        right = np.stack([to_taxel @ (pressed * left), to_taxel @ left + frames * self.rest])
        weighted = to_taxel.multiply(pressed[None, :]).tocsr()
        mixed = np.stack([(weighted @ system).toarray(), (to_taxel @ system).toarray()])
        mixed[1, :, 1] += frames
        solved = np.stack([c * mixed[0].T - b * mixed[1].T, a * mixed[1].T - b * mixed[0].T])
        solved = (solved / det).transpose(0, 2, 1)  # each taxel's two by two, inverted, times mixed
        own = np.stack([c * right[0] - b * right[1], a * right[1] - b * right[0]]) / det
        whole = (system.T @ system).toarray()
        whole[1, 1] += frames * self.count
        prior = np.tile((self.noise / self.spread) ** 2, (len(self.shared) - 2) // 3)
        whole[np.arange(2, len(whole)), np.arange(2, len(whole))] += prior
        total = system.T @ left
        total[1] += frames * self.rest.sum()
        reduced = whole - np.einsum("kis,kit->st", mixed, solved, optimize=True)
        factor = cho_factor(reduced)
        self.shared = cho_solve(factor, total - np.einsum("kis,ki->s", mixed, own))
        inverse = cho_solve(factor, np.eye(len(reduced)))
        self.condition = float(np.linalg.cond(reduced))
        self.own = own - solved @ self.shared
        alone = np.stack([c, a]) / det
        along = np.einsum("kis,st,kit->ki", solved, inverse, solved, optimize=True)
        self.own_variance = self.noise**2 * (alone + along)
        self.shared_variance = self.noise**2 * np.diag(inverse)

    def _judge(self) -> None:
        """Judge all readings anew: what stands off is left out of the next sweep."""
        touch, taxel = np.nonzero(self.used)
        at, nuisance = self.number[taxel], self.shared[2:].reshape(-1, 3)
        pressed = self.presses.known[touch, taxel]
        pressed = pressed + np.einsum("ij,ij->i", nuisance[touch], self.basis[taxel])
        gain = 1.0 + (self.shared[0] + self.own[0][at]) / UNIT
        offset = self.shared[1] + self.own[1][at]
        residual = self.presses.read[touch, taxel] - gain * pressed - offset
        spread = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
        bad = np.abs(residual) > OUTLIER * max(spread, self.noise)
        self.residual = float(np.sqrt(np.mean(residual[~bad] ** 2)))
        self.dropped[touch, taxel] = bad
