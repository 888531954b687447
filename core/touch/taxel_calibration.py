"""Gains and offsets of taxels and the speed of sound, from touches of known shapes.

Each taxel reads ``a c + o`` where the compression is c. The compression is known up to the error of
the arm's pose: a shift along the pad's normal and two tilts, common to all taxels of a touch.
Gains, offsets and these nuisances are estimated together; the nuisances have a normal prior whose
spread is estimated as well, for without one no touch could tell a stiff sensor from a shallow
press. (scipy.sparse: only calibration imports this.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, scaled_mad
from palpate.core.touch.pad import Calibration
from palpate.reprs import readable

if TYPE_CHECKING:
    from scipy.sparse import csr_array

LEAST_PRESSES = 4  # A taxel needs this many presses for a gain and an offset of its own
LEAST_KNOWN = 0.15e-3  # Compressions below are left out, m: an error of pose may have lifted it
DEAD_GAIN = 0.3  # A taxel that answers with less of what it is pressed by is not trusted
STUCK = 0.2e-3  # Nor is one that reads more than this beside the others when nothing is touched, m
SWEEPS = 8
LEAST_NOISE = 1e-7  # No array is quieter, m: a prior would count for nothing beside the readings
LEAST_REACHED = 16
FAR = 6.0  # Free readings farther off than this many scales are impulses
OUTLIER = 4.5  # Readings farther off than this many standard deviations are left out
FIRST_POSE, FIRST_TILT = 0.1e-3, 2e-3  # First spread of the pose's error, m and rad
FIRST_GAIN, FIRST_OFFSET = 0.03, 10e-6  # Likewise of departures from common gain and offset, 1, m
UNIT = 1e-3  # Compressions are in mm where gains are solved for: all columns are alike
TaxelIndices = NDArray[np.signedinteger]
LEAST_SPREAD = 1e-9  # m


@readable
@dataclass(frozen=True, slots=True, eq=False)
class CalibrationEstimate:
    """A calibration, and how sure it is."""

    gain: Floats  # Correction of each taxel, (taxels,); 0 if it is not to be trusted
    gain_error: Floats  # Standard errors; 0 where not trusted, nan where the taxel was not reached
    offset: Floats  # What is added after that, (taxels,), m
    offset_error: Floats  # Standard errors, m
    sound_speed: float  # In the pad, m/s; that of the data sheet if the array sends forces
    sound_speed_error: float  # Standard error, m/s
    noise: float  # Standard deviation of one taxel, m
    trusted: Bools  # (taxels,)
    reached: Bools  # Which trusted taxels were pressed often enough for an own gain, (taxels,)
    pose_error: float  # Standard deviation of the arm's error along the pad's normal, m
    residual: float  # Root mean square of what is left of the readings used, m
    condition: float  # Of the system that was solved


def estimate_calibration(
    presses: CalibrationTouches, x: Floats, y: Floats, data_sheet: Calibration
) -> CalibrationEstimate:
    """Gain and offset of each taxel, speed of sound, and noise.

    `x`, `y` (taxels,): where the taxels are, m. Raises ValueError if too few taxels answer to being
    pressed. Fung, 1999, section 3.4.1, asks for "careful sensor calibration" and says no more. With
    times of flight a wrong speed of sound is a gain common to all taxels: the common gain is given
    to the speed, the rest to the taxels, as is whatever else is common, as creep.
    """
    found = _look(presses)
    fit = TaxelFit(presses, x, y, found)
    try:
        for _ in range(SWEEPS):
            fit.sweep()
    except np.linalg.LinAlgError:
        raise ValueError("the readings do not tell gains from errors of the pose") from None
    return _estimate(fit, found, data_sheet)


def _look(presses: CalibrationTouches) -> InitialEstimate:
    """What each taxel reads at rest, whom to trust, and how noisy they are."""
    middle = np.median(presses.free, axis=0)
    trusted = _trusted(presses, middle)
    used = (presses.known > LEAST_KNOWN) & trusted
    reached = trusted & (used.sum(axis=0) >= LEAST_PRESSES)
    if reached.sum() < LEAST_REACHED:
        raise ValueError(
            f"only {int(reached.sum())} taxels answer to being pressed {LEAST_PRESSES} times or "
            f"more; {LEAST_REACHED} are needed"
        )
    noise = max(_noise((presses.free - middle)[:, trusted]), LEAST_NOISE)
    near = np.abs(presses.free - middle) <= FAR * noise
    rest = np.where(near, presses.free, 0.0).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    return InitialEstimate(rest, trusted, reached, used & reached, noise)


def _trusted(presses: CalibrationTouches, offset: Floats) -> Bools:
    """Which taxels answer to pressing, and only to pressing."""
    pressed = presses.known > LEAST_KNOWN
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(pressed, (presses.read - offset) / presses.known, np.nan)
    answering = np.ones(len(offset), bool)
    some = pressed.any(axis=0)
    answering[some] = np.nanmedian(share[:, some], axis=0) > DEAD_GAIN
    result: Bools = answering & (np.abs(offset - np.median(offset)) < STUCK)
    return result


def _noise(scatter: Floats) -> float:
    """Standard deviation of one taxel, without impulses.

    Of a frame that is counted in coarse steps most readings are alike, and the median of their
    scatter is 0: then the smallest step that is seen says what is far off.
    """
    frames, off = len(scatter), np.abs(scatter)
    steps = off[off > LEAST_SPREAD]
    scale = max(scaled_mad(off), float(steps.min(initial=np.inf)))
    if not math.isfinite(scale):
        return 0.0
    lost = math.sqrt(frames / max(frames - 1, 1))  # each taxel's own middle was taken away
    return lost * float(np.sqrt(np.mean(scatter[off <= FAR * scale] ** 2)))


def _estimate(
    fit: TaxelFit, found: InitialEstimate, data_sheet: Calibration
) -> CalibrationEstimate:
    misfit = max(fit.residual / fit.noise, 1.0)
    common, common_offset = 1.0 + fit.shared[0] / UNIT, fit.shared[1]
    by_time = data_sheet.signal == "time"
    ratio = 1.0 / common if by_time else 1.0  # of the speed to that of the data sheet
    answer, rest = np.full(len(found.rest), common), found.rest.copy()
    answer[fit.taxels] += fit.own[0] / UNIT
    rest[fit.taxels] = common_offset + fit.own[1]
    gain = np.where(found.trusted, 1.0 / (ratio * answer), 0.0)
    lifted = data_sheet.thickness * (1.0 - ratio)
    gain_error = np.where(found.trusted, np.nan, 0.0)
    offset_error = np.where(found.trusted, found.noise / math.sqrt(len(fit.presses.free)), 0.0)
    errors = misfit * np.sqrt(fit.own_variance)
    gain_error[fit.taxels] = errors[0] / UNIT / common
    offset_error[fit.taxels] = errors[1]
    speed_error = data_sheet.sound_speed * misfit * math.sqrt(fit.shared_variance[0])
    return CalibrationEstimate(
        gain=gain,
        gain_error=gain_error,
        offset=-(lifted + ratio * rest) * gain,
        offset_error=offset_error,
        sound_speed=data_sheet.sound_speed * ratio,
        sound_speed_error=ratio**2 * speed_error / UNIT if by_time else 0.0,
        noise=max(found.noise, fit.residual),
        trusted=found.trusted,
        reached=found.reached,
        pose_error=float(fit.spread[0]),
        residual=fit.residual,
        condition=fit.condition,
    )


class CalibrationTouches(NamedTuple):
    """Touches of known things."""

    known: Floats  # Of the known shape and the believed pose, (touches, taxels), m
    read: Floats  # What the data sheet makes of the signal, (touches, taxels), m
    free: Floats  # The same when nothing was touched, (frames, taxels), m


class InitialEstimate(NamedTuple):
    """What is seen before anything is fitted."""

    rest: Floats  # What each taxel reads if nothing is touched, (taxels,), m
    trusted: Bools  # (taxels,)
    reached: Bools  # Trusted, and pressed often enough, (taxels,)
    used: Bools  # The readings to fit, (touches, taxels)
    noise: float  # Standard deviation of one taxel, m


class TaxelFit:
    """The joint least squares: a gain and an offset a taxel, three nuisances a touch.

    A taxel's gain is a common one and its own departure from that, and so is its offset; the
    departures have a normal prior whose spread is learnt, so that what cannot be told from noise
    stays at nothing. Given all else the taxels do not depend on each other, so that they are
    eliminated two by two, and a small dense system is left.
    """

    def __init__(self, presses: CalibrationTouches, x: Floats, y: Floats, found: InitialEstimate):
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
        self._solve(at, pressed, self._shared_columns(touch, taxel, pressed), left)
        self._judge()
        squares = self.shared[2:] ** 2 + self.shared_variance[2:]
        self.spread = np.maximum(np.sqrt(squares.reshape(-1, 3).mean(axis=0)), LEAST_SPREAD)
        learnt = np.sqrt((self.own**2 + self.own_variance).mean(axis=1))
        self.own_spread = np.maximum(learnt, LEAST_SPREAD)

    def _shared_columns(
        self, touch: TaxelIndices, taxel: TaxelIndices, pressed: Floats
    ) -> csr_array:
        """One row a reading: common gain and offset, and its touch's three nuisances."""
        from scipy.sparse import csr_array

        first = 2 + 3 * touch
        zero = np.zeros_like(first)
        columns = np.stack([zero, zero + 1, first, first + 1, first + 2], axis=-1)
        values = np.column_stack([pressed, np.ones_like(pressed), self.basis[taxel]])
        ends = np.arange(0, values.size + 1, 5)
        shape = len(touch), len(self.shared)
        return csr_array((values.ravel(), columns.ravel(), ends), shape=shape)

    def _solve(self, at: TaxelIndices, pressed: Floats, system: csr_array, left: Floats) -> None:
        """Eliminate the taxels; then Cholesky. Priors keep both definite.

        The offsets at rest, the mean of the free frames, are readings as well.
        """
        from scipy.linalg import cho_factor, cho_solve
        from scipy.sparse import csr_array

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
        bad = np.abs(residual) > OUTLIER * max(scaled_mad(residual), self.noise)
        self.residual = float(np.sqrt(np.mean(residual[~bad] ** 2)))
        self.dropped[touch, taxel] = bad
