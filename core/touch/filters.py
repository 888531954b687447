"""From reported compression to what was touched: filters against noise and impulses.

Adaptive Wiener and median filters are those of Fung, 1999, section 3.4.2. Impulses have a robust
one: a surface, however sharp, is even along some lines of three taxels through each taxel (along an
edge, down a face, on the level beside a step); an impulse is even along none. So impulses are
taxels that a robust jet misses and no line of three supports; a whole face supports itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.core.arrays import Bools, Floats, Ints, scaled_mad
from palpate.core.touch.faults import FrameFault, check_image, frame_fault
from palpate.core.touch.jet import fit_robust_jet, monomials, supported_degree
from palpate.core.touch.pad import DEFAULT_CONTACT, Pad, contact_mask

# Which filters are applied, and which of two comes first.
FilterOrder = Literal["auto", "none", "wiener", "median", "median-first", "wiener-first"]
LINE_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))  # of lines of three taxels, in rows and columns


@dataclass(frozen=True, slots=True, kw_only=True)
class ImpulseSettings:
    """When a taxel counts as an impulse, and when a frame has too many of them."""

    # Smaller bends of a line of three, and smaller offsets from the jet, are no impulses. The
    # tightest curve that counts as smooth bends a line of three by twice as much.
    tolerance: float = 0.25  # [pitches]
    max_offset: float = 0.5  # [pitches] from the jet; larger ones are always suspect
    outlier_sigmas: float = 6.0  # robust deviations from the jet, suspect between those two limits
    noise_sigmas: float = 4.0  # of one taxel; smaller offsets are noise
    contrast_sigmas: float = 2.0  # of bends of three taxels and steps of two; smaller are noise
    max_bend_share: float = 0.5  # bend of an even line, at most, over the taxel's offset
    # Largest bend that noise may excuse, over the same offset. It is below 1 because an impulse at
    # the end of a line bends it by its whole offset.
    max_noise_share: float = 0.6
    # Even lines that a core taxel needs; only these support others. The tip of a step's corner has
    # three, and so has the middle of five taxels in a row; five impulses in a row are rare.
    min_core_lines: int = 3
    straight_bend: float = 0.05  # [pitches] of a straight line of three, at most, without noise
    # Least offset of supporting taxels, over the least offset of a suspect. The jet misses the rest
    # of a ridge as well, which supports it; it follows the even surface beside an impulse.
    min_support_share: float = 0.5
    level_offset: float = 0.15  # [pitches] in height from a sound neighbour; less is no impulse
    # Least step of an impulse in the two outermost rings from all its neighbours.
    border_step: float = 0.15  # [pitches]
    corner_step: float = 0.45  # [pitches] in the array's corners, which have three neighbours


@dataclass(frozen=True, slots=True, kw_only=True)
class CleaningSettings:
    """When a frame is repaired, and when it has too many impulses to show a surface."""

    contact_sigmas: float = DEFAULT_CONTACT.min_sigmas  # of a touched taxel's noise, at least
    impulses: ImpulseSettings = ImpulseSettings()
    # Fraction of taxels off the median around them; with more, none counts as touched. Impulses in
    # half of the taxels give 0.3, in a third 0.2.
    max_impulse_share: float = 0.25
    n_repairs: int = 4  # rounds at most after the first


class CleanedImage(NamedTuple):
    """A tactile image, cleaned."""

    compression: Floats  # (rows, cols) [m]
    touched: Bools  # (rows, cols), without impulses
    impulses: int  # number of replaced taxels; 0 if none were sought
    fault: FrameFault = "none"  # of the whole frame; if there is one, nothing is touched


def clean(
    pad: Pad,
    compression: Floats,
    noise: float,
    contact: float,
    order: FilterOrder,
    lost: Bools | None = None,
    *,
    pressed: bool = False,
    settings: CleaningSettings = CleaningSettings(),
) -> CleanedImage:
    """Filter a frame, and mark what is touched.

    `compression` (rows, cols): as the array reports it [m]. `noise`: standard deviation of one
    taxel [m]. `contact`: least compression that counts as touched [m], however quiet the sensor is.
    `order`: with ``auto`` a frame without impulses stays as it is, because the jet that is fitted
    to it next averages noise better than any filter, and without its bias; in a frame with impulses
    a joint robust fit finds and replaces them; in a frame of little but impulses nothing counts as
    touched. The others are the filters of Fung, 1999, section 3.4.2, alone or in either order.
    `lost` (rows, cols) of bool: taxels that a calibration distrusts get the mean of their
    neighbours, and count as untouched. `pressed`: whether the guarded move ended on a surface.
    Raises ValueError if the image is not finite, or has another shape than the pad.
    """
    check_image(pad, "compression", compression)
    if lost is not None:
        filled = _filled(compression, lost)
        cleaned = clean(pad, filled, noise, contact, order, pressed=pressed, settings=settings)
        return cleaned._replace(touched=cleaned.touched & ~lost)
    smooth = median_filter(compression)  # single taxels that stand out are no fault of the frame
    nothing = np.zeros(compression.shape, np.bool_)
    fault = frame_fault(pad, compression, smooth, noise, contact, pressed=pressed)
    impulsive = settings.impulses
    limit = max(impulsive.max_offset * pad.pitch, impulsive.noise_sigmas * noise)
    isolated = np.abs(compression - smooth) > limit
    too_many = isolated.mean() > settings.max_impulse_share
    if order == "auto" and too_many and fault in ("none", "saturated"):
        return CleanedImage(compression, nothing, int(np.count_nonzero(isolated)))
    if fault != "none":
        return CleanedImage(compression, nothing, 0, fault)
    if order == "auto":
        min_contact = max(contact, settings.contact_sigmas * noise)
        repaired, impulses = remove_all_impulses(pad, compression, min_contact, noise, settings)
        touched = contact_mask(pad, repaired, contact, noise, settings.contact_sigmas) & ~impulses
        return CleanedImage(repaired, touched, int(np.count_nonzero(impulses)))
    filtered = FILTERS[order](compression, noise**2)
    touched = contact_mask(pad, filtered, contact, noise, settings.contact_sigmas)
    return CleanedImage(filtered, touched, 0)


def _filled(image: Floats, lost: Bools) -> Floats:
    """The image with lost taxels as the mean of their trusted neighbours, or 0 without any."""
    trusted = neighbourhoods((~lost).astype(np.float64))[lost]
    values = (neighbourhoods(image)[lost] * trusted).sum(axis=-1)
    filled = image.copy()
    filled[lost] = values / np.maximum(trusted.sum(axis=-1), 1.0)
    return filled


def adaptive_wiener(image: Floats, noise_variance: float) -> Floats:
    """Pull each taxel towards its neighbourhood's mean, by the share that noise explains.

    `image` (rows, cols) [m]. `noise_variance`: variance of one taxel's noise [m^2]. With 0 the
    image is returned unchanged. Fung, 1999, (3.4) to (3.9), with variances in place of the
    deviations in (3.6), and reflected borders; a neighbourhood without any variance keeps its mean
    instead of 0/0. The variance is taken about the mean, so that a large offset costs no digits.
    """
    if noise_variance <= 0.0:
        return image
    around = neighbourhoods(image)
    mean = around.mean(axis=-1)
    variance = ((around - mean[..., None]) ** 2).mean(axis=-1)
    signal = np.maximum(variance - noise_variance, 0.0)
    share = signal / np.maximum(variance, noise_variance)
    result: Floats = mean + share * (image - mean)
    return result


def median_filter(image: Floats) -> Floats:
    """The median of each taxel and the eight around it, borders reflected.

    Fung, 1999, section 3.4.2. It removes single taxels and keeps steps; but it cuts tops into
    plateaus, which have no curvature.
    """
    result: Floats = np.median(neighbourhoods(image), axis=-1)
    return result


def wiener_then_median(image: Floats, noise_variance: float) -> Floats:
    """Both filters in the order that Fung, 1999, prefers (figure 3.5).

    Impulses reach the Wiener filter, which treats them as signal and smears them.
    """
    return median_filter(adaptive_wiener(image, noise_variance))


def median_then_wiener(image: Floats, noise_variance: float) -> Floats:
    """Both filters in the order of figure 3.6: impulses are removed before noise."""
    return adaptive_wiener(median_filter(image), noise_variance)


def neighbourhoods(image: Floats) -> Floats:
    """The taxels around each taxel, (rows, cols, 9); reflected at the borders."""
    rows, cols = image.shape
    padded = np.empty((rows + 2, cols + 2))
    padded[1:-1, 1:-1] = image
    padded[0, 1:-1], padded[-1, 1:-1] = image[1], image[-2]
    padded[:, 0], padded[:, -1] = padded[:, 2], padded[:, -3]
    return sliding_window_view(padded, (3, 3)).reshape(*image.shape, 9)


class RepairedImage(NamedTuple):
    """An image without its impulses."""

    image: Floats  # (rows, cols) [m], impulses replaced by an estimate of the surface
    impulses: Bools  # (rows, cols); a fit should leave them out


def remove_impulses(
    pad: Pad,
    image: Floats,
    contact: float,
    noise: float,
    settings: ImpulseSettings = ImpulseSettings(),
) -> RepairedImage:
    """Find and replace the impulses of a frame.

    `image` (rows, cols): compression [m], about 0 where the pad does not touch. `contact`: least
    compression that counts as touched [m]. `noise`: standard deviation of one taxel [m]. A frame
    all of whose taxels lie on even lines is returned unchanged. To any other a jet is fitted with
    Tukey's weights, beginning with the supported taxels. Where too few taxels are supported for a
    jet, isolated taxels are impulses, and three touched taxels side by side are a tip.
    """
    tolerance = settings.tolerance * pad.pitch
    noise_bend = settings.contrast_sigmas * math.sqrt(6.0) * noise
    supported = _supported(pad, image, math.hypot(tolerance, noise_bend), noise_bend, settings)
    if supported.all():
        return RepairedImage(image, ~supported)
    touched = image > contact
    if not supported_degree(int(np.count_nonzero(touched & supported))):
        middle = touched & (_beside(touched) >= 2)  # Three touched taxels side by side are a tip
        impulses = touched & ~supported & ~(middle | (_beside(middle) > 0))
        offset = image
    else:
        trusted = supported
        if noise_bend > tolerance:  # so much noise hides impulses on uneven lines
            near = np.abs(image - median_filter(image)) <= settings.noise_sigmas * noise
            trusted = supported & near
        offset, spread = _misfit(pad, image, touched, trusted, noise)
        impulses = _unsupported(pad, image, offset, spread, noise, settings)
    if not impulses.any():
        return RepairedImage(image, impulses)
    impulses &= ~_inconclusive_at_border(pad, image, impulses, settings)
    expected = np.maximum(image - offset + _median_around(offset, impulses), 0.0)
    return RepairedImage(np.where(impulses, expected, image), impulses)


def _unsupported(
    pad: Pad,
    image: Floats,
    offset: Floats,
    spread: float,
    noise: float,
    settings: ImpulseSettings,
) -> Bools:
    """Taxels far off the jet that neither lines of three nor neighbours support, (rows, cols)."""
    tolerance, size = settings.tolerance * pad.pitch, np.abs(offset)
    noise_bend = settings.contrast_sigmas * math.sqrt(6.0) * noise
    limit = min(max(settings.outlier_sigmas * spread, tolerance), settings.max_offset * pad.pitch)
    limit = max(limit, settings.noise_sigmas * noise)
    by_noise = np.minimum(noise_bend, settings.max_noise_share * size)
    max_bend = np.maximum(settings.max_bend_share * size, by_noise)
    supporting = size > settings.min_support_share * limit
    impulses = (size > limit) & ~_supported(pad, image, max_bend, noise_bend, settings, supporting)
    impulses &= ~_in_squares(impulses, image, tolerance)
    noise_step = settings.contrast_sigmas * math.sqrt(2.0) * noise
    return impulses & ~_level(
        image, impulses, math.hypot(settings.level_offset * pad.pitch, noise_step)
    )


def remove_all_impulses(
    pad: Pad,
    image: Floats,
    contact: float,
    noise: float,
    settings: CleaningSettings = CleaningSettings(),
) -> RepairedImage:
    """Remove impulses in several rounds: those that remain after one bend the jet of the next.

    Arguments as of `remove_impulses`. Without noise one round is enough.
    """
    repaired = remove_impulses(pad, image, contact, noise, settings.impulses)
    impulses = repaired.impulses
    for _ in range(settings.n_repairs if noise > 0.0 and impulses.any() else 0):
        repaired = remove_impulses(pad, repaired.image, contact, noise, settings.impulses)
        if not (repaired.impulses & ~impulses).any():
            break
        impulses = impulses | repaired.impulses
    return RepairedImage(repaired.image, impulses)


def _supported(
    pad: Pad,
    image: Floats,
    max_bend: Floats | float,
    noise_bend: float,
    settings: ImpulseSettings,
    supporting: Bools | None = None,
) -> Bools:
    """Taxels that lie on three even lines, or on one or two with core taxels that do.

    A line is even for a taxel if it bends by no more than that taxel's `max_bend`. One line may be
    even by chance; it counts twice if it is straight but for noise. An impulse up and one down are
    even about the taxel between them, but neither lies on three even lines. `supporting`: core
    taxels outside this mask support no others.
    """
    lines = list(_lines(*image.shape))
    bends = np.full((len(lines), 3, *image.shape), np.inf)
    for places, of_line in zip(lines, bends, strict=True):
        first, middle, last = (image[place] for place in places)
        bend = np.abs(first + last - 2.0 * middle)
        for place, of_taxel in zip(places, of_line, strict=True):
            of_taxel[place] = bend
    even = bends <= max_bend
    core: Bools = even.sum(axis=(0, 1)) >= settings.min_core_lines
    if core.all():
        return core
    firm = core if supporting is None else core & supporting
    straight = bends <= math.hypot(settings.straight_bend * pad.pitch, noise_bend)
    votes = even.astype(np.int64) + straight
    support = np.zeros(image.shape, np.int64)
    for places, of_line in zip(lines, votes, strict=True):
        a, b, c = (firm[place] for place in places)
        both_firm = (b & c, a & c, a & b)
        for place, both, of_taxel in zip(places, both_firm, of_line, strict=True):
            support[place] += both * of_taxel[place]
    supported: Bools = core | (support >= 2)
    return supported


def _lines(rows: int, cols: int) -> Iterator[list[tuple[slice, slice]]]:
    """For each direction the first, middle and last taxels of all lines of three."""
    for down, right in LINE_DIRECTIONS:
        start, width = max(-2 * right, 0), cols - 2 * abs(right)
        yield [
            np.s_[
                step * down : step * down + rows - 2 * down,
                start + step * right : start + step * right + width,
            ]
            for step in range(3)
        ]


def _beside(marked: Bools) -> Ints:
    """Number of marked taxels among the four beside each."""
    padded = np.pad(marked.astype(np.int32), 1)
    return padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]


def _misfit(
    pad: Pad, image: Floats, touched: Bools, supported: Bools, noise: float
) -> tuple[Floats, float]:
    """Image less robust jet on the whole pad, and its spread where the pad touches."""
    fit = fit_robust_jet(pad, image, touched, noise, supported.astype(np.float64))
    if fit is None:  # the touched taxels lie on a line
        return image, noise
    x, y = (axis.ravel() / fit.jet.scale for axis in pad.grid())
    expected = monomials(x, y, fit.jet.degree) @ fit.jet.coefficients
    spread = scaled_mad(fit.misfit[supported[touched]])
    # Beyond the contact the jet does not apply, and the pad is not compressed.
    beside = neighbourhoods((touched & supported).astype(np.float64)).any(axis=-1)
    expected = np.where(beside, np.maximum(expected.reshape(image.shape), 0.0), 0.0)
    return image - expected, max(spread, noise)


def _in_squares(marked: Bools, image: Floats, max_step: float) -> Bools:
    """Marked taxels that belong to a square of four marked ones which differ by less than a step.

    The four at the top of a cone do, and impulses hardly ever.
    """
    corners = (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[:-1, 1:], np.s_[1:, 1:])
    high = np.maximum.reduce([image[corner] for corner in corners])
    low = np.minimum.reduce([image[corner] for corner in corners])
    whole = np.logical_and.reduce([marked[corner] for corner in corners]) & (high - low < max_step)
    result = np.zeros_like(marked)
    for corner in corners:
        result[corner] |= whole
    return result


def _level(image: Floats, impulses: Bools, max_step: float) -> Bools:
    """Taxels within a step of a neighbour that is no impulse."""
    around = neighbourhoods(np.where(impulses, np.inf, image))
    nearest = np.abs(around - image[..., None]).min(axis=-1)
    result: Bools = nearest < max_step
    return result


def _inconclusive_at_border(
    pad: Pad, image: Floats, marked: Bools, settings: ImpulseSettings, n_rounds: int = 16
) -> Bools:
    """Marked taxels of the two outermost rings that are not the highest or lowest around them.

    They lie on few lines, and a contact that extends beyond the array is steep there: they must
    exceed by a step all neighbours that remain unmarked.
    """
    ring = np.ones(image.shape, np.bool_)
    ring[2:-2, 2:-2] = False
    step = np.full(image.shape, settings.border_step * pad.pitch)
    step[:: pad.rows - 1, :: pad.cols - 1] = settings.corner_step * pad.pitch
    kept = marked.copy()
    for _ in range(n_rounds):
        around = neighbourhoods(np.where(kept, np.nan, image))
        high = np.nan_to_num(around, nan=-np.inf).max(axis=-1)
        low = np.nan_to_num(around, nan=np.inf).min(axis=-1)
        inside = kept & ring & (image <= high + step) & (image >= low - step)
        if not inside.any():
            break
        kept &= ~inside
    return marked & ~kept


def _median_around(offset: Floats, impulses: Bools) -> Floats:
    """Median offset of the taxels around each that are no impulses; 0 if all are."""
    around = np.sort(neighbourhoods(np.where(impulses, np.inf, offset)), axis=-1)
    count = np.isfinite(around).sum(axis=-1)
    middle = np.take_along_axis(around, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]
    return np.where(count > 0, middle, 0.0)


FILTERS: Mapping[FilterOrder, Callable[[Floats, float], Floats]] = {
    "none": lambda image, variance: image,
    "wiener": adaptive_wiener,
    "median": lambda image, variance: median_filter(image),
    "median-first": median_then_wiener,
    "wiener-first": wiener_then_median,
}
