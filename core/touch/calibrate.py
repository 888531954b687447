"""What an array's taxels mean, estimated from touches of things whose shape is known.

Each taxel reads ``a c + o`` where the compression is c. The compression is known up to the
error of the arm's pose: a shift along the pad's normal and two tilts, common to all taxels of
a touch. Gains, offsets and these nuisances are estimated together; the nuisances have a
normal prior whose spread is estimated as well, for without one no touch could tell a stiff
sensor from a shallow press.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.calibration import Calibration
from palpate.core.touch.filters import MAD_TO_SIGMA

LEAST_PRESSES = 4
"""A taxel needs this many presses for a gain and an offset of its own."""
LEAST_KNOWN = 0.15e-3
"""Compressions below this are left out, m: an error of pose could have lifted the pad off."""
DEAD_GAIN = 0.3
"""A taxel that answers with less than this share of what it is pressed by is not trusted."""
STUCK = 0.2e-3
"""Nor is one that reads more than this when nothing is touched, m."""
OUTLIER = 4.5
"""Readings farther off than this many standard deviations are left out."""
SWEEPS = 8
FIRST_POSE, FIRST_TILT = 0.1e-3, 2e-3
"""Spread of the pose's error with which the estimate begins, m and rad."""
LEAST_SPREAD = 1e-9
UNIT = 1e-3
"""Compressions are counted in mm where gains are solved for, so that all columns are alike."""

Places = NDArray[np.signedinteger]


class Presses(NamedTuple):
    """Touches of known things."""

    known: Floats
    """Compression that the known shape and the believed pose make, (touches, taxels), m."""
    read: Floats
    """What the data sheet makes of the signal, (touches, taxels), m."""
    free: Floats
    """The same when nothing was touched, (frames, taxels), m."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A calibration, and how sure it is."""

    gain: Floats
    """Correction of each taxel, (taxels,); 0 if it is not to be trusted."""
    gain_error: Floats
    """Standard errors; 0 where not trusted, nan where the taxel was not reached."""
    offset: Floats
    """What is added after that, (taxels,), m."""
    offset_error: Floats
    """Standard errors, m."""
    sound_speed: float
    """In the pad, m/s; that of the data sheet if the array sends forces."""
    sound_speed_error: float
    """Standard error, m/s."""
    noise: float
    """Standard deviation of one taxel, m."""
    trusted: Bools
    """(taxels,)"""
    reached: Bools
    """Which trusted taxels were pressed often enough for a gain of their own, (taxels,)."""
    pose_error: float
    """Standard deviation of the arm's error along the pad's normal, m."""
    residual: float
    """Root mean square of what is left of the readings used, m."""
    condition: float
    """Of the system that was solved."""


def estimate_calibration(
    presses: Presses, x: Floats, y: Floats, data_sheet: Calibration
) -> Estimate:
    """Gain and offset of each taxel, speed of sound, and noise.

    Parameters
    ----------
    presses : Presses
        Readings of known things.
    x, y : (taxels,) arrays
        Where the taxels are, m.
    data_sheet : Calibration
        With which the signals were read.

    Raises
    ------
    ValueError
        If fewer than four taxels were pressed often enough.

    Notes
    -----
    Fung, 1999, section 3.4.1, asks for "careful sensor calibration" and says no more. With
    times of flight a wrong speed of sound is a gain common to all taxels: the mean gain is
    given to the speed, and what is left to the taxels.
    """
    offset = np.median(presses.free, axis=0)
    noise = _noise(presses.free - offset)
    trusted = _trusted(presses, offset)
    used = (presses.known > LEAST_KNOWN) & trusted
    reached = used.sum(axis=0) >= LEAST_PRESSES
    if reached.sum() < 4:
        raise ValueError(
            f"only {int(reached.sum())} taxels were pressed {LEAST_PRESSES} times or more; "
            "press deeper, or lean more"
        )
    fit = _Fit(presses, x, y, used & reached, reached, offset, noise)
    for _ in range(SWEEPS):
        fit.sweep()
    return _estimate(fit, data_sheet, trusted, reached, offset, noise)


class _Fit:
    """The joint least squares: one gain and offset a taxel, three nuisances a touch."""

    def __init__(
        self,
        presses: Presses,
        x: Floats,
        y: Floats,
        used: Bools,
        reached: Bools,
        offset: Floats,
        noise: float,
    ):
        self.presses, self.used = presses, used
        self.size = max(float(np.abs(x).max()), float(np.abs(y).max()))
        self.basis = np.stack([np.ones_like(x), x / self.size, y / self.size], axis=-1)
        self.taxels = np.flatnonzero(reached)
        self.count = len(self.taxels)
        self.number = np.full(len(x), -1)
        self.number[self.taxels] = np.arange(self.count)
        self.rest = offset[self.taxels]
        # A quantised frame that never changes has no scatter to tell its noise by.
        self.noise = max(noise, LEAST_SPREAD)
        self.spread = np.array([FIRST_POSE, FIRST_TILT * self.size, FIRST_TILT * self.size])
        self.nuisance: Floats = np.zeros((len(presses.known), 3))
        self.gain: Floats = np.ones(self.count)
        self.offset: Floats = self.rest.copy()
        self.covariance: Floats = np.zeros((0, 0))
        self.residual, self.condition = 0.0, 0.0

    def sweep(self) -> None:
        """Linearise about the last nuisances, solve, drop outliers, learn the spreads."""
        touch, taxel = np.nonzero(self.used)
        known = self.presses.known[touch, taxel]
        shift = np.einsum("ij,ij->i", self.nuisance[touch], self.basis[taxel])
        # a (known + nuisance) + o, linear in gain, offset and nuisance about the last one.
        left = self.presses.read[touch, taxel] - known
        system = self._system(touch, taxel, (known + shift) / UNIT)
        solution, self.covariance = self._solve(system, left)
        self.gain = 1.0 + solution[: self.count] / UNIT
        self.offset = solution[self.count : 2 * self.count]
        self.nuisance = solution[2 * self.count :].reshape(-1, 3)
        self._judge(touch, taxel, left - system @ solution)
        variance = np.diag(self.covariance)[2 * self.count :].reshape(-1, 3)
        learnt = np.sqrt((self.nuisance**2 + variance).mean(axis=0))
        self.spread = np.maximum(learnt, LEAST_SPREAD)

    def _system(self, touch: Places, taxel: Places, pressed: Floats) -> csr_array:
        """One row a reading: its taxel's gain and offset, its touch's three nuisances."""
        at, first = self.number[taxel], 2 * self.count + 3 * touch
        columns = np.stack([at, self.count + at, first, first + 1, first + 2], axis=-1)
        values = np.column_stack([pressed, np.ones_like(pressed), self.basis[taxel]])
        ends = np.arange(0, values.size + 1, 5)
        width = 2 * self.count + self.nuisance.size
        return csr_array((values.ravel(), columns.ravel(), ends), shape=(len(touch), width))

    def _solve(self, system: csr_array, left: Floats) -> tuple[Floats, Floats]:
        """Solution and covariance, by Cholesky.

        The free frames hold the offsets and the prior the nuisances, so the system is
        definite; its condition is kept.
        """
        frames = len(self.presses.free)
        held = np.zeros(system.shape[1])
        held[self.count : 2 * self.count] = frames
        held[2 * self.count :] = np.tile((self.noise / self.spread) ** 2, len(self.nuisance))
        right = system.T @ left
        right[self.count : 2 * self.count] += frames * self.rest
        matrix = (system.T @ system).toarray() + np.diag(held)
        factor = cho_factor(matrix)
        self.condition = float(np.linalg.cond(matrix))
        inverse = cho_solve(factor, np.eye(len(matrix)))
        return cho_solve(factor, right), self.noise**2 * inverse

    def _judge(self, touch: Places, taxel: Places, residual: Floats) -> None:
        """Drop what stands off; keep the root mean square of the rest."""
        spread = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
        bad = np.abs(residual) > OUTLIER * max(spread, self.noise)
        self.residual = float(np.sqrt(np.mean(residual[~bad] ** 2)))
        self.used[touch[bad], taxel[bad]] = False


def _estimate(
    fit: _Fit,
    data_sheet: Calibration,
    trusted: Bools,
    reached: Bools,
    offset: Floats,
    noise: float,
) -> Estimate:
    count, scale = fit.count, fit.residual / fit.noise
    covariance = fit.covariance * max(scale, 1.0) ** 2
    mean = float(fit.gain.mean())
    # The taxels are taken to be right on average; how far their mean is off is a matter of luck.
    luck = float(fit.gain.var()) / count
    mean_error = math.sqrt(float(covariance[:count, :count].mean()) / UNIT**2 + luck)
    by_time = data_sheet.signal == "time"
    ratio = 1.0 / mean if by_time else 1.0  # of the speed to that of the data sheet
    answer, rest = np.full(len(reached), 1.0 / ratio), offset.copy()
    answer[fit.taxels], rest[fit.taxels] = fit.gain, fit.offset
    gain = np.where(trusted, 1.0 / (ratio * answer), 0.0)
    drift = data_sheet.thickness * (1.0 - ratio)
    gain_error = np.where(trusted, np.nan, 0.0)
    offset_error = np.where(trusted, noise / np.sqrt(len(fit.presses.free)), 0.0)
    errors = np.sqrt(np.diag(covariance))
    gain_error[fit.taxels] = errors[:count] / UNIT / (ratio * fit.gain**2)
    offset_error[fit.taxels] = errors[count : 2 * count] / fit.gain
    return Estimate(
        gain=gain,
        gain_error=gain_error,
        offset=-(drift + ratio * rest) * gain,
        offset_error=offset_error,
        sound_speed=data_sheet.sound_speed * ratio,
        sound_speed_error=data_sheet.sound_speed * ratio**2 * mean_error if by_time else 0.0,
        noise=noise,
        trusted=trusted,
        reached=trusted & reached,
        pose_error=float(fit.spread[0]),
        residual=fit.residual,
        condition=fit.condition,
    )


def _noise(scatter: Floats) -> float:
    """Standard deviation of one taxel, robust against impulses."""
    frames = len(scatter)
    lost = np.sqrt(frames / max(frames - 1, 1))  # each taxel's own middle was taken away
    return float(MAD_TO_SIGMA * np.median(np.abs(scatter)) * lost)


def _trusted(presses: Presses, offset: Floats) -> Bools:
    """Which taxels answer to pressing, and only to pressing."""
    pressed = presses.known > LEAST_KNOWN
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(pressed, (presses.read - offset) / presses.known, np.nan)
    answering = np.ones(len(offset), bool)
    some = pressed.any(axis=0)
    answering[some] = np.nanmedian(share[:, some], axis=0) > DEAD_GAIN
    result: Bools = answering & (np.abs(offset) < STUCK)
    return result
