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

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.calibration import Calibration
from palpate.core.touch.filters import MAD_TO_SIGMA
from palpate.core.touch.taxel_fit import LEAST_SPREAD, UNIT, Found, Presses, TaxelFit

LEAST_PRESSES = 4
"""A taxel needs this many presses for a gain and an offset of its own."""
LEAST_KNOWN = 0.15e-3
"""Compressions below this are left out, m: an error of pose could have lifted the pad off."""
DEAD_GAIN = 0.3
"""A taxel that answers with less than this share of what it is pressed by is not trusted."""
STUCK = 0.2e-3
"""Nor is one that reads more than this beside the others when nothing is touched, m."""
SWEEPS = 8
LEAST_NOISE = 1e-7
"""No array is quieter, m: with less, a prior would say nothing beside the readings."""
LEAST_REACHED = 16
FAR = 6.0
"""Free readings farther off than this many scales are impulses."""


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
        If too few taxels answer to being pressed.

    Notes
    -----
    Fung, 1999, section 3.4.1, asks for "careful sensor calibration" and says no more. With
    times of flight a wrong speed of sound is a gain common to all taxels: the common gain is
    given to the speed, and what is left to the taxels. So is whatever else makes all taxels
    answer alike, as a pad that creeps does.
    """
    found = _look(presses)
    fit = TaxelFit(presses, x, y, found)
    try:
        for _ in range(SWEEPS):
            fit.sweep()
    except np.linalg.LinAlgError:
        raise ValueError("the readings do not tell gains from errors of the pose") from None
    return _estimate(fit, found, data_sheet)


def _estimate(fit: TaxelFit, found: Found, data_sheet: Calibration) -> Estimate:
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
    return Estimate(
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


def _look(presses: Presses) -> Found:
    """What each taxel reads at rest, whom to trust, and how noisy they are.

    Raises
    ------
    ValueError
        If too few taxels answer to pressing.
    """
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
    return Found(rest, trusted, reached, used & reached, noise)


def _noise(scatter: Floats) -> float:
    """Standard deviation of one taxel, without impulses.

    Of a frame that is counted in coarse steps most readings are alike, and the median of
    their scatter is 0: then the smallest step that is seen says what is far off.
    """
    frames, off = len(scatter), np.abs(scatter)
    steps = off[off > LEAST_SPREAD]
    scale = max(MAD_TO_SIGMA * float(np.median(off)), float(steps.min(initial=np.inf)))
    if not math.isfinite(scale):
        return 0.0
    lost = math.sqrt(frames / max(frames - 1, 1))  # each taxel's own middle was taken away
    return lost * float(np.sqrt(np.mean(scatter[off <= FAR * scale] ** 2)))


def _trusted(presses: Presses, offset: Floats) -> Bools:
    """Which taxels answer to pressing, and only to pressing."""
    pressed = presses.known > LEAST_KNOWN
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(pressed, (presses.read - offset) / presses.known, np.nan)
    answering = np.ones(len(offset), bool)
    some = pressed.any(axis=0)
    answering[some] = np.nanmedian(share[:, some], axis=0) > DEAD_GAIN
    result: Bools = answering & (np.abs(offset - np.median(offset)) < STUCK)
    return result
