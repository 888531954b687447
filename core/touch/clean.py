"""From the compression that an array reports to what was touched: one choice of filters."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.contact import SPREADS, touched
from palpate.core.touch.filters import (
    adaptive_wiener,
    median_filter,
    median_then_wiener,
    neighbourhoods,
    wiener_then_median,
)
from palpate.core.touch.impulses import robust_clean
from palpate.core.touch.pad import Pad

Order = Literal["auto", "none", "wiener", "median", "median-first", "wiener-first"]
"""Which filters, and which of two comes first."""


class Cleaned(NamedTuple):
    """A tactile image, cleaned."""

    compression: Floats
    """(rows, cols), m."""
    touched: Bools
    """Where the pad touches, impulses left out, (rows, cols)."""
    impulses: int
    """Taxels that stood out like impulses, and were replaced; 0 if none were looked for."""


def clean(
    pad: Pad,
    compression: Floats,
    noise: float,
    contact: float,
    order: Order,
    lost: Bools | None = None,
) -> Cleaned:
    """Filter a frame, and mark what is touched.

    Parameters
    ----------
    pad : Pad
        The array.
    compression : (rows, cols) array
        As the array reports it, m.
    noise : float
        Standard deviation of one taxel, m.
    contact : float
        Least compression that counts as touched, m, however quiet the sensor is.
    order : Order
        ``auto`` lets the frame decide: one without impulses stays as it is, for the jet that
        is fitted to it next averages noise better than any filter, and without its bias; in
        one with impulses a joint robust fit finds them, and what they hid is put in their
        place. The others are the filters of Fung, 1999, section 3.4.2, alone or in either
        order.
    lost : (rows, cols) array of bool, optional
        Taxels that a calibration does not trust: they read what their neighbours do, and
        count as untouched.
    """
    if lost is not None:
        cleaned = clean(pad, _filled(compression, lost), noise, contact, order)
        return cleaned._replace(touched=cleaned.touched & ~lost)
    if order == "auto":
        least = max(contact, SPREADS * noise)
        mended, impulses = robust_clean(pad, compression, least, noise)
        found = touched(pad, mended, contact, noise) & ~impulses
        return Cleaned(mended, found, int(np.count_nonzero(impulses)))
    filtered = _filtered(compression, noise**2, order)
    return Cleaned(filtered, touched(pad, filtered, contact, noise), 0)


def _filtered(image: Floats, variance: float, order: Order) -> Floats:
    if order == "wiener":
        return adaptive_wiener(image, variance)
    if order == "median":
        return median_filter(image)
    if order == "median-first":
        return median_then_wiener(image, variance)
    if order == "wiener-first":
        return wiener_then_median(image, variance)
    return image


def _filled(image: Floats, lost: Bools) -> Floats:
    """The image with the mean of their trusted neighbours in place of lost taxels.

    A taxel without any is 0.
    """
    trusted = neighbourhoods((~lost).astype(np.float64))[lost]
    values = (neighbourhoods(image)[lost] * trusted).sum(axis=-1)
    filled = image.copy()
    filled[lost] = values / np.maximum(trusted.sum(axis=-1), 1.0)
    return filled
