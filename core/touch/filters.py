"""From reported compression to what was touched: filters against noise and impulses.

Adaptive Wiener and median filters are those of Fung, 1999, section 3.4.2. For impulses there is a
robust one: a surface, however sharp, is even along some lines of three taxels through each taxel
(along an edge, down a face, on the level beside a step); an impulse is even along none. So impulses
are what a robust jet misses and no line of three supports; a whole face supports itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.core.arrays import Bools, Floats, Ints, scaled_mad
from palpate.core.touch.faults import FrameFault, check_image, frame_fault
from palpate.core.touch.jet import LEAST_TAXELS, fit_robust_jet, monomials
from palpate.core.touch.pad import CONTACT_DEVIATIONS, Pad, contact_mask

# Which filters, and which of two comes first.
FilterOrder = Literal["auto", "none", "wiener", "median", "median-first", "wiener-first"]
WINDOW = 3  # Taxels along a side of the neighbourhood
# In pitches: what bends a line of three by less, or stands off a jet by less, is left to the fit.
# It is half of what the tightest curve that has a curvature bends.
UNEVEN = 0.25
STANDS_OFF = 0.5  # In pitches: what stands off by more is looked at, however badly the jet fits
FAR = 6.0  # In between, robust deviations from the jet
BEND_DEVIATIONS = 2.0 * math.sqrt(6.0)  # By which noise alone may bend a line of three: two its own
APART_DEVIATIONS = 2.0 * math.sqrt(2.0)  # By which noise sets two taxels apart: two its own
NOISE_FAR = 4.0  # Deviations of the noise: what stands off by less is noise
# Of its misfit: what noise may bend a line that supports a taxel, for at the end of a line an
# impulse bends it by all of its misfit.
MOST_OWN_MISFIT = 0.6
OWN_MISFIT = 0.5  # A line supports a taxel if it bends by less than this share of its misfit
# Even lines of a taxel that can support others: the outermost of a step's corner has three, and so
# has the middle of five in a row. Impulses are seldom that many in a row.
CORE_LINES = 3
STRAIGHT = 0.05  # In pitches: what a line of three may bend, beside noise, to count as straight
# What holds a suspect is itself off by this share of what makes one: the rest of a ridge that the
# jet misses. From the even surface beside it an impulse gets no support.
ALSO_OFF = 0.5
LEVEL = 0.15  # In pitches: as high as this beside one that is no impulse, a taxel is none: a ridge
# In pitches: how far an impulse in the outermost rings stands beyond all that is about it; the
# array's own corners have three neighbours only.
BEYOND, BEYOND_IN_CORNERS = 0.15, 0.45
# Of the taxels that stand off the median about them, beyond which a frame tells of no surface. Of
# impulses in half of the taxels 0.3 do, of those in a third 0.2.
MAX_STRUCK = 0.25
MOST_REPAIRS = 4  # Rounds of repairing what the round before has left
MOST_BRINKS = 16  # Rounds in which those that do not are given up
WAYS = ((0, 1), (1, 0), (1, 1), (1, -1))  # Directions of the lines, in rows and columns


class CleanedImage(NamedTuple):
    """A tactile image, cleaned."""

    compression: Floats  # (rows, cols), m
    touched: Bools  # Where the pad touches, impulses left out, (rows, cols)
    impulses: int  # Taxels that stood out and were replaced; 0 if none were looked for
    fault: FrameFault = "none"  # What is wrong with the frame as a whole; then nothing is touched


def clean(
    pad: Pad,
    compression: Floats,
    noise: float,
    contact: float,
    order: FilterOrder,
    lost: Bools | None = None,
    *,
    pressed: bool = False,
) -> CleanedImage:
    """Filter a frame, and mark what is touched.

    `compression` (rows, cols): as the array reports it, m. `noise`: standard deviation of one
    taxel, m. `contact`: least compression that counts as touched, m, however quiet the sensor is.
    `order`: ``auto`` lets the frame decide: one without impulses stays as it is, for the jet that
    is fitted to it next averages noise better than any filter, and without its bias; in one with
    impulses a joint robust fit finds them, and what they hid is put in their place; one of little
    but impulses tells of no surface, and nothing in it counts as touched. The others are
    the filters of Fung, 1999, section 3.4.2, alone or in either order. `lost` (rows, cols) of bool:
    taxels that a calibration distrusts read as their neighbours, and as untouched. `pressed`:
    whether the guarded move ended on a surface. Raises ValueError if the image is not finite, or
    no image of this pad.
    """
    check_image(pad, "compression", compression)
    if lost is not None:
        cleaned = clean(pad, _filled(compression, lost), noise, contact, order, pressed=pressed)
        return cleaned._replace(touched=cleaned.touched & ~lost)
    smooth = median_filter(compression)  # what a few taxels do by themselves is no fault
    nothing = np.zeros(compression.shape, np.bool_)
    fault = frame_fault(pad, compression, smooth, noise, contact, pressed=pressed)
    alone = np.abs(compression - smooth)
    struck = alone > max(STANDS_OFF * pad.pitch, NOISE_FAR * noise)
    if order == "auto" and struck.mean() > MAX_STRUCK and fault in ("none", "saturated"):
        return CleanedImage(compression, nothing, int(np.count_nonzero(struck)))
    if fault != "none":
        return CleanedImage(compression, nothing, 0, fault)
    if order == "auto":
        least = max(contact, CONTACT_DEVIATIONS * noise)
        mended, impulses = remove_all_impulses(pad, compression, least, noise)
        found = contact_mask(pad, mended, contact, noise) & ~impulses
        return CleanedImage(mended, found, int(np.count_nonzero(impulses)))
    filtered = FILTERS[order](compression, noise**2)
    return CleanedImage(filtered, contact_mask(pad, filtered, contact, noise), 0)


def _filled(image: Floats, lost: Bools) -> Floats:
    """The image with lost taxels as the mean of their trusted neighbours, or 0 without any."""
    trusted = neighbourhoods((~lost).astype(np.float64))[lost]
    values = (neighbourhoods(image)[lost] * trusted).sum(axis=-1)
    filled = image.copy()
    filled[lost] = values / np.maximum(trusted.sum(axis=-1), 1.0)
    return filled


def adaptive_wiener(image: Floats, noise_variance: float) -> Floats:
    """Pull each taxel towards its neighbourhood's mean, by as much as noise explains.

    `image` (rows, cols): m. `noise_variance`: variance of one taxel's noise, m^2. With 0 the image
    comes back as it is. Fung, 1999, (3.4) to (3.9); variances stand where (3.6) prints deviations,
    borders are reflected, and a neighbourhood without any variance keeps its mean instead of 0/0.
    The variance is taken about the mean, so that a large offset costs no digits.
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

    Fung, 1999, section 3.4.2. It takes out what stands alone and keeps steps; but it cuts tops and
    makes plateaus, of which no curvature can be taken.
    """
    result: Floats = np.median(neighbourhoods(image), axis=-1)
    return result


def wiener_then_median(image: Floats, noise_variance: float) -> Floats:
    """Both filters in the order that Fung, 1999, prefers (figure 3.5).

    Impulses reach the Wiener filter, which takes them for signal and smears them.
    """
    return median_filter(adaptive_wiener(image, noise_variance))


def median_then_wiener(image: Floats, noise_variance: float) -> Floats:
    """Both filters in the order of figure 3.6: impulses are gone before noise is looked at."""
    return adaptive_wiener(median_filter(image), noise_variance)


def neighbourhoods(image: Floats) -> Floats:
    """The taxels around each taxel, (rows, cols, 9); reflected at the borders."""
    rows, cols = image.shape
    padded = np.empty((rows + 2, cols + 2))
    padded[1:-1, 1:-1] = image
    padded[0, 1:-1], padded[-1, 1:-1] = image[1], image[-2]
    padded[:, 0], padded[:, -1] = padded[:, 2], padded[:, -3]
    return sliding_window_view(padded, (WINDOW, WINDOW)).reshape(*image.shape, WINDOW * WINDOW)


class RepairedImage(NamedTuple):
    """An image without its impulses."""

    image: Floats  # What the surface would have given in place of the impulses, (rows, cols), m
    impulses: Bools  # Which taxels were impulses, (rows, cols): a fit should leave them out


def remove_impulses(pad: Pad, image: Floats, contact: float, noise: float) -> RepairedImage:
    """Find and mend the impulses of a frame.

    `image` (rows, cols): compression; about 0 where the pad does not touch, m. `contact`: least
    compression that counts as touched, m. `noise`: standard deviation of one taxel, m. A frame all
    of whose taxels lie on even lines is returned as it is. For the others a jet is fitted with
    Tukey's weights, beginning with the supported taxels. Where there is no surface to fit, what
    stands alone is an impulse, and three touched taxels side by side are a tip.
    """
    by_noise = BEND_DEVIATIONS * noise
    supported = _supported(pad, image, math.hypot(UNEVEN * pad.pitch, by_noise), by_noise)
    if supported.all():
        return RepairedImage(image, ~supported)
    touched = image > contact
    if np.count_nonzero(touched & supported) < LEAST_TAXELS:
        middle = touched & (_beside(touched) >= 2)  # Three touched taxels side by side are a tip
        impulses = touched & ~supported & ~(middle | (_beside(middle) > 0))
        off = image
    else:
        trusted = supported
        if by_noise > UNEVEN * pad.pitch:  # noise makes room for impulses on uneven lines
            trusted = supported & (np.abs(image - median_filter(image)) <= NOISE_FAR * noise)
        off, spread = _misfit(pad, image, touched, trusted, noise)
        far = min(max(FAR * spread, UNEVEN * pad.pitch), STANDS_OFF * pad.pitch)
        far = max(far, NOISE_FAR * noise)
        suspect = np.abs(off) > far
        most = np.minimum(by_noise, MOST_OWN_MISFIT * np.abs(off))
        allowed = np.maximum(OWN_MISFIT * np.abs(off), most)
        also_off = np.abs(off) > ALSO_OFF * far
        impulses = suspect & ~_supported(pad, image, allowed, by_noise, also_off)
        impulses &= ~_in_squares(impulses, image, UNEVEN * pad.pitch)
        impulses &= ~_level(
            image, impulses, math.hypot(LEVEL * pad.pitch, APART_DEVIATIONS * noise)
        )
    if not impulses.any():
        return RepairedImage(image, impulses)
    impulses &= ~_on_the_brink(pad, image, impulses)
    expected = np.maximum(image - off + _median_of_others(off, impulses), 0.0)
    return RepairedImage(np.where(impulses, expected, image), impulses)


def remove_all_impulses(pad: Pad, image: Floats, contact: float, noise: float) -> RepairedImage:
    """Remove impulses until none is left: those that remain in one round bend the jet of the next.

    Arguments as of `remove_impulses`. Without noise one round finds all that can be told.
    """
    repaired = remove_impulses(pad, image, contact, noise)
    impulses = repaired.impulses
    for _ in range(MOST_REPAIRS if noise > 0.0 and impulses.any() else 0):
        repaired = remove_impulses(pad, repaired.image, contact, noise)
        if not (repaired.impulses & ~impulses).any():
            break
        impulses = impulses | repaired.impulses
    return RepairedImage(repaired.image, impulses)


def _supported(
    pad: Pad, image: Floats, allowed: Floats | float, by_noise: float, holding: Bools | None = None
) -> Bools:
    """Which taxels lie on three even lines, or on one or two with others that do.

    A line is even for a taxel if it bends by no more than is allowed for that taxel. One line may
    be so by chance; it is enough if it is straight but for noise. An impulse up and one down lie
    evenly about what is between them, but neither lies on three lines.
    """
    bends = np.full((3 * len(WAYS), *image.shape), np.inf)
    for way, places in enumerate(_lines(*image.shape)):
        first, middle, last = (image[place] for place in places)
        bend = np.abs(first + last - 2.0 * middle)
        for role, place in enumerate(places):
            bends[3 * way + role][place] = bend
    even = bends <= allowed
    core: Bools = even.sum(axis=0) >= CORE_LINES
    if core.all():
        return core
    hold = core if holding is None else core & holding
    worth = even.astype(np.int64) + (bends <= math.hypot(STRAIGHT * pad.pitch, by_noise))
    leaning = np.zeros(image.shape, np.int64)
    for way, places in enumerate(_lines(*image.shape)):
        one, between, other = (hold[place] for place in places)
        others = (between & other, one & other, one & between)
        for role, (place, held) in enumerate(zip(places, others, strict=True)):
            leaning[place] += held * worth[3 * way + role][place]
    supported: Bools = core | (leaning >= 2)
    return supported


def _lines(rows: int, cols: int) -> Iterator[list[tuple[slice, slice]]]:
    """For each direction the first, middle and last taxels of all lines of three."""
    for down, right in WAYS:
        start, width = max(-2 * right, 0), cols - 2 * abs(right)
        yield [
            np.s_[
                step * down : step * down + rows - 2 * down,
                start + step * right : start + step * right + width,
            ]
            for step in range(3)
        ]


def _beside(marked: Bools) -> Ints:
    """How many of the four taxels beside each are marked."""
    padded = np.pad(marked.astype(np.int32), 1)
    return padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]


def _misfit(
    pad: Pad, image: Floats, touched: Bools, supported: Bools, noise: float
) -> tuple[Floats, float]:
    """Image less robust jet all over the pad, and the spread of that where it touches."""
    fit = fit_robust_jet(pad, image, touched, noise, supported.astype(np.float64))
    if fit is None:  # touched on a line
        return image, noise
    x, y = (axis.ravel() / fit.jet.scale for axis in pad.grid())
    expected = monomials(x, y, fit.jet.degree) @ fit.jet.coefficients
    spread = scaled_mad(fit.misfit[supported[touched]])
    # Beyond the contact the jet means nothing, and a pad is compressed by nothing.
    beside = neighbourhoods((touched & supported).astype(np.float64)).any(axis=-1)
    expected = np.where(beside, np.maximum(expected.reshape(image.shape), 0.0), 0.0)
    return image - expected, max(spread, noise)


def _in_squares(marked: Bools, image: Floats, most: float) -> Bools:
    """Which marked taxels belong to a square of four marked ones that differ by less than that.

    So do the four at the top of a cone, and hardly ever impulses.
    """
    corners = (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[:-1, 1:], np.s_[1:, 1:])
    high = np.maximum.reduce([image[corner] for corner in corners])
    low = np.minimum.reduce([image[corner] for corner in corners])
    whole = np.logical_and.reduce([marked[corner] for corner in corners]) & (high - low < most)
    found = np.zeros_like(marked)
    for corner in corners:
        found[corner] |= whole
    return found


def _level(image: Floats, impulses: Bools, least: float) -> Bools:
    """Which taxels are as high as one around them that is no impulse."""
    around = neighbourhoods(np.where(impulses, np.inf, image))
    nearest = np.abs(around - image[..., None]).min(axis=-1)
    found: Bools = nearest < least
    return found


def _on_the_brink(pad: Pad, image: Floats, marked: Bools) -> Bools:
    """Marked taxels of the two outermost rings that are not the highest or lowest about them.

    They lie on few lines, and a contact that runs off the array is steep there: they must stand
    beyond all their neighbours by a step, those left out that do so themselves.
    """
    ring = np.ones(image.shape, np.bool_)
    ring[2:-2, 2:-2] = False
    step = np.full(image.shape, BEYOND * pad.pitch)
    step[:: pad.rows - 1, :: pad.cols - 1] = BEYOND_IN_CORNERS * pad.pitch
    kept = marked.copy()
    for _ in range(MOST_BRINKS):
        around = neighbourhoods(np.where(kept, np.nan, image))
        high = np.nan_to_num(around, nan=-np.inf).max(axis=-1)
        low = np.nan_to_num(around, nan=np.inf).min(axis=-1)
        given_up = kept & ring & (image <= high + step) & (image >= low - step)
        if not given_up.any():
            break
        kept &= ~given_up
    return marked & ~kept


def _median_of_others(off: Floats, impulses: Bools) -> Floats:
    """Median misfit of the taxels around each that are no impulses; 0 if all are."""
    around = np.sort(neighbourhoods(np.where(impulses, np.inf, off)), axis=-1)
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
