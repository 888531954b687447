"""From the compression that an array reports to what was touched: one choice of filters."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.contact import touched
from palpate.core.touch.filters import adaptive_wiener, median_filter
from palpate.core.touch.pad import Pad

Order = Literal["auto", "none", "wiener", "median", "median-first", "wiener-first", "robust"]

CONTACT_SPREADS = 5.0
"""A taxel counts as touched from 5 standard deviations of its noise on: at 3, one in a
thousand untouched ones would put a point where there is no surface."""
TIP = 0.5
"""In pitches: no tip that a pad can feel stands higher over all the taxels around it."""


class Cleaned(NamedTuple):
    """A tactile image, cleaned."""

    compression: Floats
    """(rows, cols), m."""
    touched: Bools
    """Where the pad touches, (rows, cols)."""
    impulses: int
    """Taxels that stood out like impulses."""


def clean(pad: Pad, compression: Floats, noise: float, contact: float, order: Order) -> Cleaned:
    """Filter a frame and mark what is touched."""
    smoothed = adaptive_wiener(compression, noise**2)
    cleaned, impulses = median_filter(smoothed, step=TIP * pad.pitch)
    found = touched(pad, cleaned, max(contact, CONTACT_SPREADS * noise))
    return Cleaned(cleaned, found, int(np.count_nonzero(impulses)))
