"""Gains and offsets of taxels and the speed of sound, from touches of known shapes.

Each taxel reads ``a c + o`` at a compression c, which is known up to the error of the arm's pose: a
shift along the pad's normal and two tilts, common to all taxels of a touch. Gains, offsets and
these nuisances are estimated together; the nuisances have a normal prior whose spread is estimated
as well, because without it a stiff sensor and a shallow press are equivalent. (scipy.sparse: only
calibration imports it.)
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

MILLIMETRE = 1e-3  # [m] unit of compression where gains are solved for: scales columns alike
TaxelIndices = NDArray[np.signedinteger]


@dataclass(frozen=True, slots=True, kw_only=True)
class TaxelSettings:
    """Selection of taxels and readings for a calibration, and its initial guess."""

    min_presses: int = 4  # of a taxel that gets a gain and an offset of its own
    min_taxels: int = 16  # that were pressed so often; with fewer there is no calibration
    min_known: float = 0.15e-3  # [m] compression; pose errors may have lifted smaller ones
    min_gain: float = 0.3  # reading over compression of a trusted taxel, median
    max_free_offset: float = 0.2e-3  # [m] of a trusted taxel from the median, in free frames
    min_noise: float = 1e-7  # [m] of a taxel; without it priors vanish beside the readings
    free_outlier_sigmas: float = 6.0  # free readings farther off are impulses
    outlier_sigmas: float = 4.5  # residuals farther off are left out
    n_sweeps: int = 8  # of linearising, solving and dropping outliers
    # Initial standard deviations, which the sweeps replace.
    pose_spread: float = 0.1e-3  # [m] of the pose along the pad's normal
    tilt_spread: float = 2e-3  # [rad] of the pose
    gain_spread: float = 0.03  # of a taxel's gain from the common one
    offset_spread: float = 10e-6  # [m] of a taxel's offset from the common one
    min_spread: float = 1e-9  # [m], of gains [m/mm]: least learnt spread and step of readings


@readable
@dataclass(frozen=True, slots=True, eq=False)
class CalibrationEstimate:
    """A calibration and its standard errors."""

    gain: Floats  # correction of each taxel, (taxels,); 0 if it is not trusted
    gain_error: Floats  # standard errors; 0 where not trusted, nan where the taxel was not reached
    offset: Floats  # added after the gain, (taxels,) [m]
    offset_error: Floats  # standard errors [m]
    sound_speed: float  # [m/s] in the pad; that of the data sheet if the array sends forces
    sound_speed_error: float  # [m/s] standard error
    noise: float  # [m] standard deviation of one taxel
    trusted: Bools  # (taxels,)
    reached: Bools  # trusted taxels pressed often enough for a gain of their own, (taxels,)
    pose_error: float  # [m] standard deviation of the arm's error along the pad's normal
    residual: float  # [m] root mean square of the residuals of the readings used
    condition: float  # of the solved system


def estimate_calibration(
    presses: CalibrationTouches,
    x: Floats,
    y: Floats,
    data_sheet: Calibration,
    settings: TaxelSettings = TaxelSettings(),
) -> CalibrationEstimate:
    """Gain and offset of each taxel, speed of sound, and noise.

    `x`, `y` (taxels,): positions of the taxels [m]. Raises ValueError if too few taxels respond to
    presses. Fung, 1999, section 3.4.1, asks for "careful sensor calibration" without a method. With
    times of flight a wrong speed of sound is a gain common to all taxels: the speed takes the
    common gain, and the taxels take the rest, with all else that is common, such as creep.
    """
    initial = _initial_estimate(presses, settings)
    fit = TaxelFit(presses, x, y, initial, settings)
    try:
        for _ in range(settings.n_sweeps):
            fit.sweep()
    except np.linalg.LinAlgError:
        raise ValueError("the readings cannot tell gains from errors of the arm's pose") from None
    return _estimate(fit, initial, data_sheet)


def _initial_estimate(presses: CalibrationTouches, settings: TaxelSettings) -> InitialEstimate:
    """Readings of the taxels at rest, the trusted taxels, and their noise."""
    middle = np.median(presses.free, axis=0)
    trusted = _trusted(presses, middle, settings)
    used = (presses.known > settings.min_known) & trusted
    reached = trusted & (used.sum(axis=0) >= settings.min_presses)
    if reached.sum() < settings.min_taxels:
        raise ValueError(
            f"only {int(reached.sum())} taxels respond to {settings.min_presses} presses or "
            f"more; {settings.min_taxels} are needed"
        )
    noise = max(_noise((presses.free - middle)[:, trusted], settings), settings.min_noise)
    near = np.abs(presses.free - middle) <= settings.free_outlier_sigmas * noise
    rest = np.where(near, presses.free, 0.0).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    return InitialEstimate(rest, trusted, reached, used & reached, noise)


def _trusted(presses: CalibrationTouches, offset: Floats, settings: TaxelSettings) -> Bools:
    """Taxels that respond to presses, and to presses only."""
    pressed = presses.known > settings.min_known
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(pressed, (presses.read - offset) / presses.known, np.nan)
    responding = np.ones(len(offset), bool)
    some = pressed.any(axis=0)
    responding[some] = np.nanmedian(share[:, some], axis=0) > settings.min_gain
    is_quiet = np.abs(offset - np.median(offset)) < settings.max_free_offset
    result: Bools = responding & is_quiet
    return result


def _noise(scatter: Floats, settings: TaxelSettings) -> float:
    """Standard deviation of one taxel, without impulses.

    In a frame that is quantised in coarse steps most readings are equal, and the median of their
    scatter is 0: then the smallest step is the scale of outliers.
    """
    frames, offset = len(scatter), np.abs(scatter)
    steps = offset[offset > settings.min_spread]
    scale = max(scaled_mad(offset), float(steps.min(initial=np.inf)))
    if not math.isfinite(scale):
        return 0.0
    bessel = math.sqrt(frames / max(frames - 1, 1))  # each taxel's own middle was subtracted
    inliers = scatter[offset <= settings.free_outlier_sigmas * scale]
    return bessel * float(np.sqrt(np.mean(inliers**2)))


def _estimate(
    fit: TaxelFit, initial: InitialEstimate, data_sheet: Calibration
) -> CalibrationEstimate:
    misfit = max(fit.residual / fit.noise, 1.0)
    common, common_offset = 1.0 + fit.shared[0] / MILLIMETRE, fit.shared[1]
    by_time = data_sheet.signal == "time"
    ratio = 1.0 / common if by_time else 1.0  # of the speed to that of the data sheet
    response, rest = np.full(len(initial.rest), common), initial.rest.copy()
    response[fit.taxels] += fit.own[0] / MILLIMETRE
    rest[fit.taxels] = common_offset + fit.own[1]
    gain = np.where(initial.trusted, 1.0 / (ratio * response), 0.0)
    lifted = data_sheet.thickness * (1.0 - ratio)
    gain_error = np.where(initial.trusted, np.nan, 0.0)
    offset_error = np.where(initial.trusted, initial.noise / math.sqrt(len(fit.presses.free)), 0.0)
    errors = misfit * np.sqrt(fit.own_variance)
    gain_error[fit.taxels] = errors[0] / MILLIMETRE / common
    offset_error[fit.taxels] = errors[1]
    speed_error = data_sheet.sound_speed * misfit * math.sqrt(fit.shared_variance[0])
    return CalibrationEstimate(
        gain=gain,
        gain_error=gain_error,
        offset=-(lifted + ratio * rest) * gain,
        offset_error=offset_error,
        sound_speed=data_sheet.sound_speed * ratio,
        sound_speed_error=ratio**2 * speed_error / MILLIMETRE if by_time else 0.0,
        noise=max(initial.noise, fit.residual),
        trusted=initial.trusted,
        reached=initial.reached,
        pose_error=float(fit.spread[0]),
        residual=fit.residual,
        condition=fit.condition,
    )


class CalibrationTouches(NamedTuple):
    """Compressions of the taxels in touches of known shapes."""

    known: Floats  # from shape and believed pose, (touches, taxels) [m]
    read: Floats  # from the signal, by the data sheet, (touches, taxels) [m]
    free: Floats  # the same without contact, (frames, taxels) [m]


class InitialEstimate(NamedTuple):
    """Estimates before the fit."""

    rest: Floats  # reading of each taxel without contact, (taxels,) [m]
    trusted: Bools  # (taxels,)
    reached: Bools  # trusted, and pressed often enough, (taxels,)
    used: Bools  # readings to fit, (touches, taxels)
    noise: float  # [m] standard deviation of one taxel


class TaxelFit:
    """The joint least squares: a gain and an offset for each taxel, three nuisances for each touch.

    A taxel's gain is the sum of a common one and its own departure, and so is its offset; the
    departures have a normal prior whose spread is learnt, so that departures within noise shrink to
    0. Without the common parameters taxels are independent: their two unknowns are eliminated, and
    a small dense system remains.
    """

    def __init__(
        self,
        presses: CalibrationTouches,
        x: Floats,
        y: Floats,
        initial: InitialEstimate,
        settings: TaxelSettings,
    ):
        self.presses, self.settings = presses, settings
        self.noise, self.used = initial.noise, initial.used
        self.size = max(float(np.abs(x).max()), float(np.abs(y).max()))
        self.basis = np.stack([np.ones_like(x), x / self.size, y / self.size], axis=-1)
        self.taxels = np.flatnonzero(initial.reached)
        self.count = len(self.taxels)
        self.number = np.full(len(x), -1)
        self.number[self.taxels] = np.arange(self.count)
        self.rest = initial.rest[self.taxels]
        touches = len(presses.known)
        self.own = np.zeros((2, self.count))  # departures: gain times MILLIMETRE, offset
        self.own_variance = np.zeros((2, self.count))
        self.shared = np.zeros(2 + 3 * touches)  # common gain and offset, then nuisances
        self.shared_variance = np.zeros_like(self.shared)
        tilt = settings.tilt_spread * self.size
        self.spread = np.array([settings.pose_spread, tilt, tilt])
        self.own_spread = np.array([settings.gain_spread * MILLIMETRE, settings.offset_spread])
        self.dropped = np.zeros_like(initial.used)
        self.residual = self.condition = 0.0

    def sweep(self) -> None:
        """Linearise about the last nuisances, solve, drop outliers, and learn the spreads."""
        touch, taxel = np.nonzero(self.used & ~self.dropped)
        known = self.presses.known[touch, taxel]
        nuisance = self.shared[2:].reshape(-1, 3)
        shift = np.einsum("ij,ij->i", nuisance[touch], self.basis[taxel])
        pressed, at = (known + shift) / MILLIMETRE, self.number[taxel]
        # The model a (known + nuisance) + o is linearised about the last nuisances.
        left = self.presses.read[touch, taxel] - known
        self._solve(at, pressed, self._shared_columns(touch, taxel, pressed), left)
        self._drop_outliers()
        squares = self.shared[2:] ** 2 + self.shared_variance[2:]
        min_spread = self.settings.min_spread
        self.spread = np.maximum(np.sqrt(squares.reshape(-1, 3).mean(axis=0)), min_spread)
        learnt = np.sqrt((self.own**2 + self.own_variance).mean(axis=1))
        self.own_spread = np.maximum(learnt, min_spread)

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
        """Eliminate the taxels, then solve by Cholesky; priors keep both definite.

        The offsets at rest, means of the free frames, are readings as well.
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

    def _drop_outliers(self) -> None:
        """Leave readings with large residuals out of the next sweep."""
        touch, taxel = np.nonzero(self.used)
        at, nuisance = self.number[taxel], self.shared[2:].reshape(-1, 3)
        pressed = self.presses.known[touch, taxel]
        pressed = pressed + np.einsum("ij,ij->i", nuisance[touch], self.basis[taxel])
        gain = 1.0 + (self.shared[0] + self.own[0][at]) / MILLIMETRE
        offset = self.shared[1] + self.own[1][at]
        residual = self.presses.read[touch, taxel] - gain * pressed - offset
        scale = max(scaled_mad(residual), self.noise)
        bad = np.abs(residual) > self.settings.outlier_sigmas * scale
        self.residual = float(np.sqrt(np.mean(residual[~bad] ** 2)))
        self.dropped[touch, taxel] = bad
