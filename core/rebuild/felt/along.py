"""The spline along the side's height: even spans, halved again and again towards both ends.

There the squared distance from the axis may rise with an infinite slope, as on ends that are
blunter than a ball's; splines on halved spans follow that where even ones swing.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.skin.bending import bending_along
from palpate.core.splines.basis import Basis
from palpate.core.splines.knots import CUBIC

SPANS = 45
"""Even spans."""
HALVED = 4
"""Times that the first and the last of them are halved."""
WIDTHS = 3
"""Power of a span's width by which its bending counts: a root that begins there bends each half of
a span more than the whole, and is not flattened."""


@lru_cache(maxsize=1)
def along_basis() -> Basis:
    """The basis over 0 to 1."""
    even = np.linspace(0.0, 1.0, SPANS + 1)
    nearer = even[1] * 0.5 ** np.arange(HALVED, 0, -1)
    breaks = np.concatenate([even[:1], nearer, even[1:-1], 1.0 - nearer[::-1], even[-1:]])
    return Basis(np.concatenate([np.zeros(CUBIC), breaks, np.ones(CUBIC)]), CUBIC)


@lru_cache(maxsize=1)
def even_spans() -> Ints:
    """The even span (spans,) of which each span is a part."""
    breaks = np.unique(along_basis().knots)
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    return np.asarray((middles * SPANS).astype(np.int32))


@lru_cache(maxsize=1)
def bending_root() -> Floats:
    """Root (r, count) of the bending along: that of `bending_along`, the widths counted out."""
    basis = along_basis()
    widths = np.diff(np.unique(basis.knots))
    root = bending_along(basis)
    weights = (widths * SPANS) ** (0.5 * WIDTHS)
    weighted: Floats = np.repeat(weights, len(root) // len(weights))[:, None] * root
    weighted.setflags(write=False)
    return weighted
