"""Frames that no surface can have made: dead, saturated, frozen and impossible ones.

A frame is checked before a surface is fitted to it. A few wrong taxels are left to the filters; a
frame is at fault where so many are wrong that the rest shows no surface. A failing array is then
reported by the name of its fault, not as a curved surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.touch.jet import fit_jet, monomials
from palpate.core.touch.pad import DEFAULT_CONTACT, Pad

MIN_SIDE = 4  # rows and columns of an array
FrameFault = Literal["none", "dead", "impossible", "saturated", "frozen"]
FAULTS: dict[FrameFault, str] = {
    "none": "",
    "dead": "the pad was pressed and no taxel reads anything",
    "impossible": "taxels read less than nothing, or more than the pad is thick",
    "saturated": "most taxels read as much as they can",
    "frozen": "a frame with noise came again, digit for digit, from another place",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSettings:
    """Limits of a frame that a surface can have made."""

    max_impossible_share: float = 0.25  # fraction of all taxels
    max_saturated_share: float = 0.5  # fraction of the touched taxels, saturated or impossible
    min_negative: float = 0.5  # [pitches] below zero, of an impossible reading; less is drift
    noise_sigmas: float = DEFAULT_CONTACT.min_sigmas  # of a taxel; noise stays within them
    min_white_noise: float = 1.2  # noise over that of rounding; with more no frame repeats
    rounding: float = 1e-9  # of readings that are equal, or at the limit; fraction of them


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateauSettings:
    """When equal largest readings (a plateau) are a cut-off, and not the top of a surface."""

    rounding: float = FrameSettings().rounding  # fraction of the largest reading
    min_taxels: int = 3  # fewer are the top of a surface that lies evenly on the grid
    max_share: float = 0.5  # of the touched taxels; more are a cut-off if no quadric fits the rest
    # A surface that was cut off would rise beyond the plateau by the larger of both.
    min_excess: float = 0.008  # [pitches]
    noise_sigmas: float = 4.0  # standard deviations of a taxel
    min_curvature: float = 0.005  # [1 / pitches] of the lower taxels; less is a face
    min_lines: int = 5  # rows, and columns, with lower taxels; fewer show no curvature
    max_level_share: float = 0.3  # of the taxels beside the plateau, at its height; more are a face
    max_opening: float = 0.75 * math.pi  # [rad] around it without lower taxels; more is an edge


def check_image(pad: Pad, name: str, image: Floats | Bools) -> None:
    """Raise ValueError unless an image is finite and has the pad's (rows, cols), at least 4."""
    if min(pad.rows, pad.cols) < MIN_SIDE:
        raise ValueError(
            f"a pad must have at least {MIN_SIDE} by {MIN_SIDE} taxels, got {pad.rows} by "
            f"{pad.cols}"
        )
    finite_array(name, image, (pad.rows, pad.cols))


def frame_fault(
    pad: Pad,
    compression: Floats,
    smooth: Floats,
    noise: float,
    contact: float,
    *,
    pressed: bool = False,
    settings: FrameSettings = FrameSettings(),
) -> FrameFault:
    """Fault of a frame as a whole.

    `compression` (rows, cols): as the array reports it [m]. `smooth` (rows, cols): the same without
    impulses, which are no fault [m]. `noise`: standard deviation of one taxel [m]. `contact`: least
    compression that counts as touched [m]. `pressed`: whether the guarded move ended on a surface,
    so that some taxel must read it.
    """
    limit, spread = pad.saturation * pad.thickness, settings.noise_sigmas * noise
    max_possible = 0.5 * (limit + pad.thickness) + spread  # halfway to the transducers
    min_possible = -max(settings.min_negative * pad.pitch, spread)
    touched = smooth > max(contact, spread)
    wrong = np.count_nonzero((smooth > max_possible) | (smooth < min_possible))
    if wrong > settings.max_impossible_share * smooth.size or (
        wrong > settings.max_saturated_share * np.count_nonzero(touched) > 0.0
    ):
        return "impossible"
    if not touched.any():
        is_felt = (compression > max(contact, spread)).any()
        return "dead" if pressed and not is_felt else "none"
    full = smooth[touched] >= limit * (1.0 - settings.rounding)
    return "saturated" if full.mean() > settings.max_saturated_share else "none"


def pressed_fault(
    pad: Pad, height: Floats, touched: Bools, settings: FrameSettings = FrameSettings()
) -> FrameFault:
    """Fault of a surface on which all touched taxels read the same, at or over the pad's limit.

    `height` (rows, cols): over the plane of the pad's face [m]. `touched` (rows, cols): at least
    one. Heights that differ may be over any other plane, and are not checked.
    """
    compression = -(height + pad.sag())[touched]
    largest, rounding = float(compression.max()), settings.rounding
    if largest - float(compression.min()) > rounding * abs(largest):
        return "none"
    if largest >= pad.thickness * (1.0 - rounding):
        return "impossible"
    return "saturated" if largest >= pad.saturation * pad.thickness * (1.0 - rounding) else "none"


def is_repeated(
    compression: Floats, before: Floats, noise: float, settings: FrameSettings = FrameSettings()
) -> bool:
    """Whether a frame equals that of another touch although noise should make them differ.

    Both (rows, cols) [m]; `noise`: standard deviation of one taxel [m]. Without noise, or where it
    is only that of rounding to steps, touches of an even surface may give equal frames.
    """
    if noise <= 0.0 or not np.array_equal(compression, before):
        return False
    steps = np.diff(np.unique(compression))
    rounding = 1e-6 * noise  # of arithmetic, not of the array
    steps = steps[steps > rounding]
    if not len(steps):  # all taxels read the same: no noise shows
        return False
    return noise > settings.min_white_noise * float(steps.min()) / math.sqrt(12.0)


def cut_off_taxels(
    pad: Pad,
    height: Floats,
    touched: Bools,
    noise: float,
    settings: PlateauSettings = PlateauSettings(),
) -> Bools | None:
    """Touched taxels that read the same largest compression although the surface rises beyond it.

    `height` (rows, cols): surface over the plane of the pad's face [m]. The jet of the lower taxels
    is curved, and rises beyond the equal ones by more than noise. None if there are none.
    """
    compression = -(height + pad.sag())
    top = float(compression[touched].max())
    plateau = touched & (compression >= top - settings.rounding * abs(top))
    if np.count_nonzero(plateau) < settings.min_taxels:
        return None
    lower = touched & ~plateau
    if not lower.any() and pad.dome == 0.0:
        return None  # a plane that the pad met squarely
    level = touched & (np.abs(height - height[plateau].mean()) <= settings.min_excess * pad.pitch)
    if lower.any() and level[_around(plateau)].mean() > settings.max_level_share:
        return None  # a plane with an edge beside the middle of a domed pad
    if lower.any() and _opening(plateau, lower) > settings.max_opening:
        return None
    min_excess = max(settings.min_excess * pad.pitch, settings.noise_sigmas * noise)
    fit = fit_jet(pad, height, lower, noise)
    if fit is None or fit.jet.degree < 2:
        mostly = np.count_nonzero(plateau) > settings.max_share * np.count_nonzero(touched)
        is_level = lower.any() and top - np.median(compression[lower]) < min_excess
        return plateau if mostly and not is_level else None
    if min(lower.any(axis=0).sum(), lower.any(axis=1).sum()) < settings.min_lines:
        return None  # so few lines have no measurable curvature across them
    bends = np.abs(fit.derivatives[2:]).max() * pad.pitch
    x, y = (axis[plateau] / fit.jet.scale for axis in pad.grid())
    expected = monomials(x, y, fit.jet.degree) @ fit.jet.coefficients
    excess = float(np.mean(height[plateau] - expected))
    return plateau if excess > min_excess and bends > settings.min_curvature else None


def _around(plateau: Bools) -> Bools:
    """Taxels (rows, cols) that lie next to the plateau."""
    beside = sliding_window_view(np.pad(plateau, 1), (3, 3)).any(axis=(2, 3))
    return np.asarray(beside & ~plateau)


def _opening(plateau: Bools, lower: Bools) -> float:
    """Widest angle [rad] about the middle of the plateau without lower taxels."""
    middle = np.argwhere(plateau).mean(axis=0)
    away = np.argwhere(lower) - middle
    turns = np.sort(np.arctan2(away[:, 0], away[:, 1]))
    return float(np.diff(turns, append=turns[0] + 2.0 * math.pi).max())
